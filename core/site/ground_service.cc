// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/ground_service.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "core/ground/soil_writer.h"
#include "core/site/background.h"

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

GroundService::GroundService(Soil& copy, const Options& options) : copy_(copy), options_(options) {
  if (options_.most_jobs == 0) throw std::invalid_argument("one job at least must be let wait");
  if (options_.thread) {
    thread_ = std::thread([this] { run_in_background([this] { serve(); }); });
  }
}

GroundService::~GroundService() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

void GroundService::post(const Soil& soil, std::span<const Coord3> changed) {
  Task task;
  for (const Coord3& origin : changed)
    task.chunks.try_emplace(task.chunks.end(), origin, copy_of(soil, origin));
  task.first_post = task.last_post = ++posts_;
  add(std::move(task));
}

void GroundService::run(std::function<void()> job) {
  Task task;
  task.first_post = task.last_post = posts_;
  task.job = std::move(job);
  add(std::move(task));
}

/// The task joins the last one that waits, if that has no job yet.
void GroundService::add(Task task) {
  if (!options_.thread) {
    perform(std::move(task));
    while (!to_mesh_.empty()) mesh_next();
    return throw_error();
  }
  {
    std::unique_lock lock(mutex_);
    if (task.job) {
      done_.wait(lock, [&] { return jobs_ < options_.most_jobs; });
      ++jobs_;
    }
    if (tasks_.empty() || tasks_.back().job) {
      tasks_.push_back(std::move(task));
    } else {
      task.chunks.merge(tasks_.back().chunks);  // keeps the newer of two
      task.first_post = tasks_.back().first_post;
      tasks_.back() = std::move(task);
    }
  }
  wake_.notify_one();
  throw_error();
}

std::vector<GroundService::Patch> GroundService::take_patches() {
  throw_error();
  ByOrigin<Patch> taken;
  {
    const std::lock_guard lock(mutex_);
    taken.swap(patches_);
  }
  std::vector<Patch> all;
  for (auto& [block, patch] : taken) all.push_back(std::move(patch));
  return all;
}

void GroundService::finish() {
  if (options_.thread) {
    std::unique_lock lock(mutex_);
    done_.wait(lock, [&] { return idle_ && tasks_.empty(); });
  }
  throw_error();
}

std::uint64_t GroundService::blocks_meshed() const {
  const std::lock_guard lock(mutex_);
  return blocks_meshed_;
}

/// The service's thread: tasks in their order, a block when there are none.
void GroundService::serve() {
  std::unique_lock lock(mutex_);
  while (!ending_ || !tasks_.empty()) {
    if (!tasks_.empty()) {
      Task task = std::move(tasks_.front());
      tasks_.pop_front();
      if (task.job) --jobs_;
      lock.unlock();
      done_.notify_all();
      perform(std::move(task));
      lock.lock();
    } else if (!to_mesh_.empty()) {
      lock.unlock();
      mesh_next();
      lock.lock();
    } else {
      idle_ = true;
      done_.notify_all();
      wake_.wait(lock, [&] { return ending_ || !tasks_.empty(); });
      idle_ = false;
    }
  }
}

void GroundService::perform(Task task) {
  try {
    apply(task);
  } catch (...) {
    broken_ = std::current_exception();
    keep_error();
  }
  if (!task.job) return;
  try {
    if (broken_) std::rethrow_exception(broken_);
    task.job();
  } catch (...) {
    keep_error();
  }
}

void GroundService::apply(Task& task) {
  std::vector<Coord3> reshaped;
  SoilWriter writer(copy_);
  for (auto& [origin, now] : task.chunks) {
    if (options_.meshes && !same_surface(copy_.find(origin), now)) reshaped.push_back(origin);
    if (now) {
      writer.put(std::move(*now));
    } else {
      writer.drop(origin);
    }
  }
  applied_ = task.last_post;
  for (const Coord3& block : blocks_touched(reshaped)) {
    if (asked_.try_emplace(block, task.first_post).second) to_mesh_.push_back(block);
  }
}

void GroundService::mesh_next() {
  Patch patch;
  patch.block = to_mesh_.front();
  to_mesh_.pop_front();
  patch.first_post = asked_.extract(patch.block).mapped();
  patch.last_post = applied_;
  try {
    patch.mesh = mesh_block(copy_, patch.block);
    const std::lock_guard lock(mutex_);
    ++blocks_meshed_;
    const auto [it, fresh] = patches_.try_emplace(patch.block);
    if (!fresh) patch.first_post = it->second.first_post;
    it->second = std::move(patch);
  } catch (...) {
    keep_error();
  }
}

void GroundService::keep_error() {
  const std::lock_guard lock(mutex_);
  errors_.push_back(std::current_exception());
}

/// Throws the oldest error that has not been thrown yet.
void GroundService::throw_error() {
  std::exception_ptr error;
  {
    const std::lock_guard lock(mutex_);
    if (errors_.empty()) return;
    error = std::move(errors_.front());
    errors_.pop_front();
  }
  std::rethrow_exception(error);
}

}  // namespace soilvdb::inline v0
