// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb info: describes a snapshot, another .vdb, a raster or a scenario.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <limits>
#include <map>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include "io/file/file_part.h"
#include "io/file/text.h"
#include "io/scenario/underground.h"
#include "io/terrain/raster_facts.h"
#include "soilvdb/capacity.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/tool_shape.h"
#include "tools/app/child.h"
#include "tools/app/commands.h"
#include "tools/run/run.h"
#include "tools/run/run_folder.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

void line(std::string_view label, const std::string& text) {
  fmt::print("{:<14}{}\n", label, text);
}

std::string box_text(const Eigen::AlignedBox2d& box) {
  if (box.isEmpty()) return "nowhere";
  return fmt::format("x {:.2f} to {:.2f}, y {:.2f} to {:.2f}", box.min().x(), box.max().x(),
                     box.min().y(), box.max().y());
}

std::string box_text(const Eigen::AlignedBox3d& box) {
  if (box.isEmpty()) return "nowhere";
  return fmt::format("{}, z {:.2f} to {:.2f} m",
                     box_text(Eigen::AlignedBox2d(box.min().head<2>(), box.max().head<2>())),
                     box.min().z(), box.max().z());
}

void info_snapshot(const fs::path& file) {
  io::SnapshotInfo info;
  const io::Site site = io::read_snapshot(file, &info);
  const Ground& ground = *site.ground;
  Eigen::AlignedBox3d box;
  for (const Chunk* chunk : ground.chunks()) {
    const Vec3 low = ground.world_from_index(chunk->origin.cast<double>() - Vec3::Constant(0.5));
    box.extend(low);
    box.extend(low + Vec3::Constant(ground.voxel_size_m() * kChunkSide));
  }
  fmt::print("{}: snapshot of soilvdb\n", file.string());
  if (!info.scenario.empty()) line("scenario", info.scenario);
  line("time", time_text(info.time_s) + " s");
  line("voxels", length_text(ground.voxel_size_m()) + " m");
  line("origin",
       fmt::format("{} {} {} m", ground.origin().x(), ground.origin().y(), ground.origin().z()));
  line("CRS", crs_text(site.crs_wkt));
  line("base", terrain_text(site.reference.terrain));
  if (const std::string beneath = beneath_text(ground); !beneath.empty()) line("", beneath);
  line("cut",
       fmt::format("{} m³ (captured {}, displaced {}, dumped {})", number(info.cut_m3),
                   number(info.captured_m3), number(info.displaced_m3), number(info.dumped_m3)));
  std::int64_t loose = 0;
  for (const Chunk* chunk : ground.chunks()) loose += chunk->loose_count;
  if (loose > 0)
    line("loose", fmt::format("{} m³", number(static_cast<double>(loose) * ground.sample_m3())));
  if (info.parent)
    line("goes on from",
         fmt::format("{}; {} in all since a whole one", io::printable(info.parent->name),
                     counted(info.parent->depth, "incremental snapshot")));
  line("resident", fmt::format("{} m², {} chunks, {} voxels", number(ground.resident_m2()),
                               ground.chunks().size(), ground.active_voxels()));
  line("bounds", box_text(box));
  line("state hash", fmt::format("{:016x}", ground.state_hash()));
  line("checksums", site.reference.checksum.empty() ? "good" : "good, also of its base");
}

/// Heights of a raster: all of a small one, evenly spread windows of a large one.
struct SampledHeights {
  std::int64_t read = 0, known = 0;
  float low = std::numeric_limits<float>::infinity(), high = -low;
  bool all = true;

  std::string text() const {
    if (known == 0) return "none in what was sampled";
    return fmt::format("{:.2f} to {:.2f} m{}", low, high, all ? "" : ", of evenly spread samples");
  }
};

