// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cell/cell_models.h"

#include <array>

#include "core/cell/cell_volume.h"
#include "core/cell/crease.h"
#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

/// The cells within kPlaneSight, the nearest first.
struct Sight {
  std::array<std::array<std::int8_t, 3>, 124> at{};
  constexpr Sight() {
    std::size_t n = 0;
    for (int square = 1; square <= 3 * kPlaneSight * kPlaneSight; ++square) {
      for (int x = -kPlaneSight; x <= kPlaneSight; ++x) {
        for (int y = -kPlaneSight; y <= kPlaneSight; ++y) {
          for (int z = -kPlaneSight; z <= kPlaneSight; ++z) {
            if (x * x + y * y + z * z == square) {
              at[n++] = {static_cast<std::int8_t>(x), static_cast<std::int8_t>(y),
                         static_cast<std::int8_t>(z)};
            }
          }
        }
      }
    }
  }
};
constexpr Sight kNearby;

/// The tangent plane of a curved surface, from its plane in one cell, at the cell so far away.
CellPlane extrapolated(const CellModels::Cell& cell, int x, int y, int z) {
  const Tangents t(cell.plane);
  const float fx = static_cast<float>(x), fy = static_cast<float>(y), fz = static_cast<float>(z);
  const float u = t.u[0] * fx + (t.u[1] * fy + t.u[2] * fz);
  const float v = t.v[0] * fx + (t.v[1] * fy + t.v[2] * fz);
  const float du = cell.curvature.uu * u + cell.curvature.uv * v,
              dv = cell.curvature.uv * u + cell.curvature.vv * v;
  const float inwards = kCurvatureOffset * (cell.curvature.uu + cell.curvature.vv);
  const float distance = cell.plane.signed_distance(fx, fy, fz) - inwards + (du * u + dv * v) / 2;
  const float scale = 1 / std::sqrt(1 + (du * du + dv * dv));
  return {(cell.plane.nx + (du * t.u[0] + dv * t.v[0])) * scale,
          (cell.plane.ny + (du * t.u[1] + dv * t.v[1])) * scale,
          (cell.plane.nz + (du * t.u[2] + dv * t.v[2])) * scale, -distance * scale};
}

}  // namespace

CellModels::CellModels(const CellGrid& grid, int wanted, FitCache* cache)
    : grid_(grid), cache_(cache) {
  index_.assign(grid.cells(), -1);
  const int range = wanted + kVolumeHalo;
  const std::vector<CellGrid::Cell> surface =
      grid.surface_cells(range + kCreaseSweeps - 1 + kPlaneSight + kBendHalo);
  cells_.reserve(surface.size());
  for (const CellGrid::Cell& c : surface) {
    index_[static_cast<std::size_t>(c.id)] = static_cast<int>(cells_.size());
    cells_.emplace_back();
    cells_.back().id = c.id;
    cells_.back().away = c.away;
    cells_.back().kind = grid.undug(c.id) ? Cell::kBase : Cell::kUnfitted;
  }
  // Farther out, only the cells that these need.
  for (Cell& cell : cells_) {
    if (cell.kind == Cell::kBase && cell.away <= wanted) {
      cell.model.plane[0] = base_plane(cell.id);
      cell.model.solved = true;
    } else if (cell.away <= range) {
      fit(cell);
      if (cell.kind != Cell::kSmooth) continue;
      find_curvature(cell);
      cell.model.plane[0] = extrapolated(cell, 0, 0, 0);
      cell.model.solved = true;
    }
  }
  solve_creases(range);
  conserve_volumes(wanted);
}

void CellModels::fit(Cell& cell) {
  if (cell.kind != Cell::kUnfitted) return;
  const PlaneFit fit = cache_ != nullptr ? cache_->fit(grid_, cell.id) : fit_plane(grid_, cell.id);
  cell.plane = fit.plane;
  cell.opposite = fit.opposite;
  cell.has_opposite = fit.has_opposite;
  cell.kind = fit.smooth ? Cell::kSmooth : fit.one_sided ? Cell::kOneSided : Cell::kOther;
}

