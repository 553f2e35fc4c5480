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

/// Messages at the places of an index.
class ScanMessages {
 public:
  explicit ScanMessages(const ScanIndex& index) : index_(index) {}

  /// @throw InputError if the file has changed
  std::string_view at(const ScanPlace& place, const std::string& topic) {
    const McapFacts::File& file = index_.files[place.file];
    if (!reader_ || file_ != place.file)
      reader_ = std::make_unique<McapReader>(file.path, file.channels);
    file_ = place.file;
    reader_->go_to(place.mark);
    McapReader::Message message;
    if (!reader_->next(message) || message.channel->topic != topic)
      throw InputError(file.path, place.number, "changed while it was being read");
    return message.data;
  }

 private:
  const ScanIndex& index_;
  std::unique_ptr<McapReader> reader_;
  std::uint32_t file_ = 0;
};

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

}  // namespace

void read_scans(const ScanSource& given, const std::function<void(RecordedScan&&)>& take,
                std::vector<std::string>& warnings) {
  ScanSource source = given;
  source.files.clear();
  for (const auto& path : given.files)
    for (const auto& file : mcap_files(path)) source.files.push_back(file);
  if (source.files.empty()) throw InputError("scans need a file or folder in MCAP");
  const ScanIndex index = index_scans(source);
  const std::string info_topic = camera_info_topic(source);
  SensorPoses poses(
      source, source.world.empty() || !index.tf_topic.empty() ? index.tf_topic : source.tf_topic);
  ScanMessages messages(index);
  std::string first_fault;
  std::size_t left_out = 0;
  for (const ScanPlace& place : index.scans) {
    RecordedScan scan;
    std::string fault = place.fault;
    if (fault.empty()) {
      const std::string_view message = messages.at(place, source.topic);
      scan.time_s = stamp_s(place.time_ns);
      try {
        scan.frame_id = read_scan_header(message).frame_id;
        scan.cloud = index.type == ScanType::kPointCloud2
                         ? read_point_cloud2(message)
                         : read_depth_image(message, camera_at(index, place.time_ns, info_topic));
      } catch (const ScanFault& e) {
        fault = e.what();
      } catch (const CdrError& e) {
        fault = fmt::format("is not a {} in CDR: it {}", type_name(index.type), e.what());
      }
    }
    if (!fault.empty()) {
      if (left_out++ == 0)
        first_fault = InputError(index.files[place.file].path, place.number, fault).what();
      continue;
    }
    scan.world_from_sensor = poses.at(scan.frame_id, place.time_ns);
    take(std::move(scan));
  }
  if (left_out == index.scans.size()) throw InputError(first_fault);
  if (left_out > 0)
    warnings.push_back(
        fmt::format("{}{}; {} left out", first_fault,
                    left_out == 1 ? std::string() : fmt::format(" and {} more", left_out - 1),
                    left_out == 1 ? "this scan is" : "these scans are"));
  warn_of_torn(index.files, warnings);
  if (index.unstamped > 0)
    warnings.push_back(
        fmt::format("{}: {} scan{} of topic '{}' {} no stamp; the time at which they "
                    "were recorded is taken",
                    source.files.front().string(), index.unstamped, index.unstamped == 1 ? "" : "s",
                    printable(source.topic), index.unstamped == 1 ? "has" : "have"));
  poses.warn(warnings);
}

}  // namespace soilvdb::inline v0::io
