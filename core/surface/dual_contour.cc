// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface/dual_contour.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/constants.h"
#include "core/surface/dual_cell.h"
#include "core/surface/edge_crossing.h"

namespace soilvdb::inline v0 {
namespace {

/// One dual cell that the surface runs through.
struct DualCell {
  std::int8_t group[12];  ///< of an edge that is crossed; -1
  std::uint32_t vertex;   ///< of group 0; those of the others follow
};

class Contouring {
 public:
  Contouring(const CellModels& models, int range)
      : models_(models), grid_(models.grid()), range_(range) {
    soil_.resize(grid_.cells());
    const std::uint8_t* const counts = grid_.counts();
    for (std::size_t k = 0; k < grid_.cells(); ++k) soil_[k] = counts[k] > 32;
    for (const CellModels::Cell& c : models.cells()) {
      if (c.model.solved) soil_[static_cast<std::size_t>(c.id)] = c.model.soil();
    }
    dual_.assign(grid_.cells(), -1);
  }

  Contour run() {
    const Coord3& sides = grid_.sides();
    const int sx = grid_.step(0), sy = grid_.step(1);
    const auto row = [&](int id) {
      std::uint64_t eight;
      std::memcpy(&eight, &soil_[static_cast<std::size_t>(id)], sizeof(eight));
      return eight;
    };
    // Eight voxels at a time; no polygon of the box's outermost cells is wanted.
    for (int x = 1; x < sides.x() - 1; ++x) {
      for (int y = 1; y < sides.y() - 1; ++y) {
        for (int z = 0; z + kChunkSide < sides.z(); z += kChunkSide) {
          const int first = grid_.id(x, y, z);
          const std::uint64_t here = row(first);
          if (here == row(first + sx) && here == row(first + sy) && here == row(first + 1))
            continue;
          for (int k = std::max(z, 1); k < z + kChunkSide; ++k) {
            const int id = grid_.id(x, y, k);
            const std::uint8_t soil = soil_[static_cast<std::size_t>(id)];
            for (int axis = 0; axis < 3; ++axis) {
              if (soil_[static_cast<std::size_t>(id + grid_.step(axis))] != soil &&
                  wanted({x, y, k}, axis)) {
                polygon(id, axis, soil);
              }
            }
          }
        }
      }
    }
    return std::move(out_);
  }

 private:
  bool wanted(const Coord3& cell, int axis) const {
    const Coord3 next = cell + Coord3::Unit(axis);
    if (range_ == 0) {
      return grid_.resident(cell) ? grid_.asked(cell) : grid_.asked(next);
    }
    return grid_.away(cell) < range_;
  }

  int corner_id(int cell, int corner) const {
    return cell + (corner & 1) * grid_.step(0) + (corner >> 1 & 1) * grid_.step(1) +
           (corner >> 2) * grid_.step(2);
  }

  /// True if the middle of an ambiguous face is in soil, by the models of its four cells.
  bool soil_between(int cell, int face) const {
    const int axis = face / 2, u = kNext[axis], v = kNextButOne[axis];
    float sum = 0;
    for (const int corner : kFaces.corner[face]) {
      float p[3] = {0, 0, 0};
      p[u] = corner >> u & 1 ? -0.5f : 0.5f;
      p[v] = corner >> v & 1 ? -0.5f : 0.5f;
      const float distance = models_.signed_distance(corner_id(cell, corner), p[0], p[1], p[2]);
      sum += std::min(std::max(distance, -0.5f), 0.5f);
    }
    return sum < 0;
  }

  bool soil(int cell, int corner) const {
    return soil_[static_cast<std::size_t>(corner_id(cell, corner))];
  }

  /// All four edges of a face are crossed.
  bool ambiguous(int cell, int face) const {
    const int* const c = kFaces.corner[face];
    const bool a = soil(cell, c[0]);
    return soil(cell, c[1]) != a && soil(cell, c[2]) == a && soil(cell, c[3]) != a;
  }

