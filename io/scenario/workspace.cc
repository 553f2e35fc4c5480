// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/workspace.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <unordered_set>
#include <vector>

#include "core/constants.h"
#include "io/scenario/check_pours.h"
#include "io/scenario/find_step.h"
#include "soilvdb/io/raster.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kBytesPerChunk = 3500;  // a Chunk, its leaf, its share of the tree
constexpr int kCellBits = 21;     // of a cell's coordinate; cells are at least as large as chunks
constexpr int kPointsAcross = 8;  // per side of a mouth, for the estimate of its sweep
constexpr double kMostStepCells = 1e6;  // in one block of steps
constexpr double kMostStrokeM = 1000;   // in soil, from one row to the next
constexpr double kStrideM = 10;         // sampling distance of such a stroke

Eigen::AlignedBox2d plan(const Box3& box) { return {box.min().head<2>(), box.max().head<2>()}; }

/// To two digits.
double rounded_up(double value) {
  const double step = std::pow(10, std::floor(std::log10(value)) - 1);
  return std::ceil(value / step) * step;
}

std::string range(const char* axis, double low, double high) {
  return fmt::format("{} {:.1f} to {:.1f}", axis, low, high);
}

void check_overlap(const Scenario& scenario, const Site& site) {
  Box3 whole;
  if (std::none_of(scenario.machines.begin(), scenario.machines.end(),
                   [](const MachineInput& m) { return m.has_motion(); }))
    return;
  const auto over = [&](const Box3& box) { return site.bounds.intersects(plan(box)); };
  for (const MachineInput& m : scenario.machines) {
    whole.extend(m.swept.whole());
    if (find_step(m, over, [&](const Motion&, const StepBox& step) { return over(step.box); }))
      return;
  }
  throw InputError(
      scenario.file,
      fmt::format("no bucket ever comes over the terrain: the motion runs over {}, {}; the terrain "
                  "covers {}, {}; both must be in the same coordinates",
                  range("x", whole.min().x(), whole.max().x()),
                  range("y", whole.min().y(), whole.max().y()),
                  range("x", site.bounds.min().x(), site.bounds.max().x()),
                  range("y", site.bounds.min().y(), site.bounds.max().y())));
}

void check_distance(const Scenario& scenario, const Site& site, const MachineInput& m) {
  if (!m.has_motion()) return;
  const double h = site.ground->voxel_size_m();
  const Box3 whole = m.swept.whole();
  const Vec3 far = (whole.min() - site.ground->origin())
                       .cwiseAbs()
                       .cwiseMax((whole.max() - site.ground->origin()).cwiseAbs());
  if (far.maxCoeff() < kMaxIndex * h) return;
  throw InputError(
      scenario.file,
      fmt::format("machine '{}' goes {:.0f} m from the site's origin, more than the "
                  "{:g} m that voxels of {:g} m can number; a voxel_size of {:.2g} or "
                  "more would do",
                  m.name, far.maxCoeff(), kMaxIndex * h, h, 1.05 * far.maxCoeff() / kMaxIndex));
}

/// Refuses a stroke that would take hours to dig, and that no machine makes.
void check_strokes(const Site& site, const Scenario& scenario, const MachineInput& m) {
  const auto is_long = [](const Box3& box) { return box.diagonal().norm() > kMostStrokeM; };
  const Corners corners = bucket_corners(m.bucket);
  find_step(m, is_long, [&](const Motion& part, const StepBox& step) {
    const std::vector<double>& times = part.times_s();
    const std::size_t next = std::min(step.row + 1, times.size() - 1);
    const double far_m = (part.row(next).position - part.row(step.row).position).norm();
    if (far_m <= kMostStrokeM) return false;
    Box3 last;
    for (const Pose& pose :
         part.trace(times[step.row], times[next], m.bucket, kStrideM, kStrideM)) {
      const Box3 box = box_at(pose, corners);
      if (!last.isEmpty() && !surely_air(site, box.merged(last)))
        throw InputError(
            scenario.file,
            fmt::format("machine '{}' digs on for {:.0f} m between {:g} s and {:g} s, from one row "
                        "to the next; it must be {} m or less, or above the ground",
                        m.name, far_m, times[step.row], times[next], kMostStrokeM));
      last = box;
    }
    return false;
  });
}