void CellModels::solve_creases(int range) {
  // Those asked for and those next to them, which are looked at in the second sweep.
  std::vector<int> wanted, all;
  std::vector<std::uint8_t> listed(cells_.size());
  const auto list = [&](int k) {
    Cell& cell = cells_[static_cast<std::size_t>(k)];
    fit(cell);
    if (listed[static_cast<std::size_t>(k)]) return;
    listed[static_cast<std::size_t>(k)] = 1;
    if (cell.kind == Cell::kOneSided || cell.kind == Cell::kOther) all.push_back(k);
  };
  for (int k = 0; k < static_cast<int>(cells_.size()); ++k) {
    const Cell& cell = cells_[static_cast<std::size_t>(k)];
    if (cell.away <= range && (cell.kind == Cell::kOneSided || cell.kind == Cell::kOther)) {
      wanted.push_back(k);
      list(k);
    }
  }
  for (const int k : wanted) {
    const int id = cells_[static_cast<std::size_t>(k)].id;
    for (int n = 0; n < 27; ++n) {
      const int other = index_[static_cast<std::size_t>(grid_.beside(id, n))];
      if (other >= 0) list(other);
    }
  }
  std::vector<CellModel> models(all.size());
  for (std::size_t n = 0; n < all.size(); ++n) {
    models[n] = crease(cells_[static_cast<std::size_t>(all[n])]);
  }
  for (std::size_t n = 0; n < all.size(); ++n) {
    cells_[static_cast<std::size_t>(all[n])].model = models[n];
  }
  // Again with the planes of neighbours, for cells with unexplained samples.
  models.clear();
  for (const int k : wanted) {
    const Cell& cell = cells_[static_cast<std::size_t>(k)];
    models.push_back(cell.model);
    if (cell.model.solved && cell.model.wrong <= kExplainedWrong) continue;
    models.back() = crease(cell);
  }
  for (std::size_t n = 0; n < wanted.size(); ++n) {
    cells_[static_cast<std::size_t>(wanted[n])].model = models[n];
  }
}

CellModel CellModels::crease(const Cell& cell) {
  Candidates candidates;
  gather(cell, candidates);
  return cache_ != nullptr ? cache_->crease(grid_, cell.id, candidates)
                           : solve_crease(grid_, cell.id, candidates);
}

void CellModels::conserve_volumes(int range) {
  // Volumes, not samples that models have wrong: a model may explain all samples and not hold the
  // volume that they count.
  std::vector<float> more(cells_.size()), areas(cells_.size());
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    const Cell& cell = cells_[k];
    if (cell.kind == Cell::kBase || !cell.model.solved || cell.away > range + 1) continue;
    // Full cells are left out, because the empty cells that would balance them are not here.
    const int soil = grid_.count(cell.id);
    if (soil == 64) continue;
    const CellVolume volume = cell_volume(cell.model, grid_.first() + grid_.at(cell.id));
    more[k] = volume.soil - static_cast<float>(soil) / 64;
    areas[k] = volume.surface;
  }
  std::vector<float> shifts(cells_.size());
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    const Cell& cell = cells_[k];
    if (cell.kind == Cell::kBase || !cell.model.solved || cell.away > range) continue;
    float sum = 0, area = 0;
    for (int x = -1; x <= 1; ++x) {
      for (int y = -1; y <= 1; ++y) {
        for (int z = -1; z <= 1; ++z) {
          const int n =
              index_[static_cast<std::size_t>(cell.id + x * grid_.step(0) + y * grid_.step(1) + z)];
          if (n < 0) continue;
          sum += more[static_cast<std::size_t>(n)];
          area += areas[static_cast<std::size_t>(n)];
        }
      }
    }
    const float shift = sum / std::max(area, kMinVolumeArea);
    shifts[k] = std::min(std::max(shift, -kMaxVolumeShift), kMaxVolumeShift);
  }
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    for (CellPlane& plane : cells_[k].model.plane) plane.d -= shifts[k];
  }
}