/// @param block_columns width of storage blocks; windows of this width are fast to read
SampledHeights sample_heights(const io::RasterInput& raster, int block_columns) {
  constexpr int kWindow = 1 << 14, kMostWindows = 256, kLeastColumns = 128;
  const HeightGrid& grid = raster.grid;
  const int columns = std::min(std::max(block_columns, kLeastColumns), grid.nx);
  const int rows = std::clamp(kWindow / columns, 1, grid.ny);
  const std::int64_t nx = (grid.nx + columns - 1) / columns, ny = (grid.ny + rows - 1) / rows;
  const std::int64_t windows = std::min<std::int64_t>(nx * ny, kMostWindows);
  SampledHeights heights;
  heights.all = windows == nx * ny;
  std::vector<float> values;
  for (std::int64_t i = 0; i < windows; ++i) {
    const std::int64_t at = i * (nx * ny) / windows;
    const int x0 = static_cast<int>(at % nx) * columns, y0 = static_cast<int>(at / nx) * rows;
    const int width = std::min(columns, grid.nx - x0), depth = std::min(rows, grid.ny - y0);
    values.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(depth));
    raster.source->read(x0, y0, width, depth, values.data());
    for (const float z : values) {
      ++heights.read;
      if (std::isnan(z)) continue;
      ++heights.known;
      heights.low = std::min(heights.low, z);
      heights.high = std::max(heights.high, z);
    }
  }
  return heights;
}

void info_raster(const fs::path& file) {
  const io::RasterFacts facts = io::raster_facts(file);
  fmt::print("{}: raster, {}\n", file.string(), facts.driver);
  line("size", fmt::format("{} x {} cells, {}, {}", facts.columns, facts.rows,
                           counted(facts.bands, "band"), facts.value_type));
  if (facts.placed) {
    line("cell", fmt::format("{:.8g} x {:.8g}", facts.cell.x(), facts.cell.y()));
    line("extent", box_text(facts.box));
  }
  line("CRS", facts.crs_wkt.empty() ? "not known" : crs_text(facts.crs_wkt));
  line("NODATA", facts.nodata.empty() ? "none named" : facts.nodata);
  try {
    const io::RasterInput raster = io::open_raster(file);
    const SampledHeights heights = sample_heights(raster, facts.block_columns);
    const double share = 1 - static_cast<double>(heights.known) /
                                 static_cast<double>(std::max<std::int64_t>(heights.read, 1));
    line("heights", heights.text());
    line("no height", fmt::format("{:.3g} % of the cells", 100 * share));
    line("as terrain", "usable");
    for (const std::string& warning : raster.warnings) line("warning", warning);
  } catch (const std::exception& e) {
    std::string_view reason = e.what();
    const std::string file_said = file.string() + ": ";
    if (reason.starts_with(file_said)) reason.remove_prefix(file_said.size());
    line("as terrain", fmt::format("not usable: {}", reason));
  }
}

void info_tin(const fs::path& file) {
  const io::RasterInput surface = io::open_raster(file);
  const HeightGrid& grid = surface.grid;
  constexpr int kTile = 64;
  const SampledHeights heights = sample_heights(surface, kTile);
  fmt::print("{}: surface of triangles, {}\n", file.string(), surface.driver);
  line("extent",
       box_text(Eigen::AlignedBox2d(
           grid.first, grid.first + grid.spacing.cwiseProduct(Vec2(grid.nx - 1, grid.ny - 1)))));
  line("CRS", surface.crs_wkt.empty() ? "not known" : crs_text(surface.crs_wkt));
  line("posts", fmt::format("{} x {}, {:.3g} x {:.3g} m apart", grid.nx, grid.ny, grid.spacing.x(),
                            grid.spacing.y()));
  if (heights.known > 0) line("heights", heights.text());
  line("as terrain", "usable");
  for (const std::string& warning : surface.warnings) line("warning", warning);
}

std::string degrees_text(double rad) {
  return fmt::format("{:g} rad ({:.1f}°)", rad, rad * 180 / std::numbers::pi);
}