/// Refuses poses over unknown ground, by ever smaller boxes, as the engine does before it digs.
void check_known(const Scenario& scenario, const Site& site, const MachineInput& m) {
  const auto unknown = [&](const Box3& box) { return !surely_known(site, box); };
  find_step(m, unknown, [&](const Motion& part, const StepBox& step) {
    if (!unknown(step.box)) return false;
    const std::vector<double>& times = part.times_s();
    for (const Box3& box : close_boxes(m, part, step.row, site.ground->voxel_size_m())) {
      if (!unknown(box)) continue;
      throw InputError(
          scenario.file,
          fmt::format("machine '{}' reaches ground without a height between {:g} s and {:g} s, "
                      "at {}, {}, {}; a terrain that has heights there would do, or a motion that "
                      "keeps off",
                      m.name, times[step.row], times[std::min(step.row + 1, times.size() - 1)],
                      range("x", box.min().x(), box.max().x()),
                      range("y", box.min().y(), box.max().y()),
                      range("z", box.min().z(), box.max().z())));
    }
    return false;
  });
}

double memory_bytes() {
  return static_cast<double>(::sysconf(_SC_PHYS_PAGES)) *
         static_cast<double>(::sysconf(_SC_PAGESIZE));
}

/// A set of lattice cells, and the volume of those that are not all air.
class SoilCells {
 public:
  SoilCells(const Ground& ground, double cell_m) : ground_(ground), cell_m_(cell_m) {}

  double volume_m3() const { return volume_m3_; }

  /// Marks the cell that holds a point of the world.
  void mark(const Vec3& p) { mark_cell(cell_of(p)); }

  /// Marks all cells that meet a box. @return false if there are too many
  bool mark(const Box3& box) {
    const Eigen::Array3d low = cell_of(box.min()), high = cell_of(box.max());
    if ((high - low + 1).prod() > kMostStepCells) return false;
    Eigen::Array3d c;
    for (c.x() = low.x(); c.x() <= high.x(); ++c.x())
      for (c.y() = low.y(); c.y() <= high.y(); ++c.y())
        for (c.z() = low.z(); c.z() <= high.z(); ++c.z()) mark_cell(c);
    return true;
  }

 private:
  Eigen::Array3d cell_of(const Vec3& p) const {
    return ((p - ground_.origin()).array() / cell_m_).floor();
  }
  void mark_cell(const Eigen::Array3d& cell) {
    std::uint64_t key = 0;
    for (const double c : {cell.x(), cell.y(), cell.z()})
      key = key << kCellBits | static_cast<std::uint64_t>(c + (1 << (kCellBits - 1)));
    if (!seen_.insert(key).second) return;
    const Vec3 low = ground_.origin() + Vec3(cell * cell_m_);
    if (ground_.terrain().classify({low, low + Vec3::Constant(cell_m_)}) == Content::kAir) return;
    volume_m3_ += cell_m_ * cell_m_ * cell_m_;
  }

  const Ground& ground_;
  double cell_m_, volume_m3_ = 0;
  std::unordered_set<std::uint64_t> seen_;
};

/// Upper bound of the dug soil: cells twice a bucket's size around the blocks of its way.
double reached_soil_m3(const Site& site, const MachineInput& m, double chunk_m, double enough_m3) {
  SoilCells cells(*site.ground, std::max({chunk_m, 2 * m.bucket.width_m, 2 * m.bucket.height_m}));
  for (const Box3& block : m.swept.blocks()) {
    if (surely_air(site, block)) continue;
    if (!cells.mark(block)) return std::numeric_limits<double>::infinity();
    if (cells.volume_m3() > enough_m3) break;
  }
  return cells.volume_m3();
}

/// Estimate of the dug soil: smaller cells that the mouth sweeps.
double swept_soil_m3(const Site& site, const MachineInput& m, double chunk_m, double enough_m3) {
  const double cell_m =
      std::max(chunk_m, std::max(m.bucket.width_m, m.bucket.height_m) / kPointsAcross);
  const int ny = std::max(1, static_cast<int>(std::ceil(m.bucket.width_m / cell_m)));
  const int nz = std::max(1, static_cast<int>(std::ceil(m.bucket.height_m / cell_m)));
  SoilCells cells(*site.ground, cell_m);
  const Corners corners = bucket_corners(m.bucket);
  std::optional<Pose> last;  // last pose in soil
  const auto mark = [&](const Pose& pose) {
    if (surely_air(site, box_at(pose, corners))) return;
    last = pose;
    for (int j = 0; j <= ny; ++j) {
      for (int k = 0; k <= nz; ++k) {
        cells.mark(pose * Vec3(0, (double(j) / ny - 0.5) * m.bucket.width_m,
                               double(k) / nz * m.bucket.height_m));
      }
    }
  };
  if (m.has_motion()) mark(m.motion.part(0)->row(0));
  const auto in_soil = [&](const Box3& box) { return !surely_air(site, box); };
  find_step(m, in_soil, [&](const Motion& part, const StepBox& step) {
    if (!in_soil(step.box)) return false;
    const std::vector<double>& times = part.times_s();
    const std::size_t next = std::min(step.row + 1, times.size() - 1);
    const Pose here = part.row(next);
    double moved = last ? 0 : cell_m;
    for (const auto& p : corners.colwise())
      if (last) moved = std::max(moved, (here * Vec3(p) - *last * Vec3(p)).norm());
    if (moved < cell_m / 2 && part.row_pieces(next) == 1) return false;
    for (const Pose& pose : part.trace(times[step.row], times[next], m.bucket, cell_m, cell_m))
      mark(pose);
    return cells.volume_m3() > enough_m3;
  });
  return cells.volume_m3();
}

