// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface/dual_contour.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/surface/sheet_vertex.h"

namespace soilvdb::inline v0 {
namespace {

// Corners of a dual cell are x + 2 y + 4 z, its edges 4 axis + p + 2 q, where p and q are 0 or 1
// along the next two axes, its faces 2 axis + side.
constexpr int kNext[3] = {1, 2, 0}, kNextButOne[3] = {2, 0, 1};

constexpr int low_corner(int edge) {
  const int axis = edge / 4;
  return (edge & 1) << kNext[axis] | (edge >> 1 & 1) << kNextButOne[axis];
}

/// The edge of a dual cell between two corners that differ in one axis.
constexpr int edge_between(int a, int b) {
  const int axis = (a ^ b) == 1 ? 0 : (a ^ b) == 2 ? 1 : 2, low = a & b;
  return 4 * axis + (low >> kNext[axis] & 1) + 2 * (low >> kNextButOne[axis] & 1);
}

/// The corners of each face in turn around it.
struct Faces {
  int corner[6][4];
  constexpr Faces() : corner() {
    for (int f = 0; f < 6; ++f) {
      const int axis = f / 2, base = (f & 1) << axis;
      const int p = 1 << kNext[axis], q = 1 << kNextButOne[axis];
      corner[f][0] = base;
      corner[f][1] = base | p;
      corner[f][2] = base | p | q;
      corner[f][3] = base | q;
    }
  }
};
constexpr Faces kFaces;

/// Joins the edges that are crossed to sheets, by segments on the faces. @param corners in soil
/// @param between faces whose middle is in soil, of those all of whose edges are crossed
constexpr std::array<std::int8_t, 12> sheets(unsigned corners, unsigned between) {
  std::array<std::int8_t, 12> group{};
  const auto soil = [&](int corner) { return (corners >> corner & 1) != 0; };
  for (int e = 0; e < 12; ++e) {
    const int a = low_corner(e), b = a | 1 << (e / 4);
    group[static_cast<std::size_t>(e)] = static_cast<std::int8_t>(soil(a) != soil(b) ? e : -1);
  }
  const auto join = [&](int a, int b) {
    const std::int8_t from = group[static_cast<std::size_t>(b)],
                      to = group[static_cast<std::size_t>(a)];
    for (std::int8_t& g : group) {
      if (g == from) g = to;
    }
  };
  for (int f = 0; f < 6; ++f) {
    const int* const c = kFaces.corner[f];
    int edges[4] = {}, crossed[4] = {}, n = 0;
    for (int k = 0; k < 4; ++k) {
      edges[k] = edge_between(c[k], c[(k + 1) & 3]);
      if (group[static_cast<std::size_t>(edges[k])] >= 0) crossed[n++] = edges[k];
    }
    if (n == 2) join(crossed[0], crossed[1]);
    if (n < 4) continue;
    // Segments cut off the corners that the middle is not like.
    const int k = soil(c[0]) != ((between >> f & 1) != 0) ? 0 : 1;
    join(edges[(k + 3) & 3], edges[k]);
    join(edges[k + 1], edges[(k + 2) & 3]);
  }
  return group;
}

/// The sheets of a dual cell by its corners in soil, where no face is ambiguous.
struct Sheets {
  struct Case {
    std::array<std::int8_t, 12> group{};
    bool ambiguous = false;
  } of[256];
  constexpr Sheets() : of() {
    for (unsigned corners = 0; corners < 256; ++corners) {
      of[corners].group = sheets(corners, 0);
      for (const auto& c : kFaces.corner) {
        const unsigned a = corners >> c[0] & 1;
        of[corners].ambiguous |=
            (corners >> c[1] & 1) != a && (corners >> c[2] & 1) == a && (corners >> c[3] & 1) != a;
      }
    }
  }
};
constexpr Sheets kSheets;

/// One dual cell that the surface runs through.
struct DualCell {
  std::int8_t group[12];  ///< of an edge that is crossed; -1
  std::uint32_t vertex;   ///< of group 0; those of the others follow
};

class Contouring {
 public:
  Contouring(const CellModels& models, int range)
      : models_(models), grid_(models.grid()), range_(range) {
    const std::size_t cells = static_cast<std::size_t>(grid_.side()) * grid_.side() * grid_.side();
    soil_.resize(cells);
    const std::uint8_t* const counts = grid_.counts();
    for (std::size_t k = 0; k < cells; ++k) soil_[k] = counts[k] > 32;
    for (const CellModels::Cell& c : models.cells()) {
      if (c.model.solved) soil_[static_cast<std::size_t>(c.id)] = c.model.soil();
    }
    dual_.assign(cells, -1);
  }

