// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/ground/base_columns.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "core/constants.h"
#include "core/lattice/cell_counts.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {
namespace {

std::optional<double> height(const Ground& ground, double x, double y) {
  const double h = ground.voxel_size_m();
  return ground.terrain().height(ground.origin().x() + h * x, ground.origin().y() + h * y);
}

double mean_height(const Ground& ground, int x, int y) {
  double sum = 0;
  for (const double u : {-0.25, 0.25})
    for (const double v : {-0.25, 0.25})
      sum += height(ground, x + u, y + v).value_or(std::numeric_limits<double>::quiet_NaN());
  return (sum / 4 - ground.origin().z()) / ground.voxel_size_m();
}

/// Is there ground all over a column of cells whose middle has some?
bool all_ground(const Ground& ground, int x, int y) {
  const auto has = [&](double u, double v) { return height(ground, x + u, y + v).has_value(); };
  return has(-kColumnCorner, -kColumnCorner) && has(-kColumnCorner, kColumnCorner) &&
         has(kColumnCorner, -kColumnCorner) && has(kColumnCorner, kColumnCorner);
}

/// Heights by counting, as those of ground that was touched are: then soil that comes onto it or
/// goes finds the height that it had. NaN where cliffs take more chunks than are looked at.
void count_heights(const Ground& ground, int cx, int cy, TerrainChunks& chunks,
                   BaseColumn& column) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  column.heights.fill(kNone);
  std::array<double, BaseColumn::kCells> above{};
  int left = BaseColumn::kCells;
  CellCounts counts;
  chunks.begin({cx, cy}, kMaxCountedChunks);
  for (int n = 0, z = column.highest; n < kMaxCountedChunks && left > 0; ++n, z -= kChunkSide) {
    count_cells(chunks.read(ground, {cx, cy, z}).words, counts);
    for (std::size_t c = 0; c < BaseColumn::kCells; ++c) {
      for (int k = kChunkSide - 1; k >= 0 && std::isnan(column.heights[c]); --k) {
        const int count = counts[c * kChunkSide + static_cast<std::size_t>(k)];
        if (count == 64) {
          column.heights[c] = z + k + 0.5 + above[c] / 64;
          --left;
        }
        above[c] += count;
      }
    }
  }
}

BaseColumn column_of(const Ground& ground, int cx, int cy, TerrainChunks& chunks) {
  BaseColumn column;
  const double h = ground.voxel_size_m();
  double low_m = std::numeric_limits<double>::infinity();
  const auto look = [&](int x, int y) {
    const auto height_m = height(ground, cx + x, cy + y);
    if (!height_m) return false;
    if (std::abs(*height_m - ground.origin().z()) > kMaxIndex * h) return true;
    low_m = std::min(low_m, *height_m);
    const int chunk =
        floor_to(cell_of((*height_m - ground.origin().z()) / ground.voxel_size_m()), kChunkSide);
    column.highest = column.some ? std::max(column.highest, chunk) : chunk;
    column.some = true;
    return true;
  };
  for (const auto& [x, y] : {std::pair(4, 4), {0, 0}, {7, 0}, {0, 7}, {7, 7}}) look(x, y);
  const Vec3 corner = ground.world_from_index(Vec3(cx - 0.5, cy - 0.5, 0));
  const Vec3 floor(corner.x(), corner.y(), low_m - h);
  column.whole = column.some && ground.terrain().has_data({floor, floor + Vec3(8 * h, 8 * h, h)});
  for (int c = 0; c < BaseColumn::kCells; ++c) {
    const int x = c / kChunkSide, y = c % kChunkSide;
    if (!column.whole) {  // islands, cliffs at holes
      if (!look(x, y) || !all_ground(ground, cx + x, cy + y))
        column.all_ground &= ~(std::uint64_t{1} << c);
    }
  }
  if (!column.some) {
    column.all_ground = 0;
    column.heights.fill(std::numeric_limits<double>::quiet_NaN());
    return column;
  }
  while (ground.classify({cx, cy, column.highest + kChunkSide}) != Content::kAir)
    column.highest += kChunkSide;
  count_heights(ground, cx, cy, chunks, column);
  for (std::size_t c = 0; c < BaseColumn::kCells; ++c) {
    const int x = static_cast<int>(c) / kChunkSide, y = static_cast<int>(c) % kChunkSide;
    if (std::isnan(column.heights[c])) column.heights[c] = mean_height(ground, cx + x, cy + y);
  }
  return column;
}

}  // namespace

const TerrainChunks::Chunk& TerrainChunks::read(const Ground& ground, const Coord3& origin) {
  was_read_ = true;
  for (const Chunk& known : chunks_)
    if (known.z == origin.z()) return known;
  Chunk& made = chunks_.emplace_back();
  made.z = origin.z();
  ground.read_base(origin, made.words);
  for (std::size_t n = 0; n < made.words.size(); ++n) {
    const std::uint64_t word = made.words[n];
    made.some[n >> 6] |= std::uint64_t{word != 0} << (n & 63);
    made.full[n >> 6] |= std::uint64_t{word == kAllSoil} << (n & 63);
  }
  return made;
}

std::shared_ptr<const BaseColumn> BaseColumns::ask(std::uint64_t key, int cx, int cy) {
  {
    const std::lock_guard lock(told_->mutex);
    const auto known = told_->columns.find(key);
    if (known != told_->columns.end()) return known->second;
  }
  auto column = std::make_shared<const BaseColumn>(column_of(ground_, cx, cy, chunks_));
  const std::lock_guard lock(told_->mutex);
  if (told_->columns.size() >= kMaxBaseColumns) told_->columns.clear();
  return told_->columns.try_emplace(key, std::move(column)).first->second;
}

BaseColumns::Known& BaseColumns::known(int cx, int cy) {
  const std::uint64_t key = plan_key({cx, cy});
  const auto known = columns_.find(key);
  if (known != columns_.end()) return known->second;
  if (columns_.size() >= kMaxBaseColumns) columns_.clear();
  return columns_.try_emplace(key, Known{ask(key, cx, cy)}).first->second;
}

bool BaseColumns::is_mixed(const Coord3& chunk) {
  Known& column = known(chunk.x(), chunk.y());
  constexpr int kAbove = 32;  // soil may be piled up there
  const int number = (column.column->highest - chunk.z()) / kChunkSide + kAbove;
  if (number < 0 || number >= 64) return ground_.classify(chunk) == Content::kMixed;
  const std::uint64_t bit = std::uint64_t{1} << number;
  if ((column.looked_up & bit) == 0) {
    if (ground_.classify(chunk) == Content::kMixed) column.mixed |= bit;
    column.looked_up |= bit;
  }
  return (column.mixed & bit) != 0;
}

double BaseColumns::height(const Eigen::Vector2i& cell) {
  const Eigen::Vector2i chunk = floor_to(cell, kChunkSide), in = cell - chunk;
  return at(chunk.x(), chunk.y()).heights[static_cast<std::size_t>(in.x() * kChunkSide + in.y())];
}

}  // namespace soilvdb::inline v0
