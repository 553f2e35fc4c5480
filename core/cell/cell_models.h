// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// From words to planes: the surface in each cell that it crosses.
#pragma once

#include <vector>

#include "core/cell/crease.h"
#include "core/cell/fit_cache.h"

namespace soilvdb::inline v0 {

/// Curvature of a surface: the change of its normal along the tangents of a plane.
struct Curvature {
  float uu = 0, uv = 0, vv = 0;  ///< 1/voxel; of a ball of soil positive
};

/// The models of the cells of a CellGrid: fit_plane() in each cell, solve_crease() where one plane
/// does not explain the samples, then a shift of the planes to the counted volume. Planes that
/// explain all samples need not hold it. Creases are solved for all cells at once, in two sweeps:
/// the order of cells does not matter.
///
/// A cell's model depends only on the words within a chunk of it: not on the grid, the order of its
/// neighbours or threads.
class CellModels {
 public:
  /// @param range largest distance of modelled cells from a requested chunk, voxels
  /// @param cache of earlier grids of any ground; may be null
  CellModels(const CellGrid& grid, int range, FitCache* cache = nullptr);

  /// The model of a cell; null for a cell of all soil or all air, and for one without a solution.
  const CellModel* find(int id) const {
    const int k = index_[static_cast<std::size_t>(id)];
    return k < 0 || !cells_[static_cast<std::size_t>(k)].model.solved
               ? nullptr
               : &cells_[static_cast<std::size_t>(k)].model;
  }
  /// True if the cell's centre is in soil.
  bool soil(int id) const {
    const CellModel* m = find(id);
    return m != nullptr ? m->soil() : grid_.count(id) > 32;
  }
  /// Signed distance at a point relative to a cell's centre, by the model of the cell.
  float signed_distance(int id, float x, float y, float z) const {
    const CellModel* m = find(id);
    return m != nullptr ? m->at(x, y, z).signed_distance : soil(id) ? -0.5f : 0.5f;
  }
  /// True if the cell is undug or has no surface.
  bool base(int id) const {
    const int k = index_[static_cast<std::size_t>(id)];
    return k < 0 || cells_[static_cast<std::size_t>(k)].kind == Cell::kBase;
  }
  const CellGrid& grid() const { return grid_; }

  struct Cell {
    int id = 0;
    int away = 0;
    enum Kind : std::uint8_t {
      kUnfitted,
      kBase,      ///< undug
      kSmooth,    ///< one plane
      kOneSided,  ///< one face of a thin wall
      kOther
    } kind = kUnfitted;
    bool has_curvature = false;  ///< curvature is known
    bool has_opposite = false;   ///< opposite is known
    CellPlane plane;             ///< as fitted: too far inwards where the surface bends
    CellPlane opposite;          ///< the other face of a wall that fills the cell
    Curvature curvature;
    CellModel model;
  };
  const std::vector<Cell>& cells() const { return cells_; }

 private:
  Cell* at(int id) {
    const int k = index_[static_cast<std::size_t>(id)];
    return k < 0 ? nullptr : &cells_[static_cast<std::size_t>(k)];
  }
  Cell* neighbour(const Cell& cell, int x, int y, int z) {
    return at(cell.id + x * grid_.step(0) + y * grid_.step(1) + z);
  }
  void fit(Cell& cell);
  void find_curvature(Cell& cell);
  CellPlane base_plane(int id) const;
  void gather(const Cell& cell, Candidates& candidates);
  CellModel crease(const Cell& cell);
  void solve_creases(int range);
  /// Shifts the planes of each cell so that the models and the words around it have equal volume.
  void conserve_volumes(int range);

  const CellGrid& grid_;
  FitCache* const cache_;
  std::vector<int> index_;
  std::vector<Cell> cells_;
};

}  // namespace soilvdb::inline v0