CellPlane CellModels::base_plane(int id) const {
  CellPlane p;
  const int sx = grid_.step(0), sy = grid_.step(1);
  p.nx = grid_.base_distance(id + sx) - grid_.base_distance(id - sx);
  p.ny = grid_.base_distance(id + sy) - grid_.base_distance(id - sy);
  p.nz = grid_.base_distance(id + 1) - grid_.base_distance(id - 1);
  if (!normalise(p)) p.nz = 1;
  p.d = -grid_.base_distance(id);
  return p;
}

void CellModels::find_curvature(Cell& cell) {
  if (cell.has_curvature) return;
  cell.has_curvature = true;
  const Tangents t(cell.plane);
  float xx = 0, xy = 0, yy = 0, ux = 0, uy = 0, vx = 0, vy = 0;
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        Cell* const other = neighbour(cell, x, y, z);
        if (other == nullptr || other == &cell) continue;
        fit(*other);
        if (other->kind != Cell::kSmooth) continue;
        const CellPlane& q = other->plane;
        if (cell.plane.along(q.nx, q.ny, q.nz) < kCurvatureCosine) continue;
        const auto along = [](const float* e, float a, float b, float c) {
          return e[0] * a + (e[1] * b + e[2] * c);
        };
        // From foot to foot.
        const float fx = static_cast<float>(x) + q.d * q.nx - cell.plane.d * cell.plane.nx;
        const float fy = static_cast<float>(y) + q.d * q.ny - cell.plane.d * cell.plane.ny;
        const float fz = static_cast<float>(z) + q.d * q.nz - cell.plane.d * cell.plane.nz;
        const float dx = along(t.u, fx, fy, fz), dy = along(t.v, fx, fy, fz);
        const float du = along(t.u, q.nx, q.ny, q.nz), dv = along(t.v, q.nx, q.ny, q.nz);
        xx += dx * dx;
        xy += dx * dy;
        yy += dy * dy;
        ux += du * dx;
        uy += du * dy;
        vx += dv * dx;
        vy += dv * dy;
      }
    }
  }
  const float det = xx * yy - xy * xy;
  if (!(det > kMinCurvatureSpread)) return;
  const auto held = [&](float v) {
    return std::min(std::max(v / det, -kMaxCurvature), kMaxCurvature);
  };
  cell.curvature = {held(ux * yy - uy * xy), held(((uy * xx - ux * xy) + (vx * yy - vy * xy)) / 2),
                    held(vy * xx - vx * xy)};
}

void CellModels::gather(const Cell& cell, Candidates& candidates) {
  if (std::abs(grid_.base_distance(cell.id)) < kBasePlaneSight) candidates.add(base_plane(cell.id));
  if (cell.kind == Cell::kOneSided) candidates.add(cell.plane);
  if (cell.has_opposite) candidates.add(cell.opposite);
  for (const auto& [x, y, z] : kNearby.at) {
    if (candidates.full()) return;
    Cell* const other = neighbour(cell, x, y, z);
    if (other == nullptr || other->kind == Cell::kBase) continue;
    fit(*other);
    if (other->kind == Cell::kSmooth) {
      find_curvature(*other);
      candidates.add(extrapolated(*other, -x, -y, -z));
      continue;
    }
    if (other->kind == Cell::kOneSided) candidates.add(other->plane.from(-x, -y, -z));
    if (other->has_opposite) candidates.add(other->opposite.from(-x, -y, -z));
    if (!other->model.solved || std::max({std::abs(x), std::abs(y), std::abs(z)}) > 1) continue;
    for (int p = 0; p < other->model.planes(); ++p) {
      candidates.add(other->model.plane[p].from(-x, -y, -z));
    }
  }
  candidates.add(cell.plane);
}

}  // namespace soilvdb::inline v0
