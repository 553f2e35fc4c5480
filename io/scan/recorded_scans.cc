// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/recorded_scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "io/file/text.h"
#include "io/motion/mcap_files.h"
#include "io/scan/scan_index.h"
#include "io/scan/sensor_poses.h"

namespace soilvdb::inline v0::io {
namespace {

/// The camera at a time: the last one told, or else the first.
const CameraModel& camera_at(const ScanIndex& index, std::int64_t time_ns,
                             const std::string& info_topic) {
  auto camera = std::upper_bound(
      index.cameras.begin(), index.cameras.end(), time_ns,
      [](std::int64_t t_ns, const CameraSince& one) { return t_ns < one.time_ns; });
  if (camera != index.cameras.begin()) --camera;
  if (!camera->fault.empty())
    throw ScanFault(fmt::format("has no usable camera: a message of topic '{}' {}",
                                printable(info_topic), camera->fault));
  return camera->camera;
}

ScanSource with_files(ScanSource source) {
  std::vector<std::filesystem::path> files;
  for (const auto& path : source.files)
    for (const auto& file : mcap_files(path)) files.push_back(file);
  if (files.empty()) throw InputError("scans need a file or folder in MCAP");
  source.files = std::move(files);
  return source;
}

}  // namespace

struct RecordedScans::State {
  ScanSource source;
  ScanIndex index;
  std::unique_ptr<McapReader> reader = {};  // of file `open`
  std::uint32_t open = 0;
  std::unique_ptr<SensorPoses> poses = {};
  std::size_t next = 0;  // the first scan that the poses have not passed

  explicit State(ScanSource given)
      : source(with_files(std::move(given))), index(index_scans(source)) {}

  void begin() {
    const bool known = source.world.empty() || !index.tf_topic.empty();
    poses = std::make_unique<SensorPoses>(source, known ? index.tf_topic : source.tf_topic);
    next = 0;
  }
  /// @throw InputError if the file has changed
  std::string_view message_at(const ScanPlace& place) {
    const McapFacts::File& file = index.files[place.file];
    if (!reader || open != place.file)
      reader = std::make_unique<McapReader>(file.path, file.channels);
    open = place.file;
    reader->go_to(place.mark);
    McapReader::Message message;
    if (!reader->next(message) || message.channel->topic != source.topic)
      throw InputError(file.path, place.number, "changed while it was being read");
    return message.data;
  }
  /// @throw ScanFault if it is damaged
  RecordedScan read(std::size_t number) {
    if (!poses || number < next) begin();
    next = number + 1;
    const ScanPlace& place = index.scans.at(number);
    if (!place.fault.empty()) throw ScanFault(place.fault);
    RecordedScan scan;
    scan.number = number;
    scan.time_s = stamp_s(place.time_ns);
    const std::string_view message = message_at(place);
    try {
      scan.frame_id = read_scan_header(message).frame_id;
      scan.cloud = index.type == ScanType::kPointCloud2
                       ? read_point_cloud2(message)
                       : read_depth_image(
                             message, camera_at(index, place.time_ns, camera_info_topic(source)));
    } catch (const CdrError& e) {
      throw ScanFault(fmt::format("is not a {} in CDR: it {}", type_name(index.type), e.what()));
    }
    scan.world_from_sensor = poses->at(scan.frame_id, place.time_ns);
    return scan;
  }
  /// "FILE:NUMBER: fault" of a scan.
  InputError error(std::size_t number, const std::string& fault) const {
    const ScanPlace& place = index.scans[number];
    return {index.files[place.file].path, place.number, fault};
  }
};

RecordedScans::RecordedScans(ScanSource source)
    : state_(std::make_unique<State>(std::move(source))) {}
RecordedScans::~RecordedScans() = default;

const std::vector<std::filesystem::path>& RecordedScans::files() const {
  return state_->source.files;
}

RecordedScan RecordedScans::read(std::size_t number) {
  try {
    return state_->read(number);
  } catch (const ScanFault& fault) {
    throw state_->error(number, fault.what());
  }
}

void RecordedScans::each(const std::function<void(RecordedScan&&)>& take,
                         std::vector<std::string>& warnings) {
  State& s = *state_;
  s.begin();
  std::string first_fault;
  std::size_t left_out = 0;
  for (std::size_t number = 0; number < s.index.scans.size(); ++number) {
    RecordedScan scan;
    try {
      scan = s.read(number);
    } catch (const ScanFault& fault) {
      if (left_out++ == 0) first_fault = s.error(number, fault.what()).what();
      continue;
    }
    take(std::move(scan));
  }
  if (left_out == s.index.scans.size()) throw InputError(first_fault);
  if (left_out > 0)
    warnings.push_back(
        fmt::format("{}{}; {} left out", first_fault,
                    left_out == 1 ? std::string() : fmt::format(" and {} more", left_out - 1),
                    left_out == 1 ? "this scan is" : "these scans are"));
  warn_of_torn(s.index.files, warnings);
  if (s.index.unstamped > 0)
    warnings.push_back(fmt::format(
        "{}: {} scan{} of topic '{}' {} no stamp; the time at which they "
        "were recorded is taken",
        s.source.files.front().string(), s.index.unstamped, s.index.unstamped == 1 ? "" : "s",
        printable(s.source.topic), s.index.unstamped == 1 ? "has" : "have"));
  s.poses->warn(warnings);
}

}  // namespace soilvdb::inline v0::io