/// Prints moving soil, pours and hoppers.
void print_earthmoving(const io::Scenario& scenario) {
  if (const auto& soil = scenario.soil) {
    line("soil", fmt::format("repose {}, swell {:g}, {:g} kg/m³", degrees_text(soil->repose_rad),
                             soil->swell, soil->density_kg_m3));
    if (soil->cohesion_pa || soil->friction_rad)
      line("  bank",
           fmt::format("{}, friction {}",
                       soil->cohesion_pa ? fmt::format("cohesion {:g} Pa", *soil->cohesion_pa)
                                         : std::string("stands as it is cut"),
                       degrees_text(soil->friction_rad.value_or(soil->repose_rad))));
  }
  for (const Pour& pour : scenario.pours) {
    line("pour", fmt::format("{}: {:g} m³, {} s to {} s, at x {:.2f}, y {:.2f}, z {:.2f} m",
                             pour.name, pour.volume_m3, time_text(pour.begin_s),
                             time_text(pour.end_s), pour.at_m.x(), pour.at_m.y(), pour.at_m.z()));
  }
  for (const Hopper& hopper : scenario.hoppers) {
    line("hopper",
         fmt::format(
             "{}: {}, rim at z {:.2f} m, {}", hopper.name, box_text(hopper.box_m), hopper.top_m,
             std::isfinite(hopper.end_s)
                 ? fmt::format("{} s to {} s", time_text(hopper.begin_s), time_text(hopper.end_s))
                 : std::string("all the time")));
  }
}

/// Prints sensors, each with its scans.
void print_scans(const io::Scenario& scenario) {
  std::map<std::string, std::vector<const io::ScanInput*>> by_sensor;
  for (const io::ScanInput& scan : scenario.scans) by_sensor[scan.sensor.name].push_back(&scan);
  for (const auto& [name, scans] : by_sensor) {
    const io::ScanInput& first = *scans.front();
    const Vec3& at = first.sensor.pose.position;
    line("sensor",
         fmt::format("{}: {}, noise {:g} m{}", name,
                     first.machine ? "on " + scenario.machines[*first.machine].name
                     : first.by_transforms
                         ? std::string("placed by transforms")
                         : fmt::format("at x {:.2f}, y {:.2f}, z {:.2f} m", at.x(), at.y(), at.z()),
                     first.sensor.range_sigma_m,
                     first.sensor.range_squared_sigma_per_m > 0
                         ? fmt::format(" and {:g} m at 10 m of range",
                                       100 * first.sensor.range_squared_sigma_per_m)
                         : ""));
    line("  scans", fmt::format("{}, {} s to {} s, from {}", counted(scans.size(), "scan"),
                                time_text(first.time_s), time_text(scans.back()->time_s),
                                first.file.filename().string()));
  }
}

/// Adds a run's warnings about the terrain; not for level sets, which take long to open.
void warn_of_ground(io::Scenario& scenario) {
  if (std::holds_alternative<io::LevelSetTerrain>(scenario.terrain)) return;
  try {
    const io::Base base = io::open_base(scenario.terrain);
    scenario.warnings.insert(scenario.warnings.end(), base.warnings.begin(), base.warnings.end());
    io::warn_of_underground(scenario, *base.surface);
  } catch (const std::exception& e) {
    scenario.warnings.push_back(e.what());
  }
}

