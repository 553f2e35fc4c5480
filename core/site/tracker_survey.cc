// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Corrections of the ground that are no machine's work: by scans, and by surveys.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/constants.h"
#include "core/ground/ground_columns.h"
#include "core/settle/column_samples.h"
#include "core/settle/settler.h"
#include "core/survey/surveyed_samples.h"
#include "soilvdb/tracker.h"

namespace soilvdb::inline v0 {
namespace {

float corrected_slope(double value) {
  return static_cast<float>(std::clamp(value, -kMostCorrectedSlope, kMostCorrectedSlope));
}

/// Cells above and below the heights of a column that a correction may change.
int correction_room(float a, float b) {
  return kCorrectedCells + static_cast<int>(std::ceil(std::abs(a) + std::abs(b)));
}

/// Columns of one tile of 8 x 8 that a survey changes.
class SurveyedTile {
 public:
  SurveyedTile(const SurveyHeights& survey, const Coord2& cell) : survey_(survey), cell_(cell) {}

  /// Finds changes towards the survey's heights. Soil over a gap that the survey sees into is a
  /// roof: that goes first.
  void find(const Ground& ground, BaseColumns& base, std::vector<ColumnEdit>& edits) const {
    const ColumnTile now = read_tile_exactly(base, cell_.x(), cell_.y(), kNoCeiling, false);
    std::array<std::int64_t, BaseColumn::kCells> changes = {};
    std::array<Span, BaseColumn::kCells> above;
    bool looks = false;
    for (int c = 0; c < BaseColumn::kCells; ++c) {
      const GroundColumn& column = now.columns[static_cast<std::size_t>(c)];
      const std::int32_t wanted = wanted_of(c);
      if (wanted == SurveyHeights::kNone || !column.known) continue;
      std::int64_t& change = changes[static_cast<std::size_t>(c)];
      change = wanted - std::llround(64 * column.top);
      if (change >= 0) continue;
      Span& span = above[static_cast<std::size_t>(c)];
      span = {cell_of(wanted / 64.0) + 1, cell_of(column.surface) - 1};
      looks |= span.low <= span.high;
    }
    if (looks) find_gaps(ground, above);
    for (int c = 0; c < BaseColumn::kCells; ++c) {
      const std::int64_t change = changes[static_cast<std::size_t>(c)];
      if (change != 0)
        add(c, now.columns[static_cast<std::size_t>(c)], change, above[static_cast<std::size_t>(c)],
            edits);
    }
  }

 private:
  /// Cells of a column above the survey, and the lowest of them without soil.
  struct Span {
    int low = 0, high = -1, gap = std::numeric_limits<int>::max();
  };

  Coord2 place_of(int c) const { return cell_ + Coord2(c / kChunkSide, c % kChunkSide); }
  /// kNone also beside the survey.
  std::int32_t height_at(const Coord2& cell) const {
    const Coord2 in = cell - survey_.first;
    const bool is_in = in.minCoeff() >= 0 && (survey_.size - in).minCoeff() > 0;
    return is_in ? survey_.heights[survey_.number(in.x(), in.y())] : SurveyHeights::kNone;
  }
  std::int32_t wanted_of(int c) const {
    const Coord2 cell = place_of(c);
    const bool is_in =
        (cell - survey_.begin()).minCoeff() >= 0 && (survey_.end() - cell).minCoeff() > 0;
    return is_in ? height_at(cell) : SurveyHeights::kNone;
  }

  float slope_of(int c, const Coord2& along) const {
    const Coord2 cell = place_of(c);
    std::int32_t before = height_at(cell - along), after = height_at(cell + along);
    const int columns = (before != SurveyHeights::kNone) + (after != SurveyHeights::kNone);
    if (before == SurveyHeights::kNone) before = height_at(cell);
    if (after == SurveyHeights::kNone) after = height_at(cell);
    const double rise = static_cast<double>(std::int64_t{after} - before) / 64;
    return columns == 0 ? 0 : corrected_slope(rise / columns);
  }

  void find_gaps(const Ground& ground, std::array<Span, BaseColumn::kCells>& above) const {
    int low = std::numeric_limits<int>::max(), high = std::numeric_limits<int>::min();
    for (const Span& span : above) {
      if (span.low > span.high) continue;
      low = std::min(low, span.low);
      high = std::max(high, span.high);
    }
    SampleWords words;
    for (int z = floor_to(low, kChunkSide); z <= high; z += kChunkSide) {
      ground.read_samples({cell_.x(), cell_.y(), z}, words);
      for (std::size_t c = 0; c < above.size(); ++c) {
        Span& span = above[c];
        for (int k = 0; k < kChunkSide; ++k)
          if (words[c * kChunkSide + static_cast<std::size_t>(k)] == 0 && z + k >= span.low &&
              z + k <= span.high)
            span.gap = std::min(span.gap, z + k);
      }
    }
  }

