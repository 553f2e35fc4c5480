// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of ground that changed, in squares with bounds, as rays look at them.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "core/lattice/chunk_math.h"
#include "core/lattice/ray_walk.h"

namespace soilvdb::inline v0 {

/// A square of quads. Quad (x, y) has its corners at the middles of columns (x, y) to
/// (x + 1, y + 1). It is changed if one of these is; the surface of other quads is the terrain.
struct RayPage {
  /// Of a square of quads: no surface is above.
  struct Bounds {
    float changed;  ///< of its changed quads; -infinity without any
    float all;      ///< of all its quads; infinity unless these changed and have four columns
  };
  static constexpr int kColumns = kRaySide + 1;

  std::array<double, kColumns * kColumns> heights;  ///< index space; NaN without ground
  std::array<Bounds, ray_level_begin(kRayLevels + 1, 0)> bounds;

  /// @param x, y of a quad from the page's first
  static std::size_t square(int level, int x, int y) {
    return ray_level_begin(level, 0) +
           (static_cast<std::size_t>(x >> level) << (kRayLevels - level)) +
           static_cast<std::size_t>(y >> level);
  }
};

/// The pages in which a quad may have changed. They are made where rays come.
class RayPages {
 public:
  /// A tile of columns changed. @param tile its lowest cell
  void change(const Coord2& tile) {
    for (const int x : {tile.x() - 1, tile.x()}) {
      for (const int y : {tile.y() - 1, tile.y()}) {
        const Coord2 first = floor_to(Coord2(x, y), kRaySide);
        const auto [at, is_new] = slots_.try_emplace(plan_key(first));
        Slot& slot = at->second;
        if (is_new)
          for (std::size_t k = 0; k < kWider; ++k) squares_[k].insert(square_key(k, first));
        if (slot.page.load(std::memory_order_relaxed) != nullptr) --count_;
        slot.page = nullptr;
        slot.first = first;
        box_.extend(first);
        box_.extend(Coord2(first + Coord2::Constant(kRaySide - 1)));
      }
    }
  }
  /// To be called after changes, before pages are found. @param most more are freed, all at once
  void prepare(std::size_t most) {
    lay_out();
    if (count_ < most) return;
    for (auto& [key, slot] : slots_) {
      slot.page = nullptr;
      slot.owned.reset();
    }
    count_ = 0;
  }
  /// Where there is no page: the level of a square around it that has none at all.
  /// @param first quad of a page
  [[gnu::noinline]] int empty_level(const Coord2& first) const {
    if (!plan_.empty() && size_.maxCoeff() <= kFewPages) return kRayLevels;
    std::size_t k = 0;
    while (k < kWider && !squares_[k].contains(square_key(k, first))) ++k;
    return kRayLevels + kWiderLevels * static_cast<int>(k);
  }
  /// All quads of pages.
  const Eigen::AlignedBox2i& box() const { return box_; }
  /// The page of a first quad, by make(page) if it isn't there; null where nothing changed. Several
  /// threads may call it.
  template <typename Make>
  const RayPage* find(const Coord2& first, const Make& make) {
    Slot* const there = slot_of(first);
    if (there == nullptr) return nullptr;
    Slot& slot = *there;
    if (const RayPage* known = slot.page.load(std::memory_order_acquire)) return known;
    const std::lock_guard lock(mutex_);
    if (const RayPage* known = slot.page.load(std::memory_order_relaxed)) return known;
    if (!slot.owned) slot.owned = std::make_unique<RayPage>();
    make(*slot.owned);
    slot.page.store(slot.owned.get(), std::memory_order_release);
    ++count_;
    return slot.owned.get();
  }

 private:
  struct Slot {
    std::unique_ptr<RayPage> owned;
    std::atomic<const RayPage*> page = nullptr;  // null while it is stale
    Coord2 first = {0, 0};
  };
  /// Levels of squares wider than pages, and how many levels one is above the last: up to 2^22
  /// quads.
  static constexpr std::size_t kWider = 8;
  static constexpr int kWiderLevels = 2;
  /// Pages across that are sooner passed one by one.
  static constexpr int kFewPages = 16;
  static std::uint64_t square_key(std::size_t k, const Coord2& first) {
    const int level = kRayLevels + kWiderLevels * static_cast<int>(k + 1);
    return plan_key(floor_to(first, 1 << level));
  }
  /// Largest box that is laid out as a dense array, pages; a wider one is looked up.
  static constexpr double kMaxLaidOut = 1 << 20;

  void lay_out() {
    if (slots_.size() == laid_out_) return;
    laid_out_ = slots_.size();
    size_ = (box_.sizes() + Coord2::Ones()) / kRaySide;
    plan_.clear();
    if (size_.cast<double>().prod() > kMaxLaidOut) return;
    plan_.resize(static_cast<std::size_t>(size_.prod()));
    for (auto& [key, slot] : slots_) plan_[place_of(slot.first)] = &slot;
  }
  std::size_t place_of(const Coord2& first) const {
    const Coord2 in = first - box_.min();
    return static_cast<std::size_t>((in.x() >> kRayLevels) * size_.y() + (in.y() >> kRayLevels));
  }
  Slot* slot_of(const Coord2& first) {
    if (!plan_.empty()) return plan_[place_of(first)];
    const auto found = slots_.find(plan_key(first));
    return found == slots_.end() ? nullptr : &found->second;
  }

  std::unordered_map<std::uint64_t, Slot, PlanHash> slots_;
  /// Wider squares with pages, which rays go through at once without.
  std::array<std::unordered_set<std::uint64_t, PlanHash>, kWider> squares_;
  std::vector<Slot*> plan_;  // row by row of x, null where there is none; empty: too wide
  std::size_t laid_out_ = 0;
  Coord2 size_ = {0, 0};  // of the box, pages
  Eigen::AlignedBox2i box_;
  std::mutex mutex_;
  std::size_t count_ = 0;  // of pages that are not stale; the lock guards it
};

}  // namespace soilvdb::inline v0