void info_scenario(const fs::path& file) {
  io::Scenario scenario = io::read_scenario(file, {}, io::Motions::kOptional);
  warn_of_voxels(scenario);
  warn_of_ground(scenario);
  fmt::print("{}: scenario\n", file.string());
  line("name", scenario.name);
  line("voxels", length_text(scenario.voxel_size_m) + " m");
  line("terrain", terrain_text(scenario.terrain));
  for (const io::MachineInput& machine : scenario.machines) {
    const Bucket& bucket = machine.bucket;
    const io::MotionFile& motion = machine.motion;
    if (bucket.shape) {
      const Vec3 size_m = bucket.shape->box_m().sizes();
      line("machine", fmt::format("{}: tool of {} m x {} m x {} m", machine.name,
                                  number(size_m.x()), number(size_m.y()), number(size_m.z())));
    } else {
      line("machine", fmt::format("{}: mouth {} m wide, {} m high, {}", machine.name,
                                  length_text(bucket.width_m), length_text(bucket.height_m),
                                  bucket.profile.empty()
                                      ? std::string("no body")
                                      : fmt::format("body of {} points", bucket.profile.size())));
    }
    if (const auto capacity = Capacity::of(bucket))
      line("  holds", fmt::format("{} m³ struck, {} m³ heaped at 1:1",
                                  number(capacity->struck_m3()), number(capacity->heaped_m3())));
    if (!machine.has_motion()) {
      line("  motion",
           machine.chain ? "none of its own: fed joints or poses" : "none of its own: fed poses");
      continue;
    }
    Eigen::AlignedBox3d box;
    for (std::size_t i = 0; i < motion.parts(); ++i) {
      const auto part = motion.part(i);
      for (std::size_t row = 0; row < part->times_s().size(); ++row) {
        const Pose world_from_bucket = part->row(row);
        if (bucket.shape) {
          for (const Vec3& p : extremes(bucket)) box.extend(world_from_bucket * p);
        } else {
          for (const Vec3& p : mouth_corners(bucket, world_from_bucket)) box.extend(p);
        }
      }
    }
    line("  motion",
         fmt::format("{}, {} s from {} s", counted(motion.rows(), "row"),
                     time_text(motion.end_s() - motion.begin_s()), time_text(motion.begin_s())));
    line(bucket.shape ? "  tool in" : "  mouth in", box_text(box));
    if (motion.stops()) line("warning", motion.bad_rows().first + "; a run ends before this row");
  }
  print_earthmoving(scenario);
  print_scans(scenario);
  if (scenario.snapshot_every_s)
    line("snapshots", fmt::format("every {} s{}{}", *scenario.snapshot_every_s,
                                  scenario.incremental_snapshots ? ", incremental" : "",
                                  scenario.snapshots_kept ? fmt::format(", the newest {} kept",
                                                                        *scenario.snapshots_kept)
                                                          : ""));
  if (scenario.mesh) line("mesh", *scenario.mesh);
  if (scenario.mcap) line("recording", kMcapName);
  if (scenario.raster_cell_m)
    line("raster", fmt::format("cells of {} m", length_text(*scenario.raster_cell_m)));
  for (const std::string& warning : scenario.warnings) line("warning", warning);
}

/// The first bytes of a file, to detect its format.
std::string head_of(const fs::path& file) {
  std::array<char, 4096> bytes;
  std::ifstream in(file, std::ios::binary);
  in.read(bytes.data(), bytes.size());
  return {bytes.data(), static_cast<std::size_t>(in.gcount())};
}

bool looks_like_scenario(const fs::path& file, const std::string& head) {
  const std::string suffix = io::suffix_of(file);
  return suffix == ".yaml" || suffix == ".yml" || head.starts_with("soilvdb:") ||
         head.find("\nsoilvdb:") != std::string::npos;
}

}  // namespace

void info(const fs::path& file) {
  constexpr std::string_view kVdbMagic("\x20\x42\x44\x56\0\0\0\0", 8);
  if (io::is_tin(file)) return info_tin(file);
  io::check_readable(file);
  const std::string head = head_of(file);
  if (head.starts_with(kVdbMagic) || io::suffix_of(file) == ".vdb") {
    if (io::is_snapshot(file)) return info_snapshot(file);
    fmt::print("{}", read_in_child(kText, file));
    return;
  }
  if (looks_like_scenario(file, head)) return info_scenario(file);
  const std::string suffix = io::suffix_of(file);
  if (suffix == ".mcap" || suffix == ".db3" || suffix == ".csv")
    throw io::InputError(file, "may be a motion; name a scenario with it as a machine's motion");
  try {
    info_raster(file);
  } catch (const io::InputError& e) {
    if (std::string_view(e.what()).find("not recognized") == std::string_view::npos) throw;
    throw io::InputError(file, "is neither a .vdb, nor a scenario, nor a raster that GDAL reads");
  }
}

}  // namespace soilvdb::tools