  void add(int c, const GroundColumn& column, std::int64_t change, const Span& above,
           std::vector<ColumnEdit>& edits) const {
    const Coord2 cell = place_of(c);
    const int highest = std::max(cell_of(column.surface), cell_of(column.top));
    if (above.gap <= above.high) {
      edits.push_back(ColumnEdit::all(cell, above.gap, highest));
      return;
    }
    const float a = slope_of(c, {1, 0}), b = slope_of(c, {0, 1});
    const int room = correction_room(a, b), at = cell_of(wanted_of(c) / 64.0);
    const bool falls = change < 0;  // a cave below what rises is left as it is
    edits.push_back({.cell = cell,
                     .low = falls ? at - room : std::min(column.full + 1, at),
                     .high = falls ? highest : std::max(highest, at) + room,
                     .samples = std::abs(change),
                     .a = a,
                     .b = b,
                     .rises = !falls});
  }

  const SurveyHeights& survey_;
  Coord2 cell_;
};

}  // namespace

void Tracker::correct(std::span<const ScanChange> changes) {
  ground_.evict();
  std::vector<ColumnEdit> edits;
  edits.reserve(changes.size());
  for (const ScanChange& change : changes) {
    const float a = corrected_slope(change.slope.x()), b = corrected_slope(change.slope.y());
    const double after = change.top + static_cast<double>(change.samples) / 64;
    const int room = correction_room(a, b);
    edits.push_back({.cell = change.cell,
                     .low = cell_of(std::min(change.top, after)) - room,
                     .high = cell_of(std::max(change.top, after)) + room,
                     .samples = std::abs(change.samples),
                     .a = a,
                     .b = b,
                     .rises = change.samples >= 0});
  }
  make(edits);
  others_forget_changes(settlers_.size());
}

std::int64_t Tracker::survey(const SurveyHeights& survey) {
  survey.validate();
  std::int64_t changed = 0;
  const Coord2 low = floor_to(survey.begin(), kChunkSide), end = survey.end();
  for (int x = low.x(); x < end.x(); x += kSurveyBlock) {
    for (int y = low.y(); y < end.y(); y += kSurveyBlock) {
      ground_.evict();
      BaseColumns base(ground_);
      std::vector<SurveyedTile> tiles;
      for (int cx = x; cx < std::min(x + kSurveyBlock, end.x()); cx += kChunkSide)
        for (int cy = y; cy < std::min(y + kSurveyBlock, end.y()); cy += kChunkSide)
          tiles.emplace_back(survey, Coord2(cx, cy));
      for (int round = 0; round < kSurveyRounds && !tiles.empty(); ++round) {
        std::vector<ColumnEdit> edits;
        std::vector<SurveyedTile> others;
        for (const SurveyedTile& tile : tiles) {
          const std::size_t before = edits.size();
          tile.find(ground_, base, edits);
          if (edits.size() > before) others.push_back(tile);
        }
        if (round == 0) changed += static_cast<std::int64_t>(edits.size());
        make(edits);
        tiles = std::move(others);
      }
    }
  }
  others_forget_changes(settlers_.size());
  return changed;
}

SurveyedSamples& Tracker::own_samples() {
  if (surveyed_samples_.use_count() > 1)  // clones share them
    surveyed_samples_ = std::make_shared<SurveyedSamples>(*surveyed_samples_);
  return *surveyed_samples_;
}

/// Makes corrections, and books them.
void Tracker::make(std::span<const ColumnEdit> corrections) {
  if (corrections.empty()) return;
  SurveyedSamples& samples = own_samples();
  const ChangedSamples changed = change_samples(
      ground_, corrections, moves_soil(),
      [&](const Coord3& chunk, const ColumnCounts& counts) { samples.add(chunk, counts); });
  const MassUnits units = moves_soil() ? settlers_.back()->units() : MassUnits();
  const Taken& taken = changed.taken;
  surveyed_.removed += taken.bank + taken.loose;
  surveyed_.mass -= taken.bank * units.bank + taken.loose * units.loose;
  surveyed_.added += changed.added;
  surveyed_.mass += changed.added * (moves_soil() ? units.loose : units.bank);
}

}  // namespace soilvdb::inline v0