  const DualCell& dual_cell(int cell) {
    int& index = dual_[static_cast<std::size_t>(cell)];
    if (index >= 0) return duals_[static_cast<std::size_t>(index)];
    index = static_cast<int>(duals_.size());
    DualCell dual;
    unsigned corners = 0;
    for (int c = 0; c < 8; ++c) corners |= static_cast<unsigned>(soil(cell, c)) << c;
    std::array<std::int8_t, 12> group = kSheets.of[corners].group;
    if (kSheets.of[corners].ambiguous) {
      unsigned between = 0;
      for (int f = 0; f < 6; ++f) {
        if (ambiguous(cell, f)) between |= static_cast<unsigned>(soil_between(cell, f)) << f;
      }
      group = sheets(corners, between);
    }
    dual.vertex = static_cast<std::uint32_t>(out_.vertices.size());
    std::fill_n(dual.group, 12, std::int8_t{-1});
    std::int8_t groups = 0;
    bool base = true;
    for (int k = 0; k < 8; ++k) base &= models_.base(corner_id(cell, k));
    for (int e = 0; e < 12; ++e) {
      if (group[static_cast<std::size_t>(e)] < 0 || dual.group[e] >= 0) continue;
      Crossing crossings[12];
      int n = 0;
      for (int k = e; k < 12; ++k) {
        if (group[static_cast<std::size_t>(k)] != group[static_cast<std::size_t>(e)]) continue;
        dual.group[k] = groups;
        const int corner = low_corner(k);
        crossings[n] = edge_crossing(models_, soil_.data(), corner_id(cell, corner), k / 4);
        for (int a = 0; a < 3; ++a) crossings[n].p[a] += static_cast<float>(corner >> a & 1);
        ++n;
      }
      ContourVertex v{grid_.at(cell), {}, base};
      place_vertex(crossings, n, v.in);
      if (groups > 0) keep_apart(crossings, n, dual.vertex, v);
      if (!base) {
        // Neighbours' vertices may be at one point of a crease that lies on the lattice, and would
        // be welded: odd and even cells lean apart.
        for (int a = 0; a < 3; ++a) v.in[a] += v.cell[a] & 1 ? kVertexLean : -kVertexLean;
      }
      out_.vertices.push_back(v);
      ++groups;
    }
    duals_.push_back(dual);
    return duals_.back();
  }

  /// Two sheets of one dual cell must not share a place: a sheet then moves half-way to the middle
  /// of its own crossings.
  void keep_apart(const Crossing* crossings, int count, std::uint32_t first,
                  ContourVertex& v) const {
    bool close = false;
    for (std::size_t k = first; k < out_.vertices.size(); ++k) {
      const float* const other = out_.vertices[k].in;
      float most = 0;
      for (int a = 0; a < 3; ++a) most = std::max(most, std::abs(v.in[a] - other[a]));
      close |= most < kMinSheetGap;
    }
    if (!close) return;
    for (int a = 0; a < 3; ++a) {
      float mean = 0;
      for (int k = 0; k < count; ++k) mean += crossings[k].p[a];
      v.in[a] = (v.in[a] + mean / static_cast<float>(count)) / 2;
    }
  }

  std::uint32_t vertex(int cell, int edge) {
    const DualCell& d = dual_cell(cell);
    return d.vertex + static_cast<std::uint32_t>(d.group[edge]);
  }

  /// A face on which two segments join the same two vertices: each then gets its own vertex between
  /// them. ~0 on other faces.
  std::uint32_t face_vertex(int cell, int face, int edge) {
    if (!ambiguous(cell, face)) return ~0u;
    const int axis = face / 2;
    const int beyond = cell + (face & 1 ? 1 : -1) * grid_.step(axis);
    const int* const c = kFaces.corner[face];
    int edges[4];
    for (int k = 0; k < 4; ++k) edges[k] = edge_between(c[k], c[(k + 1) & 3]);
    const auto one_vertex = [&](int of, int flip) {
      const std::uint32_t first = vertex(of, edges_flipped(edges[0], axis, flip));
      for (int k = 1; k < 4; ++k) {
        if (vertex(of, edges_flipped(edges[k], axis, flip)) != first) return false;
      }
      return true;
    };
    if (!one_vertex(cell, 0) || !one_vertex(beyond, 1)) return ~0u;
    const bool around_first = soil(cell, c[0]) != soil_between(cell, face);
    int k = 0;
    while (edges[k] != edge) ++k;
    // Segments: edges 3 and 0, 1 and 2; or 0 and 1, 2 and 3.
    const int segment = around_first ? (k == 0 || k == 3 ? 0 : 1) : (k < 2 ? 0 : 1);
    const int low = face & 1 ? beyond : cell;  // the cell whose low face it is
    const std::array<int, 3> key{low, axis, segment};
    for (const auto& [known, v] : face_vertices_) {
      if (known == key) return v;
    }
    const int ends[2] = {
        around_first ? (segment == 0 ? edges[3] : edges[1]) : edges[2 * segment],
        around_first ? (segment == 0 ? edges[0] : edges[2]) : edges[2 * segment + 1]};
    ContourVertex v{grid_.at(low), {0, 0, 0}, false};
    for (const int e : ends) {
      const int corner = low_corner(e);
      const Crossing at = edge_crossing(models_, soil_.data(), corner_id(cell, corner), e / 4);
      for (int a = 0; a < 3; ++a) {
        v.in[a] += (at.p[a] + (a == axis ? 0.0f : static_cast<float>(corner >> a & 1))) / 2;
      }
    }
    const std::uint32_t index = static_cast<std::uint32_t>(out_.vertices.size());
    out_.vertices.push_back(v);
    face_vertices_.push_back({key, index});
    return index;
  }

