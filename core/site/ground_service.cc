// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/ground_service.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "core/ground/soil_writer.h"
#include "soilvdb/background.h"

namespace soilvdb::inline v0 {
namespace {

std::optional<Chunk> copy_of(const Soil& soil, const Coord3& origin) {
  if (const Chunk* chunk = soil.find(origin)) return soil.copy(*chunk);
  return std::nullopt;
}

/// Is the mesh surely the same?
bool same_surface(const Chunk* before, const std::optional<Chunk>& now) {
  if (before == nullptr || !now) return before == nullptr && !now;
  return before->samples == now->samples;
}

}  // namespace

GroundService::GroundService(Soil& copy, const Options& options)
    : copy_(copy), options_(options), background_(options.thread, [this] { return mesh_next(); }) {
  if (options_.most_jobs == 0) throw std::invalid_argument("one job at least must be let wait");
  if (options_.meshes) mesher_.emplace(copy_);
}

GroundService::~GroundService() = default;

void GroundService::post(const Soil& soil, std::span<const Coord3> changed) {
  Changes changes;
  for (const Coord3& origin : changed)
    changes.chunks.try_emplace(changes.chunks.end(), origin, copy_of(soil, origin));
  changes.first_post = changes.last_post = ++posts_;
  std::shared_ptr<Changes> waiting;
  {
    const std::lock_guard lock(mutex_);
    if (newest_) {                            // joins those that wait
      changes.chunks.merge(newest_->chunks);  // keeps the newer of two
      changes.first_post = newest_->first_post;
      *newest_ = std::move(changes);
    } else {
      waiting = newest_ = std::make_shared<Changes>(std::move(changes));
    }
  }
  if (!waiting) return background_.rethrow();
  background_.run([this, waiting] {
    {
      const std::lock_guard lock(mutex_);
      if (newest_ == waiting) newest_.reset();
    }
    apply(*waiting);
  });
}

void GroundService::run(std::function<void()> job) {
  {
    std::unique_lock lock(mutex_);
    job_began_.wait(lock, [&] { return jobs_ < options_.most_jobs; });
    ++jobs_;
    newest_.reset();  // what is posted from now on is for the next job
  }
  background_.run([this, job = std::move(job)] {
    {
      const std::lock_guard lock(mutex_);
      --jobs_;
    }
    job_began_.notify_one();
    if (broken_) std::rethrow_exception(broken_);
    job();
  });
}

std::vector<GroundService::Patch> GroundService::take_patches() {
  background_.rethrow();
  ByOrigin<Patch> taken;
  {
    const std::lock_guard lock(mutex_);
    taken.swap(patches_);
  }
  std::vector<Patch> all;
  for (auto& [block, patch] : taken) all.push_back(std::move(patch));
  return all;
}

void GroundService::finish() { background_.wait(); }

std::uint64_t GroundService::blocks_meshed() const {
  const std::lock_guard lock(mutex_);
  return blocks_meshed_;
}

void GroundService::apply(Changes& changes) try {
  std::vector<Coord3> reshaped;
  SoilWriter writer(copy_);
  for (auto& [origin, now] : changes.chunks) {
    if (options_.meshes && !same_surface(copy_.find(origin), now)) reshaped.push_back(origin);
    if (now) {
      writer.put(std::move(*now));
    } else {
      writer.drop(origin);
    }
  }
  applied_ = changes.last_post;
  for (const Coord3& block : blocks_touched(reshaped)) {
    if (asked_.try_emplace(block, changes.first_post).second) to_mesh_.push_back(block);
  }
} catch (...) {
  broken_ = std::current_exception();
  throw;
}

/// @return whether there are more
bool GroundService::mesh_next() {
  if (to_mesh_.empty()) return false;
  Patch patch;
  patch.block = to_mesh_.front();
  to_mesh_.pop_front();
  patch.first_post = asked_.extract(patch.block).mapped();
  patch.last_post = applied_;
  patch.mesh = mesher_->block(patch.block);
  const std::lock_guard lock(mutex_);
  ++blocks_meshed_;
  const auto [it, inserted] = patches_.try_emplace(patch.block);
  if (!inserted) patch.first_post = it->second.first_post;
  it->second = std::move(patch);
  return !to_mesh_.empty();
}

}  // namespace soilvdb::inline v0
