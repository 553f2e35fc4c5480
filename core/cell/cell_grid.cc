// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cell/cell_grid.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "core/lattice/affine.h"

namespace soilvdb::inline v0 {
namespace {

SOILVDB_FOR_CPUS void count_row(const std::uint64_t* words, std::uint8_t* counts) {
  for (int z = 0; z < kChunkSide; ++z)
    counts[z] = static_cast<std::uint8_t>(std::popcount(words[z]));
}

}  // namespace

CellGrid::CellGrid(const Ground& ground, std::span<const Coord3> asked, int halo)
    : ground_(ground), first_(asked.front()) {
  Coord3 last = first_;
  for (const Coord3& origin : asked) {
    first_ = first_.cwiseMin(origin);
    last = last.cwiseMax(origin);
  }
  sides_ = last - first_ + Coord3::Constant(kChunkSide * (1 + 2 * halo));
  chunks_ = sides_ / kChunkSide;
  first_ -= Coord3::Constant(kChunkSide * halo);
  cells_ = static_cast<std::size_t>(sides_.x()) * sides_.y() * sides_.z();
  const std::size_t chunks = cells_ / kChunkVoxels;
  auto& pool = buffer_pool();
  const bool fits = !pool.empty() && pool.back()->room >= cells_;
  if (fits) {
    buffers_ = std::move(pool.back());
    pool.pop_back();
  } else {
    buffers_ = std::make_unique<Buffers>();
    buffers_->words.reset(new std::uint64_t[cells_]);
    buffers_->room = cells_;
  }
  buffers_->counts.assign(cells_, 0);
  buffers_->changed.assign(cells_, 0);
  buffers_->patterns.assign(cells_, kPatterns);
  words_ = buffers_->words.get();
  counts_ = buffers_->counts.data();
  changed_ = buffers_->changed.data();
  states_.resize(chunks, kUnread);
  asked_.resize(chunks);
  resident_.resize(chunks);
  base_.resize(chunks);
  asked_near_.resize(chunks);
  std::vector<std::uint8_t> wanted(chunks);
  for (const Coord3& origin : asked) {
    const Coord3 c = (origin - first_) / kChunkSide;
    asked_[static_cast<std::size_t>(chunk_id(c.x(), c.y(), c.z()))] = 1;
    for (int x = c.x() - halo; x <= c.x() + halo; ++x) {
      for (int y = c.y() - halo; y <= c.y() + halo; ++y) {
        for (int z = c.z() - halo; z <= c.z() + halo; ++z) {
          wanted[static_cast<std::size_t>(chunk_id(x, y, z))] = 1;
        }
      }
    }
  }
  for (int x = 0, n = 0; x < chunks_.x(); ++x) {
    for (int y = 0; y < chunks_.y(); ++y) {
      for (int z = 0; z < chunks_.z(); ++z, ++n) {
        if (wanted[static_cast<std::size_t>(n)])
          read(ground, n, first_ + kChunkSide * Coord3(x, y, z));
      }
    }
  }
}

CellGrid::~CellGrid() {
  auto& pool = buffer_pool();
  pool.clear();
  pool.push_back(std::move(buffers_));
}

std::vector<std::unique_ptr<CellGrid::Buffers>>& CellGrid::buffer_pool() {
  thread_local std::vector<std::unique_ptr<Buffers>> pool;
  return pool;
}

void CellGrid::read(const Ground& ground, int chunk, const Coord3& origin) {
  SampleWords words, base;
  ground.read_samples(origin, words);
  const bool resident = ground.find(origin) != nullptr;
  resident_[static_cast<std::size_t>(chunk)] = resident;
  if (resident) ground.read_base(origin, base);
  std::uint64_t any = 0, all = ~std::uint64_t{0};
  const Coord3 low = origin - first_;
  for (int x = 0; x < kChunkSide; ++x) {
    for (int y = 0; y < kChunkSide; ++y) {
      const std::uint64_t* const row = &words[static_cast<std::size_t>(x * 64 + y * 8)];
      const std::size_t to = static_cast<std::size_t>(id(low.x() + x, low.y() + y, low.z()));
      std::memcpy(&words_[to], row, kChunkSide * sizeof(*row));
      count_row(row, &counts_[to]);
      for (int z = 0; z < kChunkSide; ++z) {
        any |= row[z];
        all &= row[z];
      }
      if (!resident) continue;
      const std::uint64_t* const was = &base[static_cast<std::size_t>(x * 64 + y * 8)];
      for (int z = 0; z < kChunkSide; ++z) {
        changed_[to + static_cast<std::size_t>(z)] = row[z] != was[z];
      }
    }
  }
  states_[static_cast<std::size_t>(chunk)] = any == 0                   ? kEmpty
                                             : all == ~std::uint64_t{0} ? kFull
                                                                        : kBoth;
}

bool CellGrid::any_change(const Coord3& low, int side) const {
  const Coord3 from = low.cwiseMax(0), to = (low + Coord3::Constant(side)).cwiseMin(sides_);
  for (int x = from.x(); x < to.x(); ++x) {
    for (int y = from.y(); y < to.y(); ++y) {
      const std::uint8_t* const row = changed_ + id(x, y, 0);
      if (std::any_of(row + from.z(), row + to.z(), [](std::uint8_t c) { return c != 0; })) {
        return true;
      }
    }
  }
  return false;
}

bool CellGrid::undug(int id) const {
  unsigned any = 0;
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      const std::uint8_t* const row = changed_ + id + x * step(0) + y * step(1);
      any |= static_cast<unsigned>(row[-1] | row[0] | row[1]);
    }
  }
  return any == 0;
}

