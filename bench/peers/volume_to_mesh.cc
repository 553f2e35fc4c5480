// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The block's chunks and those around them go into a tree of one node, which spares volumeToMesh
// the tables of the usual one. Each of its quads goes round an edge of the grid; the edges of the
// quads about a vertex are those of its sheet, and there the planes cross that it is placed on.
#include "bench/peers/volume_to_mesh.h"

#include <openvdb/openvdb.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <cmath>
#include <ctime>

#include "core/lattice/chunk_math.h"
#include "core/surface/sheet_vertex.h"
#include "core/surface/surface.h"

namespace soilvdb::bench {
namespace {

using Tree = openvdb::tree::Tree3<float, 4, 3>::Type;

constexpr int kReach = 2;    // voxels from a chunk whose signs matter to the patterns of its cells
constexpr int kOffset = 64;  // of the tree: all its places are floats of one exponent

constexpr int kRounds = 2;  // of repair; each looks one voxel farther

/// Is each cell's centre in soil?
using Signs = std::vector<std::uint8_t>;

/// Where the models say that the edge from a cell along an axis is crossed: the nearer one.
Crossing crossing(const CellModels& models, const Signs& soil, int id, int axis) {
  const float out = soil[static_cast<std::size_t>(id)] ? 1 : -1;
  Crossing c{{0, 0, 0}, {0, 0, 0}};
  c.p[axis] = 0.5f;
  c.n[axis] = out;
  float nearest = 2;
  for (int end = 0; end < 2; ++end) {
    const int here = id + end * models.grid().step(axis);
    const CellModel* const m = models.find(here);
    float slack = 1e-3f;
    if (m != nullptr) {
      const float centre = m->at(0, 0, 0).signed_distance;
      if ((centre < 0) != (soil[static_cast<std::size_t>(here)] != 0))
        slack = std::abs(centre) + 1e-3f;
    }
    for (int k = 0; m != nullptr && k < m->planes(); ++k) {
      const float n[3] = {m->plane[k].nx, m->plane[k].ny, m->plane[k].nz};
      if (!(out * n[axis] > 1e-6f)) continue;
      float q[3] = {0, 0, 0};
      q[axis] = m->plane[k].d / n[axis];
      const float at = q[axis] + static_cast<float>(end);
      if (!(at >= -slack && at <= 1 + slack) || std::abs(q[axis]) >= nearest ||
          std::abs(m->at(q[0], q[1], q[2]).signed_distance) > 1e-3f)
        continue;
      nearest = std::abs(q[axis]);
      c.p[axis] = std::min(std::max(at, -slack), 1.0f + slack);
      std::copy_n(n, 3, c.n);
    }
  }
  return c;
}

class Block {
 public:
  Block(const Ground& ground, std::span<const Coord3> chunks, VolumeToMesh how,
        VolumeToMeshTimes& times)
      : ground_(ground), cells_(ground, chunks, 1) {
    std::clock_t last = std::clock();
    const auto took = [&](double& sum) {
      const std::clock_t now = std::clock();
      sum += static_cast<double>(now - last) / CLOCKS_PER_SEC;
      last = now;
    };
    if (how == VolumeToMesh::kPlanes) models_ = std::make_unique<CellModels>(cells_, kReach);
    if (how == VolumeToMesh::kRepaired)
      models_ = std::make_unique<CellModels>(cells_, kReach + kRounds);
    if (models_) sign(how == VolumeToMesh::kRepaired);
    took(times.models);
    fill();
    took(times.field);
    openvdb::tools::volumeToMesh(*grid_, points_, quads_);
    took(times.topology);
    place();
    took(times.vertices);
    ++times.calls;
  }

  const Mesh& mesh() const { return mesh_; }

 private:
  bool is_near(const Coord3& c) const {
    return (c.array() >= 0).all() && (c.array() < cells_.sides().array()).all() &&
           cells_.away(c) <= kChunkSide;
  }

