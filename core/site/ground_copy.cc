// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/ground_copy.h"

#include <memory>
#include <utility>

#include "core/ground/ground_writer.h"

namespace soilvdb::inline v0 {

void GroundCopy::post(const Ground& ground, std::span<const Coord3> changed) {
  for (const Coord3& origin : changed) {
    const Chunk* const chunk = ground.find(origin);
    changes_.insert_or_assign(origin, chunk ? std::optional(ground.copy(*chunk)) : std::nullopt);
  }
  background_.rethrow();
}

void GroundCopy::run(std::function<void()> job) {
  background_.run([this, changes = std::make_shared<Changes>(std::exchange(changes_, {})),
                   job = std::move(job)] {
    apply(*changes);
    job();
  });
}

void GroundCopy::apply(Changes& changes) {
  if (broken_) std::rethrow_exception(broken_);
  try {
    GroundWriter writer(copy_);
    for (auto& [origin, now] : changes) {
      if (now) {
        writer.put(std::move(*now));
      } else {
        writer.drop(origin);
      }
    }
    changes.clear();
  } catch (...) {
    broken_ = std::current_exception();
    throw;
  }
}

}  // namespace soilvdb::inline v0
