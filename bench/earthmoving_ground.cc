// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>

#include <algorithm>

#include "bench/earthmoving.h"
#include "bench/site.h"
#include "core/ground/ground_writer.h"
#include "tests/support/ground_window.h"

namespace soilvdb::bench {
namespace {

class Posts final : public HeightSource {
 public:
  Posts(const HeightGrid& grid, Shape shape) : grid_(grid), shape_(std::move(shape)) {}
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y) {
      for (int x = x0; x < x0 + nx; ++x)
        *out++ = static_cast<float>(shape_(grid_.first.x() + x * grid_.spacing.x(),
                                           grid_.first.y() + y * grid_.spacing.y()));
    }
  }

 private:
  HeightGrid grid_;
  Shape shape_;
};

/// Calls f(chunk, below, above) with the samples of a box below and above a shape.
template <class F>
void each_chunk(const Ground& ground, const Eigen::AlignedBox3d& box_m, const Shape& shape_m,
                const F& f) {
  const auto chunk_of = [&](const Vec3& p) {
    return Coord3((ground.index_from_world(p) / kChunkSide).array().floor().cast<int>() *
                  kChunkSide);
  };
  const Coord3 low = chunk_of(box_m.min()), high = chunk_of(box_m.max());
  for (int x = low.x(); x <= high.x(); x += kChunkSide) {
    for (int y = low.y(); y <= high.y(); y += kChunkSide) {
      for (int z = low.z(); z <= high.z(); z += kChunkSide) {
        SampleWords below{}, above{};
        for (std::size_t v = 0; v < below.size(); ++v) {
          const int n = static_cast<int>(v);
          const Coord3 voxel(x + n / 64, y + n / 8 % 8, z + n % 8);
          const CellPoints& points = sample_points(voxel);
          for (int i = 0; i < 64; ++i) {
            const Vec3 in_cell(points.x[i], points.y[i], points.z[i]);
            const Vec3 p =
                ground.world_from_index(voxel.cast<double>() + in_cell - Vec3::Constant(0.5));
            if (!box_m.contains(p)) continue;
            (p.z() < shape_m(p.x(), p.y()) ? below : above)[v] |= std::uint64_t{1} << i;
          }
        }
        f(Coord3(x, y, z), below, above);
      }
    }
  }
}

}  // namespace

Earthmoving loam(std::vector<Pour> pours) {
  return {SoilProperties{kRepose, 0.25, 1800, {}, {}}, std::move(pours), {}};
}

Bucket digger() {
  Bucket bucket = excavator_bucket();
  const double h = bucket.height_m;
  bucket.profile = {
      {0, 0}, {-0.5 * h, -0.1 * h}, {-0.95 * h, 0.2 * h}, {-1.05 * h, 0.6 * h}, {-0.75 * h, h},
      {0, h}};
  return bucket;
}

std::int64_t residual(const Tracker& tracker) {
  const MassBalance balance = tracker.mass_balance();
  return balance.ground + tracker.total().load + balance.pending + balance.hauled - balance.poured;
}

std::shared_ptr<const InitialTerrain> posts(const Shape& shape, const Eigen::AlignedBox2d& box_m,
                                            double spacing_m) {
  HeightGrid grid;
  grid.nx = static_cast<int>(std::ceil(box_m.sizes().x() / spacing_m)) + 1;
  grid.ny = static_cast<int>(std::ceil(box_m.sizes().y() / spacing_m)) + 1;
  grid.first = box_m.min();
  grid.spacing = Vec2::Constant(spacing_m);
  return make_height_field(grid, std::make_shared<Posts>(grid, shape));
}

void carve(Ground& ground, const Eigen::AlignedBox3d& box_m, const Shape& shape_m) {
  GroundWriter writer(ground);
  each_chunk(ground, box_m, shape_m,
             [&](const Coord3& chunk, SampleWords below, SampleWords above) {
               writer.remove(chunk, above);
               writer.add(chunk, below);
             });
}

void add_loose(Ground& ground, const Eigen::AlignedBox3d& box_m, const Shape& shape_m) {
  GroundWriter writer(ground);
  each_chunk(ground, box_m, shape_m, [&](const Coord3& chunk, SampleWords below, SampleWords) {
    writer.add(chunk, below, GroundWriter::Kind::kLoose);
  });
}

double Heights::at(double x, double y) const {
  const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
  const double u = x - i, v = y - j;
  return (1 - u) * ((1 - v) * cell(i, j) + v * cell(i, j + 1)) +
         u * ((1 - v) * cell(i + 1, j) + v * cell(i + 1, j + 1));
}

Heights heights(const Ground& ground, int x0, int y0, int nx, int ny) {
  const test::GroundWindow window(ground, {x0, y0}, nx, ny);
  Heights all{x0, y0, nx, ny, {}};
  for (int x = 0; x < nx; ++x)
    for (int y = 0; y < ny; ++y) all.z.push_back(window.at(x, y).top);
  return all;
}

Heights heights(const Ground& ground, int half) {
  return heights(ground, -half, -half, 2 * half + 1, 2 * half + 1);
}

Off off(std::vector<double> differences) {
  Off off;
  for (double& d : differences) {
    off.rms += d * d;
    d = std::abs(d);
  }
  off.rms = std::sqrt(off.rms / static_cast<double>(std::max<std::size_t>(differences.size(), 1)));
  off.p99 = quantile(differences, 0.99);
  return off;
}

void add(Goals& goals, const std::string& what, const Off& off, double rms, double p99) {
  goals.add({what + ", heights rms", off.rms, "voxel", rms});
  goals.add({what + ", heights p99", off.p99, "voxel", p99});
}

double median_ms(int times, const std::function<double()>& us) {
  std::vector<double> ms;
  for (int i = 0; i < times; ++i) ms.push_back(us() / 1e3);
  return quantile(ms, 0.5);
}

}  // namespace soilvdb::bench