  /// @param repair no face of voxel centres is to have soil in two opposite corners alone, if that
  ///        can be: the models say what its middle is, and the corner unlike that which is nearest
  ///        to the surface changes
  void sign(bool repair) {
    soil_at_.resize(cells_.cells());
    const std::uint8_t* const counts = cells_.counts();
    for (std::size_t k = 0; k < soil_at_.size(); ++k) soil_at_[k] = counts[k] > 32;
    for (const CellModels::Cell& c : models_->cells())
      if (c.model.solved) soil_at_[static_cast<std::size_t>(c.id)] = c.model.soil();
    for (int round = 0; repair && round < kRounds; ++round) {
      std::vector<int> changed;
      for (const CellModels::Cell& c : models_->cells()) {
        if (c.away > kReach + kRounds) continue;
        // The faces about this centre: three directions, four faces each.
        for (int face = 0; face < 12; ++face) unlike(c.id, face, changed);
      }
      for (const int id : changed) soil_at_[static_cast<std::size_t>(id)] ^= 1;
    }
  }

  /// Adds a centre to those that change, if it is the nearest of an ambiguous face.
  void unlike(int id, int face, std::vector<int>& changed) {
    const int u = face / 4, v = (u + 1) % 3;
    const int su = (face & 1 ? 1 : -1) * cells_.step(u), sv = (face & 2 ? 1 : -1) * cells_.step(v);
    const int corners[4] = {id, id + su, id + su + sv, id + sv};
    const auto soil = [&](int k) { return soil_at_[static_cast<std::size_t>(corners[k])] != 0; };
    if (soil(0) == soil(1) || soil(0) != soil(2) || soil(1) != soil(3)) return;
    float sum = 0;
    for (int k = 0; k < 4; ++k) {
      float p[3] = {0, 0, 0};
      const bool far_u = k == 1 || k == 2, far_v = k >= 2;
      p[u] = (face & 1 ? 0.5f : -0.5f) * (far_u ? -1.0f : 1.0f);
      p[v] = (face & 2 ? 0.5f : -0.5f) * (far_v ? -1.0f : 1.0f);
      sum += std::clamp(models_->signed_distance(corners[k], p[0], p[1], p[2]), -0.5f, 0.5f);
    }
    if (soil(0) == (sum < 0)) return;  // like the middle
    const float here = std::abs(models_->signed_distance(corners[0], 0, 0, 0)),
                there = std::abs(models_->signed_distance(corners[2], 0, 0, 0));
    if (here < there || (here == there && corners[0] < corners[2]))
      if (changed.empty() || changed.back() != id) changed.push_back(id);
  }

  void fill() {
    std::vector<Coord3> near, chunks;
    for (int n = 0; n < 216; ++n) {
      const Coord3 c = kChunkSide * Coord3(n / 36, n / 6 % 6, n % 6);
      if (!is_near(c)) continue;
      near.push_back(c);
      chunks.push_back(cells_.first() + c);
    }
    // Together: surface_distances() would look around each of 27 blocks anew.
    std::unique_ptr<SurfaceBlock> surface;
    if (!models_)
      surface = std::make_unique<SurfaceBlock>(ground_, chunks, SurfaceBlock::kDistance);
    const float far = models_ ? 1.0f : static_cast<float>(ground_.band_m());
    grid_ = openvdb::Grid<Tree>::create(far);
    grid_->setGridClass(openvdb::GRID_LEVEL_SET);
    for (std::size_t i = 0; i < near.size(); ++i) {
      float phi[kChunkVoxels];
      if (surface) surface->distance(chunks[i], phi);
      for (int n = 0; models_ && n < kChunkVoxels; ++n) {
        const Coord3 c = near[i] + numbered_voxel(n);
        phi[n] = soil_at_[static_cast<std::size_t>(cells_.id(c.x(), c.y(), c.z()))] ? -1.0f : 1.0f;
      }
      add(near[i], phi, far);
    }
  }

