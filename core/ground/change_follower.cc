// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/change_follower.h"

#include <span>

#include "core/ground/ground_state.h"

namespace soilvdb::inline v0 {
/// Adds the chunks touched since the last call to the followers' lists. The caller holds the lock,
/// or is alone.
void Ground::tell_followers() {
  const std::span<const Coord3> touched = state_->touched.sorted();
  for (const Coord3& origin : touched)
    if (SampleLeaf* leaf = state_->find(origin)) leaf->chunk.touched = false;
  if (touched.empty()) return;
  std::erase_if(state_->followers, [](const auto& follower) { return follower.expired(); });
  for (const auto& follower : state_->followers)
    if (const auto changed = follower.lock())
      for (const Coord3& origin : touched) changed->add(origin);
  state_->touched.clear();
}

ChangeFollower::ChangeFollower(Ground& ground) : changed_(std::make_shared<ChunkList>()) {
  follow(ground);
  add_all(ground);
}

ChangeFollower::ChangeFollower(Ground& clone, const ChangeFollower& other)
    : changed_(std::make_shared<ChunkList>(*other.changed_)) {
  // The clone's own list shares these entries, so no change is lost.
  clone.state_->followers.push_back(changed_);
  ground_ = &clone;
}

void ChangeFollower::follow(Ground& ground) {
  ground.tell_followers();  // earlier changes are for other followers only
  ground.state_->followers.push_back(changed_);
  ground_ = &ground;
}

void ChangeFollower::add_all(const Ground& ground) {
  for (const Coord3& origin : ground.origins()) changed_->add(origin);
}

std::vector<Coord3> ChangeFollower::take() {
  std::vector<Coord3> changed;
  take(changed);
  return changed;
}

void ChangeFollower::take(std::vector<Coord3>& changed) {
  {
    const std::unique_lock lock(ground_->state_->mutex);
    ground_->tell_followers();
    changed_->take(changed);
  }
  sort_once(changed);
}

void ChangeFollower::switch_to(Ground& other) {
  ground_->tell_followers();
  add_all(*ground_);
  std::erase_if(ground_->state_->followers,
                [&](const auto& follower) { return follower.lock() == changed_; });
  follow(other);
  add_all(other);
}

}  // namespace soilvdb::inline v0