float CellGrid::base_distance(int id) const {
  const Coord3 c = at(id), chunk = c / kChunkSide, in = c - kChunkSide * chunk;
  std::unique_ptr<float[]>& values =
      base_[static_cast<std::size_t>(chunk_id(chunk.x(), chunk.y(), chunk.z()))];
  if (!values) {
    values.reset(new float[kChunkVoxels]);
    const Coord3 origin = first_ + kChunkSide * chunk;
    ground_.terrain().distance(ground_.world_from_index(origin.cast<double>()),
                               ground_.voxel_size_m(), ground_.band_m(), values.get());
    const float scale = static_cast<float>(1 / ground_.voxel_size_m());
    for (int n = 0; n < kChunkVoxels; ++n) values[static_cast<std::size_t>(n)] *= scale;
  }
  return values[static_cast<std::size_t>(in.x() * 64 + in.y() * 8 + in.z())];
}

const std::vector<Coord3>& CellGrid::asked_near(const Coord3& chunk) const {
  auto& known = asked_near_[static_cast<std::size_t>(chunk_id(chunk.x(), chunk.y(), chunk.z()))];
  if (known) return *known;
  known = std::make_unique<std::vector<Coord3>>();
  std::vector<Coord3>& lows = *known;
  for (int x = std::max(chunk.x() - 2, 0); x <= std::min(chunk.x() + 2, chunks_.x() - 1); ++x) {
    for (int y = std::max(chunk.y() - 2, 0); y <= std::min(chunk.y() + 2, chunks_.y() - 1); ++y) {
      for (int z = std::max(chunk.z() - 2, 0); z <= std::min(chunk.z() + 2, chunks_.z() - 1); ++z) {
        if (asked_[static_cast<std::size_t>(chunk_id(x, y, z))]) {
          lows.push_back(kChunkSide * Coord3(x, y, z));
        }
      }
    }
  }
  return lows;
}

int CellGrid::away(const Coord3& c, const std::vector<Coord3>& asked) {
  int least = 3 * kChunkSide;
  for (const Coord3& low : asked) {
    int most = 0;
    for (int a = 0; a < 3; ++a) {
      most = std::max({most, low[a] - c[a], c[a] - low[a] - kChunkSide + 1});
    }
    least = std::min(least, most);
  }
  return least;
}

int CellGrid::away(const Coord3& c) const {
  return asked(c) ? 0 : away(c, asked_near(c / kChunkSide));
}

std::vector<CellGrid::Cell> CellGrid::surface_cells(int range) const {
  std::vector<Cell> cells;
  const int sx = step(0), sy = step(1);
  for (int x = 0, n = 0; x < chunks_.x(); ++x) {
    for (int y = 0; y < chunks_.y(); ++y) {
      for (int z = 0; z < chunks_.z(); ++z, ++n) {
        const State state = states_[static_cast<std::size_t>(n)];
        if (state == kUnread || state == kEmpty) continue;
        if (state == kFull) {
          const auto plain = [&](int i, int j, int k) {
            return i < 0 || j < 0 || k < 0 || i >= chunks_.x() || j >= chunks_.y() ||
                   k >= chunks_.z() ||
                   states_[static_cast<std::size_t>(chunk_id(i, j, k))] == kFull;
          };
          if (plain(x - 1, y, z) && plain(x + 1, y, z) && plain(x, y - 1, z) &&
              plain(x, y + 1, z) && plain(x, y, z - 1) && plain(x, y, z + 1)) {
            continue;
          }
        }
        const bool inside = asked_[static_cast<std::size_t>(n)];
        const std::vector<Coord3>& asked = asked_near({x, y, z});
        if (asked.empty()) continue;
        for (int i = 8 * x; i < 8 * x + 8; ++i) {
          if (i == 0 || i == sides_.x() - 1) continue;
          for (int j = 8 * y; j < 8 * y + 8; ++j) {
            if (j == 0 || j == sides_.y() - 1) continue;
            for (int k = 8 * z; k < 8 * z + 8; ++k) {
              if (k == 0 || k == sides_.z() - 1) continue;
              const int c = id(i, j, k), soil = count(c);
              if (soil == 0) continue;
              if (soil == 64 && count(c - sx) != 0 && count(c + sx) != 0 && count(c - sy) != 0 &&
                  count(c + sy) != 0 && count(c - 1) != 0 && count(c + 1) != 0) {
                continue;
              }
              const int from = inside ? 0 : away({i, j, k}, asked);
              if (from <= range) cells.push_back({c, from});
            }
          }
        }
      }
    }
  }
  return cells;
}

}  // namespace soilvdb::inline v0
