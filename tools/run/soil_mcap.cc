// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/soil_mcap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "io/file/atomic_file.h"
#include "io/file/json.h"
#include "io/mcap/cdr.h"
#include "tools/run/mcap_schemas.h"
#include "tools/run/ros_messages.h"

namespace soilvdb::tools {
namespace {

constexpr double kGroundEvery_s = 0.5, kMapEvery_s = 1, kLoadsPerS = 10;
constexpr std::size_t kMostBlocks = 32;  // of a message, and in memory at once
constexpr std::string_view kFrame = "site", kWorld = "world";

std::string id_of(const Coord3& block) {
  return fmt::format("block {} {} {}", block.x(), block.y(), block.z());
}

void put_deletion(io::CdrWriter& cdr, double time_s, const Coord3& block) {
  constexpr std::uint8_t kMatchingId = 0;
  put_stamp(cdr, time_s);
  cdr.put_all(kMatchingId, id_of(block));
}

void put_entity(io::CdrWriter& cdr, double time_s, const Coord3& block, const Mesh& mesh) {
  constexpr std::uint32_t kNone = 0;
  put_stamp(cdr, time_s);
  cdr.put_all(kFrame, id_of(block));
  cdr.put_all(std::int32_t{0}, std::uint32_t{0});  // lifetime: unlimited
  cdr.put(std::uint8_t{0});                        // frame_locked: false
  for (int i = 0; i < 6; ++i) cdr.put(kNone);      // metadata, arrows, ..., lines
  cdr.put(std::uint32_t{1});                       // triangles
  put_pose(cdr, {});
  cdr.put(static_cast<std::uint32_t>(mesh.points.size()));
  for (const auto& p : mesh.points) cdr.put_all(double{p.x()}, double{p.y()}, double{p.z()});
  cdr.put_all(0.55, 0.42, 0.3, 1.0);                                          // colour
  cdr.put_all(kNone, static_cast<std::uint32_t>(3 * mesh.triangles.size()));  // colours of points
  for (const auto& triangle : mesh.triangles) cdr.put_all(triangle[0], triangle[1], triangle[2]);
  cdr.put_all(kNone, kNone);  // texts, models
}

std::filesystem::path part_of(std::filesystem::path file) { return file += ".part"; }

SnapshotSchedule schedule_of(double every_s, double begin_s, std::optional<double> end_s) {
  return end_s ? SnapshotSchedule(every_s, begin_s, *end_s) : SnapshotSchedule(every_s);
}

}  // namespace

SoilMcap::SoilMcap(std::filesystem::path file, const Ground& ground, const std::string& crs_wkt,
                   const std::vector<std::string>& machines, double begin_s,
                   std::optional<double> end_s, bool forces)
    : file_(std::move(file)),
      part_(end_s ? part_of(file_) : file_),
      writer_(part_),
      schedule_(schedule_of(kGroundEvery_s, begin_s, end_s)),
      map_schedule_(schedule_of(kMapEvery_s, begin_s, end_s)),
      mesher_(ground),
      map_(ground) {
  for (const Chunk* chunk : ground.chunks()) changed_.insert(changed_.end(), chunk->origin);
  ground_ = writer_.add_channel("/ground", scene_update_schema(), "cdr");
  elevation_ = writer_.add_channel("/elevation", grid_map_schema(), "cdr");
  const std::uint16_t fixed = writer_.add_channel("/tf_static", transforms_schema(), "cdr");
  if (forces) places_ = writer_.add_channel("/tf", transforms_schema(), "cdr");
  for (const std::string& name : machines) {
    // Names come from the user's files and need not be UTF-8.
    const std::string json = io::to_text(nlohmann::json(name));
    loads_.push_back({});
    const auto text = io::parse_json(json).get<std::string>();
    loads_.back().id = writer_.add_channel("/load/" + text, load_schema(), "json");
    loads_.back().name = json;
    if (!forces) continue;
    loads_.back().wrenches =
        writer_.add_channel("/" + text + "/soil_wrench", wrench_schema(), "cdr");
    loads_.back().frame = text + "_bucket";
  }
  const Vec3& o = ground.origin();
  writer_.add_metadata("soilvdb", {{"origin", fmt::format("{} {} {}", o.x(), o.y(), o.z())},
                                   {"voxel_size_m", fmt::format("{}", ground.voxel_size_m())},
                                   {"crs_wkt", crs_wkt}});
  writer_.write(fixed, stamp_ns(begin_s),
                transform_message(begin_s, kWorld, kFrame, {.position = o}));
}

SoilMcap::~SoilMcap() {
  if (part_ != file_) std::remove(part_.c_str());
}

bool SoilMcap::due(double time_s) {
  const bool first = !std::exchange(asked_, true) && part_ == file_;  // of a live site
  const bool due = schedule_.due(time_s) || first;
  if (due) map_due_ |= map_schedule_.due(time_s) || first;
  return due;
}

bool SoilMcap::ground(double time_s, std::size_t most) {
  std::vector<Coord3> chunks;
  for (auto next = changed_.upper_bound(last_changed_); chunks.size() < most && !changed_.empty();
       next = changed_.erase(next)) {
    if (next == changed_.end()) next = changed_.begin();
    chunks.push_back(last_changed_ = *next);
  }
  const std::vector<Coord3> blocks = blocks_touched(chunks);
  for (std::span<const Coord3> left = blocks; !left.empty();) {
    const auto some = left.first(std::min(left.size(), kMostBlocks));
    put_blocks(time_s, some);
    left = left.subspan(some.size());
  }
  not_in_map_.insert(not_in_map_.end(), chunks.begin(), chunks.end());
  if (std::exchange(map_due_, false)) put_map(time_s);
  return !changed_.empty();
}

/// Meshes of blocks in place of those before; where there is none any more the entity goes.
void SoilMcap::put_blocks(double time_s, std::span<const Coord3> blocks) {
  std::vector<Coord3> gone;
  std::vector<std::pair<Coord3, Mesh>> there;
  for (const Coord3& block : blocks) {
    Mesh mesh = mesher_.block(block);
    if (!mesh.triangles.empty()) {
      shown_.insert(block);
      there.emplace_back(block, std::move(mesh));
    } else if (shown_.erase(block) > 0) {
      gone.push_back(block);
    }
  }
  if (gone.empty() && there.empty()) return;
  io::CdrWriter cdr;
  cdr.put(static_cast<std::uint32_t>(gone.size()));
  for (const Coord3& block : gone) put_deletion(cdr, time_s, block);
  cdr.put(static_cast<std::uint32_t>(there.size()));
  for (const auto& [block, mesh] : there) put_entity(cdr, time_s, block, mesh);
  writer_.write(ground_, stamp_ns(time_s), cdr.bytes());
}

void SoilMcap::put_map(double time_s) {
  if (not_in_map_.empty()) return;
  map_.update(std::exchange(not_in_map_, {}));
  writer_.write(elevation_, stamp_ns(time_s), grid_map_message(time_s, kFrame, map_, Vec3::Zero()));
}

void SoilMcap::put(double time_s, Channel& channel, const Load& load) {
  std::string text = fmt::format(R"({{"machine":{},"time_s":{},"bucket_m3":{},"cut_m3":{})",
                                 channel.name, time_s, load.bucket_m3, load.cut_m3);
  if (load.bucket_kg) text += fmt::format(R"(,"bucket_kg":{})", *load.bucket_kg);
  writer_.write(channel.id, stamp_ns(time_s), text + '}');
  channel.written_s = time_s;
  channel.newest.reset();
  channel.any = true;
}

void SoilMcap::load(double time_s, std::size_t machine, const Load& load) {
  // Tolerates times that are rounded below a tenth.
  const auto tenth = [](double at_s) { return std::floor(at_s * kLoadsPerS + 1e-6); };
  Channel& channel = loads_[machine];
  if (!channel.any || tenth(time_s) > tenth(channel.written_s)) return put(time_s, channel, load);
  channel.newest = load;
  channel.newest_s = time_s;
}

void SoilMcap::wrench(double time_s, std::size_t machine, const Pose& world_from_bucket,
                      const std::array<double, 6>& force) {
  const Channel& channel = loads_[machine];
  writer_.write(places_, stamp_ns(time_s),
                transform_message(time_s, kWorld, channel.frame, world_from_bucket));
  writer_.write(channel.wrenches, stamp_ns(time_s), wrench_message(time_s, channel.frame, force));
}

void SoilMcap::close(double time_s) {
  map_due_ = true;
  ground(time_s);
  for (Channel& channel : loads_)
    if (channel.newest) put(channel.newest_s, channel, Load(*channel.newest));
  writer_.close();
  if (part_ == file_) return;
  if (std::rename(part_.c_str(), file_.c_str()) != 0) io::fail_to_write(file_, errno);
  part_ = file_;
  io::sync_folder(file_);
}

}  // namespace soilvdb::tools