  void add(const Coord3& chunk, const float* phi, float far) {
    const auto place = [](const Coord3& c) {
      return openvdb::Coord(c.x() + kOffset, c.y() + kOffset, c.z() + kOffset);
    };
    // Soil is in leaves: volumeToMesh doesn't look between two tiles.
    if (std::any_of(phi, phi + kChunkVoxels, [&](float v) { return v < far; })) {
      auto* leaf = new Tree::LeafNodeType(place(chunk), far, true);
      const float least = 1e-4f * far;  // no voxel is on the surface: points are in their dual cell
      for (openvdb::Index n = 0; n < kChunkVoxels; ++n)
        leaf->setValueOnly(n, phi[n] < 0 ? std::min(phi[n], -least) : std::max(phi[n], least));
      grid_->tree().addLeaf(leaf);
    }
    // Around them tiles like the middles of their faces: fewer quads that nobody wants.
    for (int face = 0; face < 6; ++face) {
      const Coord3 out = (face & 1 ? 1 : -1) * Coord3::Unit(face / 2);
      const Coord3 in = Coord3::Constant(4) + 4 * out.cwiseMin(0) + 3 * out.cwiseMax(0);
      const Coord3 next = chunk + kChunkSide * out;
      if (phi[in.x() * 64 + in.y() * 8 + in.z()] < 0 && !is_near(next))
        grid_->tree().addTile(1, place(next), -far, false);
    }
  }

  Coord3 cell(std::uint32_t v) const {
    const openvdb::Vec3s& p = points_[v];
    return Coord3(static_cast<int>(p[0]), static_cast<int>(p[1]), static_cast<int>(p[2])) -
           Coord3::Constant(kOffset);
  }

  /// The polygon belongs to the block as in Contour.
  bool wanted(const Coord3& c, int axis) const {
    if ((c.array() < kChunkSide - 1).any() ||
        (c.array() >= cells_.sides().array() - kChunkSide).any())
      return false;
    return cells_.resident(c) ? cells_.asked(c) : cells_.asked(c + Coord3::Unit(axis));
  }

  void place() {
    edges_.resize(points_.size());
    in_.resize(points_.size());
    std::vector<std::pair<int, const openvdb::Vec4I*>> kept;  // by edge
    for (const openvdb::Vec4I& q : quads_) {
      Coord3 low = cell(q[0]), high = low;
      for (int k = 1; k < 4; ++k) {
        low = low.cwiseMin(cell(q[k]));
        high = high.cwiseMax(cell(q[k]));
      }
      const int axis = low.x() == high.x() ? 0 : low.y() == high.y() ? 1 : 2;
      const int edge = 3 * cells_.id(high.x(), high.y(), high.z()) + axis;
      const bool keep = wanted(high, axis);
      for (int k = 0; k < 4; ++k) {
        Edges& e = edges_[q[k]];
        e.edge[e.n++] = edge;
        e.used |= keep;
      }
      if (keep) kept.push_back({edge, &q});
    }
    std::vector<std::uint32_t> number(points_.size());
    for (std::uint32_t v = 0, end = 0; v < points_.size(); v = end) {
      bool used = false;  // any sheet of the cell: they keep apart
      for (end = v; end < points_.size() && cell(end) == cell(v); ++end) used |= edges_[end].used;
      for (std::uint32_t k = v; used && k < end; ++k) {
        for (int a = 0; a < 3; ++a) in_[k][a] = points_[k][a] - std::floor(points_[k][a]);
        if (models_) move(k, v);
        number[k] = static_cast<std::uint32_t>(mesh_.points.size());
        const Vec3 p = (cells_.first() + cell(k)).cast<double>() + in_[k].cast<double>();
        if (edges_[k].used) mesh_.points.push_back((ground_.voxel_size_m() * p).cast<float>());
      }
    }
    for (const auto& [edge, q] : kept) {
      const int d = diagonal(edge, *q);
      std::uint32_t r[4];
      for (int k = 0; k < 4; ++k) r[k] = number[(*q)[3 - ((k + d) & 3)]];
      mesh_.triangles.insert(mesh_.triangles.end(), {{r[0], r[1], r[2]}, {r[0], r[2], r[3]}});
    }
  }