void check_memory(const Scenario& scenario, const Site& site) {
  const double h = site.ground->voxel_size_m(), chunk_m = kChunkSide * h;
  const double bytes_per_m3 = kBytesPerChunk / (chunk_m * chunk_m * chunk_m);
  const double limit = memory_bytes() / 2;
  double bytes = 0;
  for (const MachineInput& m : scenario.machines)
    bytes += reached_soil_m3(site, m, chunk_m, limit / bytes_per_m3) * bytes_per_m3;
  if (bytes <= limit) return;
  bytes = 0;
  for (const MachineInput& m : scenario.machines)
    bytes += swept_soil_m3(site, m, chunk_m, 1000 * limit / bytes_per_m3) * bytes_per_m3;
  if (bytes <= limit) return;
  const double enough = h * std::cbrt(bytes / limit);
  throw InputError(
      scenario.file,
      fmt::format(
          "voxel_size {:g} is too small for what is dug: its voxels would take about {:.3g} "
          "GB, and this machine has {:.3g} GB; {:g} would do",
          h, bytes / 1e9, memory_bytes() / 1e9, rounded_up(enough)));
}

/// The output raster covers all changed ground and everything between.
void check_raster(const Scenario& scenario, const Site& site) {
  if (!scenario.raster_cell_m) return;
  const double h = site.ground->voxel_size_m(), cell_m = *scenario.raster_cell_m;
  const auto cells = [&](const Eigen::AlignedBox2d& box) {
    // Whole chunks become resident.
    return (box.sizes().array() + 2 * kChunkSide * h).prod() / (cell_m * cell_m);
  };
  Eigen::AlignedBox2d all, dug;
  for (const Chunk* chunk : site.ground->chunks())
    dug.extend(site.ground->world_from_index(chunk->origin.cast<double>()).head<2>());
  all = dug;
  for (const MachineInput& m : scenario.machines) all.extend(plan(m.swept.whole()));
  for (const Pour& pour : scenario.pours) all.extend(Vec2(pour.at_m.head<2>()));
  if (cells(all) <= kMostRasterCells) return;
  const auto more = [&](const Box3& box) {
    return !dug.contains(plan(box)) && !surely_air(site, box);
  };
  for (const MachineInput& m : scenario.machines) {
    find_step(m, more, [&](const Motion& part, const StepBox& step) {
      if (!more(step.box)) return false;
      for (const Box3& box : close_boxes(m, part, step.row, h)) {
        if (more(box)) dug.extend(plan(box));
      }
      return false;
    });
  }
  for (const Pour& pour : scenario.pours) dug.extend(Vec2(pour.at_m.head<2>()));
  if (dug.isEmpty() || cells(dug) <= kMostRasterCells) return;
  const double enough = cell_m * std::sqrt(cells(dug) / kMostRasterCells);
  throw InputError(
      scenario.file,
      fmt::format("a raster of cells of {:g} m over all that is dug, {:.0f} m x {:.0f} m, would "
                  "have more than {:.0e} cells; cells of {:g} m would do",
                  cell_m, dug.sizes().x(), dug.sizes().y(), kMostRasterCells, rounded_up(enough)));
}

}  // namespace

void check_workspace(const Scenario& scenario, const Site& site) {
  check_overlap(scenario, site);
  for (const MachineInput& m : scenario.machines) check_distance(scenario, site, m);
  for (const MachineInput& m : scenario.machines) check_strokes(site, scenario, m);
  for (const MachineInput& m : scenario.machines) check_known(scenario, site, m);
  check_pours(scenario, site);
  check_memory(scenario, site);
  check_raster(scenario, site);
}

}  // namespace soilvdb::inline v0::io