  /// The same edge as seen from the dual cell beyond a face across an axis.
  static int edges_flipped(int edge, int axis, int flip) {
    if (flip == 0) return edge;
    const int a = low_corner(edge) ^ 1 << axis;
    return edge_between(a, a | 1 << (edge / 4));
  }

  Vec3 place(std::uint32_t v) const {
    const ContourVertex& c = out_.vertices[v];
    return c.cell.cast<double>() + Vec3(c.in[0], c.in[1], c.in[2]);
  }

  void polygon(int id, int axis, bool soil_below) {
    const int p = kNext[axis], q = kNextButOne[axis];
    const int sp = grid_.step(p), sq = grid_.step(q);
    // Around the edge, counter-clockwise seen from its far end; which of their edges it is.
    const int cells[4] = {id - sp - sq, id - sq, id, id - sp};
    const int edges[4] = {4 * axis + 3, 4 * axis + 2, 4 * axis, 4 * axis + 1};
    // The faces from each to the next, of the first: high p, high q, low p, low q.
    const int faces[4] = {2 * p + 1, 2 * q + 1, 2 * p, 2 * q};
    std::uint32_t ring[8];
    int n = 0, pivot = -1;
    for (int k = 0; k < 4; ++k) {
      ring[n++] = vertex(cells[k], edges[k]);
      const std::uint32_t between = face_vertex(cells[k], faces[k], edges[k]);
      if (between != ~0u) {
        pivot = n;
        ring[n++] = between;
      }
    }
    if (!soil_below) std::reverse(ring, ring + n);
    if (pivot >= 0) {
      if (!soil_below) pivot = n - 1 - pivot;
      for (int k = 1; k + 1 < n; ++k) {
        out_.triangles.push_back({ring[pivot], ring[(pivot + k) % n], ring[(pivot + k + 1) % n]});
      }
      out_.edges.resize(out_.triangles.size(), id);
      return;
    }
    split(id, axis, ring);
    out_.edges.resize(out_.triangles.size(), id);
  }

  /// Two triangles of four vertices: those that come nearer to the crossing, if they have area.
  void split(int id, int axis, const std::uint32_t* ring) {
    const Crossing at = edge_crossing(models_, soil_.data(), id, axis);
    const Vec3 on = grid_.at(id).cast<double>() + Vec3(at.p[0], at.p[1], at.p[2]);
    Vec3 v[4];
    for (int k = 0; k < 4; ++k) v[k] = place(ring[k]) - on;
    const int p = kNext[axis], q = kNextButOne[axis];
    double gap[2], least[2];
    for (int d = 0; d < 2; ++d) {
      const Vec3 &a = v[d], &b = v[d + 1], &c = v[d + 2], &e = v[(d + 3) & 3];
      const Vec3 first = (b - a).cross(c - a), second = (c - a).cross(e - a);
      const double side = a[p] * (c[q] - a[q]) - a[q] * (c[p] - a[p]);
      const double side_b = (b - a)[p] * (c[q] - a[q]) - (b - a)[q] * (c[p] - a[p]);
      // The crossing is at 0: which side of the diagonal it is on, seen along the edge.
      const Vec3& n = -side * side_b > 0 ? first : second;
      const double length = n.norm();
      gap[d] = length > 0 ? std::abs(n.dot(a)) / length : 1;
      least[d] = std::min(first.squaredNorm(), second.squaredNorm());
    }
    int d = gap[1] < gap[0] - kDiagonalTolerance ? 1 : 0;
    if (std::abs(gap[1] - gap[0]) <= kDiagonalTolerance) {
      d = (v[1] - v[3]).squaredNorm() < (v[0] - v[2]).squaredNorm() ? 1 : 0;
    }
    if (least[d] < kMinSplitArea * kMinSplitArea && least[1 - d] > least[d]) d = 1 - d;
    out_.triangles.push_back({ring[d], ring[d + 1], ring[d + 2]});
    out_.triangles.push_back({ring[d], ring[d + 2], ring[(d + 3) & 3]});
  }

  const CellModels& models_;
  const CellGrid& grid_;
  int range_;
  std::vector<std::uint8_t> soil_;
  std::vector<int> dual_;
  std::vector<DualCell> duals_;
  std::vector<std::pair<std::array<int, 3>, std::uint32_t>> face_vertices_;
  Contour out_;
};

}  // namespace

Contour contour(const CellModels& models, int range) { return Contouring(models, range).run(); }

}  // namespace soilvdb::inline v0
