// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scan/scan_index.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <tuple>

#include "io/file/text.h"
#include "io/motion/mcap_merge.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostCameras = 10'000;  // changes

/// @throw InputError if the topic's type or encoding is not that of scans
ScanType scan_type_of(const std::filesystem::path& file, const McapChannel& channel) {
  const std::string topic = printable(channel.topic), type = plain_type(channel.schema);
  if (channel.encoding != "cdr")
    throw InputError(file, fmt::format("topic '{}' is encoded as '{}'; it must be cdr, as ROS 2 "
                                       "records it",
                                       topic, printable(channel.encoding)));
  for (const ScanType known : {ScanType::kPointCloud2, ScanType::kImage})
    if (type == type_name(known)) return known;
  throw InputError(file,
                   fmt::format("topic '{}' is of {}; it must be of {} or {}", topic,
                               type.empty() ? "no type" : printable(type),
                               type_name(ScanType::kPointCloud2), type_name(ScanType::kImage)));
}

class IndexScans {
 public:
  explicit IndexScans(const ScanSource& source)
      : source_(source), info_topic_(camera_info_topic(source)) {
    stream_.stamped_since_ns = kLatest_ns;
  }

  ScanIndex take() {
    for (const auto& path : source_.files) look_at_file(path);
    const std::filesystem::path& first = source_.files.front();
    if (!type_)
      throw InputError(first, fmt::format("has no message of topic '{}'; {}",
                                          printable(source_.topic), topics_there(index_.files)));
    index_.type = *type_;
    if (*type_ == ScanType::kImage && index_.cameras.empty())
      throw InputError(first, fmt::format("topic '{}' has images, and topic '{}' no "
                                          "sensor_msgs/CameraInfo for them; {}",
                                          printable(source_.topic), printable(info_topic_),
                                          topics_there(index_.files)));
    set_times();
    sort();
    if (has_tf_ || has_fixed_tf_) index_.tf_topic = source_.tf_topic + (has_tf_ ? "" : kStatic);
    return std::move(index_);
  }

 private:
  static constexpr const char* kStatic = "_static";

  void look_at_file(const std::filesystem::path& path) {
    McapReader reader(path);
    McapReader::Message message;
    long number = 0;
    const auto file = static_cast<std::uint32_t>(index_.files.size());
    for (McapReader::Mark mark = reader.mark(); reader.next(message); mark = reader.mark()) {
      const std::string& topic = message.channel->topic;
      if (topic == source_.topic) {
        const ScanType type = scan_type_of(path, *message.channel);
        if (type_ && *type_ != type)
          throw InputError(path, fmt::format("topic '{}' has messages of {} and of {}; they must "
                                             "be of one type",
                                             printable(topic), type_name(*type_), type_name(type)));
        type_ = type;
        add({0, message.log_ns, file, ++number, mark}, message.data);
      } else if (topic == info_topic_) {
        add_camera(message);
      } else if (topic == source_.tf_topic) {
        has_tf_ = true;
      } else if (topic == source_.tf_topic + kStatic) {
        has_fixed_tf_ = true;
      }
    }
    index_.files.push_back({path, static_cast<std::int64_t>(std::filesystem::file_size(path)),
                            reader.channels(), reader.torn_at()});
  }

  void add(ScanPlace place, std::string_view message) {
    try {
      place.time_ns = read_scan_header(message).stamp_ns;
      if (place.time_ns != 0)
        stream_.stamped_since_ns = std::min(stream_.stamped_since_ns, place.log_ns);
    } catch (const CdrError& e) {
      place.time_ns = place.log_ns;
      place.fault = fmt::format("is not a {} in CDR: it {}", type_name(*type_), e.what());
    }
    index_.scans.push_back(std::move(place));
  }

  void add_camera(const McapReader::Message& message) {
    CameraSince one;
    try {
      const std::int64_t stamp_ns = read_scan_header(message.data).stamp_ns;
      one.time_ns = stamp_ns == 0 ? message.log_ns : stamp_ns;
      one.camera = read_camera_info(message.data);
    } catch (const ScanFault& e) {
      one.fault = e.what();
    } catch (const CdrError& e) {
      one.fault = fmt::format("is not a sensor_msgs/CameraInfo in CDR: it {}", e.what());
    }
    if (!index_.cameras.empty() && index_.cameras.back().camera == one.camera &&
        index_.cameras.back().fault == one.fault)
      return;
    if (index_.cameras.size() == kMostCameras)
      throw InputError(source_.files.front(),
                       fmt::format("topic '{}' has more than {} different cameras",
                                   printable(info_topic_), kMostCameras));
    index_.cameras.push_back(one);
  }

  /// Stamp 0 means that there is none, unless simulated time begins there.
  void set_times() {
    if (stream_.stamped_since_ns == kLatest_ns) stream_.stamped_since_ns = -kLatest_ns / 2;
    for (ScanPlace& scan : index_.scans) {
      const std::int64_t stamp_ns = scan.time_ns;
      scan.time_ns = stream_.time_of(stamp_ns, scan.log_ns);
      index_.unstamped += stamp_ns == 0 && scan.time_ns != 0;
    }
  }

  void sort() {
    std::stable_sort(
        index_.scans.begin(), index_.scans.end(), [](const ScanPlace& a, const ScanPlace& b) {
          return std::tie(a.time_ns, a.file, a.number) < std::tie(b.time_ns, b.file, b.number);
        });
    std::stable_sort(
        index_.cameras.begin(), index_.cameras.end(),
        [](const CameraSince& a, const CameraSince& b) { return a.time_ns < b.time_ns; });
    std::int64_t last_log_ns = 0;
    for (ScanPlace& scan : index_.scans) {
      if (scan.log_ns < last_log_ns - kMostBehind_ns && scan.fault.empty())
        scan.fault = clock_fault(scan.time_ns, last_log_ns - scan.log_ns);
      last_log_ns = std::max(last_log_ns, scan.log_ns);
    }
  }

  const ScanSource& source_;
  const std::string info_topic_;
  ScanIndex index_;
  McapStream stream_;
  std::optional<ScanType> type_;
  bool has_tf_ = false, has_fixed_tf_ = false;
};

}  // namespace

const char* type_name(ScanType type) {
  return type == ScanType::kPointCloud2 ? "sensor_msgs/PointCloud2" : "sensor_msgs/Image";
}

std::string camera_info_topic(const ScanSource& source) {
  if (!source.camera_info_topic.empty()) return source.camera_info_topic;
  return source.topic.substr(0, source.topic.rfind('/') + 1) + "camera_info";
}

ScanIndex index_scans(const ScanSource& source) { return IndexScans(source).take(); }

}  // namespace soilvdb::inline v0::io
