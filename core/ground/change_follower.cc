// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/change_follower.h"

#include "core/ground/soil_state.h"

namespace soilvdb::inline v0 {
/// Hands on what was touched since the last call.
void Soil::tell_followers() {
  const std::vector<Coord3> touched = state_->touched.take();
  for (const Coord3& origin : touched)
    if (SampleLeaf* leaf = state_->find(origin)) leaf->chunk.touched = false;
  std::erase_if(state_->followers, [](const auto& follower) { return follower.expired(); });
  if (touched.empty()) return;
  for (const auto& follower : state_->followers)
    if (const auto changed = follower.lock())
      for (const Coord3& origin : touched) changed->add(origin);
}

ChangeFollower::ChangeFollower(Soil& soil) : changed_(std::make_shared<ChunkList>()) {
  follow(soil);
  add_all(soil);
}

ChangeFollower::ChangeFollower(Soil& clone, const ChangeFollower& other)
    : changed_(std::make_shared<ChunkList>(*other.changed_)) {
  // Of the clone's list, which is the other ground's as well, nothing is lost.
  clone.state_->followers.push_back(changed_);
  soil_ = &clone;
}

void ChangeFollower::follow(Soil& soil) {
  soil.tell_followers();  // changes before this are of others only
  soil.state_->followers.push_back(changed_);
  soil_ = &soil;
}

void ChangeFollower::add_all(const Soil& soil) {
  for (const Coord3& origin : soil.origins()) changed_->add(origin);
}

std::vector<Coord3> ChangeFollower::take() {
  soil_->tell_followers();
  return changed_->take();
}

void ChangeFollower::switch_to(Soil& other) {
  soil_->tell_followers();
  add_all(*soil_);
  std::erase_if(soil_->state_->followers,
                [&](const auto& follower) { return follower.lock() == changed_; });
  follow(other);
  add_all(other);
}

}  // namespace soilvdb::inline v0