  /// A vertex onto the planes, away from those of its cell from `first` on, with the lean of ours.
  void move(std::uint32_t v, std::uint32_t first) {
    Edges& e = edges_[v];
    std::sort(e.edge, e.edge + e.n);
    Crossing crossings[12];
    Eigen::Vector3f middle = Eigen::Vector3f::Zero(), &in = in_[v];
    for (int k = 0; k < e.n; ++k) {
      crossings[k] = crossing(*models_, soil_at_, e.edge[k] / 3, e.edge[k] % 3);
      const Coord3 from = cells_.at(e.edge[k] / 3) - cell(v);
      for (int a = 0; a < 3; ++a) middle[a] += crossings[k].p[a] += static_cast<float>(from[a]);
    }
    place_vertex(crossings, e.n, in.data());
    bool close = false;
    for (std::uint32_t k = first; k < v; ++k) close |= (in - in_[k]).cwiseAbs().maxCoeff() < 0.02f;
    if (close) in = (in + middle / static_cast<float>(e.n)) / 2;
    for (int a = 0; a < 3; ++a) in[a] += cell(v)[a] & 1 ? 1e-4f : -1e-4f;
  }

  /// The corner where the diagonal begins that comes nearer to the crossing, or is the shorter
  /// one, and leaves no triangle without area.
  int diagonal(int edge, const openvdb::Vec4I& q) const {
    const int axis = edge % 3, a = (axis + 1) % 3, b = (axis + 2) % 3;
    Vec3 v[4];
    for (int k = 0; k < 4; ++k) {
      v[k] = (cell(q[3 - k]) - cells_.at(edge / 3)).cast<double>() + in_[q[3 - k]].cast<double>();
      if (models_) v[k][axis] -= crossing(*models_, soil_at_, edge / 3, axis).p[axis];
    }
    double gap[2], least[2];
    for (int d = 0; d < 2; ++d) {
      const Vec3 along = v[d + 2] - v[d], next = v[d + 1] - v[d];
      const Vec3 one = next.cross(along), two = along.cross(v[(d + 3) & 3] - v[d]);
      const bool beside =
          (v[d][b] * along[a] - v[d][a] * along[b]) * (next[a] * along[b] - next[b] * along[a]) > 0;
      gap[d] = models_ ? std::abs((beside ? one : two).normalized().dot(v[d])) : 0;
      least[d] = std::min(one.norm(), two.norm());
    }
    int best = gap[1] < gap[0] ? 1 : 0;
    if (std::abs(gap[1] - gap[0]) <= 1e-4)
      best = (v[1] - v[3]).norm() < (v[0] - v[2]).norm() ? 1 : 0;
    return least[best] < 1e-3 && least[1 - best] > least[best] ? 1 - best : best;
  }

  struct Edges {
    int n = 0, edge[12];
    bool used = false;  // by a quad that is kept
  };
  const Ground& ground_;
  CellGrid cells_;
  std::unique_ptr<CellModels> models_;
  Signs soil_at_;
  openvdb::Grid<Tree>::Ptr grid_;
  std::vector<openvdb::Vec3s> points_;
  std::vector<openvdb::Vec4I> quads_;
  std::vector<Edges> edges_;         // of a vertex
  std::vector<Eigen::Vector3f> in_;  // its dual cell, voxels
  Mesh mesh_;
};

}  // namespace

Mesh volume_to_mesh(const Ground& ground, const Coord3& block, VolumeToMesh how,
                    VolumeToMeshTimes& times) {
  const std::vector<Coord3> chunks = resident_chunks(ground, block);
  return chunks.empty() ? Mesh{} : Block(ground, chunks, how, times).mesh();
}

}  // namespace soilvdb::bench