  Contour run() {
    const int side = grid_.side(), sx = grid_.step(0), sy = grid_.step(1);
    const auto row = [&](int id) {
      std::uint64_t eight;
      std::memcpy(&eight, &soil_[static_cast<std::size_t>(id)], sizeof(eight));
      return eight;
    };
    // Eight voxels at a time; no polygon of the cube's outermost cells is wanted.
    for (int x = 1; x < side - 1; ++x) {
      for (int y = 1; y < side - 1; ++y) {
        for (int z = 0; z + kChunkSide < side; z += kChunkSide) {
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

  /// Crossing of the edge from a voxel along an axis, in voxels from that voxel's centre.
  Crossing crossing(int id, int axis) const {
    Crossing seen[2];
    const bool below = seen_from(id, axis, 0, seen[0]);
    const bool above = seen_from(id, axis, 1, seen[1]);
    if (below && above) {
      // Each model is right in its own half.
      const bool first = seen[0].p[axis] <= 0.5f, second = seen[1].p[axis] >= 0.5f;
      if (first != second) return seen[first ? 0 : 1];
      Crossing c;
      float square = 0;
      for (int a = 0; a < 3; ++a) {
        c.p[a] = (seen[0].p[a] + seen[1].p[a]) / 2;
        c.n[a] = seen[0].n[a] + seen[1].n[a];
        square += c.n[a] * c.n[a];
      }
      const float scale = 1 / std::sqrt(std::max(square, 1e-6f));
      for (float& v : c.n) v *= scale;
      return c;
    }
    if (below || above) return seen[below ? 0 : 1];
    Crossing c{{0, 0, 0}, {0, 0, 0}};
    c.p[axis] = 0.5f;
    c.n[axis] = soil_[static_cast<std::size_t>(id)] ? 1.0f : -1.0f;
    return c;
  }

  /// What the model of one end of that edge says. @return false if it says nothing
  bool seen_from(int id, int axis, int end, Crossing& c) const {
    const int here = id + end * grid_.step(axis);
    const CellModel* const m = models_.find(here);
    if (m == nullptr) return false;
    const Active centre = m->at(0, 0, 0);
    // A centre that counts as in a thin wall lies just outside of its face.
    const bool tied = (centre.beyond < 0) != (soil_[static_cast<std::size_t>(here)] != 0);
    const float slack = tied ? kTie : 1e-3f, from = static_cast<float>(end);
    float best = 2;
    for (int p = 0; p < m->planes(); ++p) {
      const CellPlane& plane = m->plane[p];
      const float slope[3] = {plane.nx, plane.ny, plane.nz};
      // Out of soil in the direction in which the signs say so.
      const float outwards = soil_[static_cast<std::size_t>(id)] ? slope[axis] : -slope[axis];
      if (!(outwards > 1e-6f)) continue;
      const float along = plane.d / slope[axis];
      if (!(std::abs(along + from - 0.5f) <= 0.5f + slack)) continue;
      float q[3] = {0, 0, 0};
      q[axis] = along;
      if (std::abs(m->at(q[0], q[1], q[2]).beyond) > slack || std::abs(along) >= best) continue;
      best = std::abs(along);
      q[axis] = tied ? along + from : std::min(std::max(along + from, 0.0f), 1.0f);
      std::copy_n(q, 3, c.p);
      std::copy_n(slope, 3, c.n);
    }
    if (best < 2 || !tied) return best < 2;
    const CellPlane& face = m->plane[centre.plane];
    const float n[3] = {face.nx, face.ny, face.nz};
    for (int a = 0; a < 3; ++a) c.p[a] = -centre.beyond * n[a];
    c.p[axis] += from;
    std::copy_n(n, 3, c.n);
    return true;
  }

  int corner_id(int cell, int corner) const {
    return cell + (corner & 1) * grid_.step(0) + (corner >> 1 & 1) * grid_.step(1) +
           (corner >> 2) * grid_.step(2);
  }

  /// Is the middle of a face in soil, whose corners are so in turn? What the four cells say of it.
  bool soil_between(int cell, int face) const {
    const int axis = face / 2, u = kNext[axis], v = kNextButOne[axis];
    float sum = 0;
    for (const int corner : kFaces.corner[face]) {
      float p[3] = {0, 0, 0};
      p[u] = corner >> u & 1 ? -0.5f : 0.5f;
      p[v] = corner >> v & 1 ? -0.5f : 0.5f;
      const float beyond = models_.beyond(corner_id(cell, corner), p[0], p[1], p[2]);
      sum += std::min(std::max(beyond, -0.5f), 0.5f);
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
        crossings[n] = crossing(corner_id(cell, corner), k / 4);
        for (int a = 0; a < 3; ++a) crossings[n].p[a] += static_cast<float>(corner >> a & 1);
        ++n;
      }
      ContourVertex v{grid_.at(cell), {}, base};
      place_vertex(crossings, n, v.in);
      if (groups > 0) keep_apart(crossings, n, dual.vertex, v);
      if (!base) {
        // Neighbours' vertices may be at one point of a crease that lies on the lattice, and would
        // be welded: odd and even cells lean apart.
        constexpr float kLean = 1e-4f;
        for (int a = 0; a < 3; ++a) v.in[a] += v.cell[a] & 1 ? kLean : -kLean;
      }
      out_.vertices.push_back(v);
      ++groups;
    }
    duals_.push_back(dual);
    return duals_.back();
  }

  /// Sheets of one dual cell don't share a place: half-way to the middle of its own crossings then.
  void keep_apart(const Crossing* crossings, int count, std::uint32_t first,
                  ContourVertex& v) const {
    constexpr float kApart = 0.02f;  // voxels
    bool close = false;
    for (std::size_t k = first; k < out_.vertices.size(); ++k) {
      const float* const other = out_.vertices[k].in;
      float most = 0;
      for (int a = 0; a < 3; ++a) most = std::max(most, std::abs(v.in[a] - other[a]));
      close |= most < kApart;
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

  /// A face on which two segments join the same two vertices: each then gets one of its own between
  /// them. None (~0) on others.
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
      const Crossing at = crossing(corner_id(cell, corner), e / 4);
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
    const Crossing at = crossing(id, axis);
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
    constexpr double kLeastArea = 1e-3, kSame = 1e-4;  // voxels
    int d = gap[1] < gap[0] - kSame ? 1 : 0;
    if (std::abs(gap[1] - gap[0]) <= kSame) {
      d = (v[1] - v[3]).squaredNorm() < (v[0] - v[2]).squaredNorm() ? 1 : 0;
    }
    if (least[d] < kLeastArea * kLeastArea && least[1 - d] > least[d]) d = 1 - d;
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
