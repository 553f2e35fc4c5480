// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Recorded scans. Two bytes say whether a message follows, cl(oud), de(pth) or ca(mera), or a file
// in MCAP.
#include "io/scan/scan_messages.h"
#include "soilvdb/io/recorded_scans.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

namespace {

void check(const io::PointCloud& cloud, std::size_t bytes) {
  fuzz::require(cloud.points_m.size() + cloud.without_return <= bytes, "points have bytes");
  for (const Vec3& p : cloud.points_m)
    fuzz::require(p.cwiseAbs().maxCoeff() <= 1e9, "points are near");
}

/// Calls `read`, which may refuse the message.
template <typename F>
void decode(F read) {
  try {
    read();
  } catch (const io::CdrError& e) {
    fuzz::check_message(e);
  } catch (const io::ScanFault& e) {
    fuzz::check_message(e);
  }
}

void read_file(const std::filesystem::path& file, const io::ScanSource& like, std::size_t bytes) {
  fuzz::expect_read_or_refused([&] {
    io::ScanSource source = like;
    source.files = {file};
    std::vector<std::string> warnings;
    double last_s = -1e300;
    io::RecordedScans recording(source);
    recording.each(
        [&](io::RecordedScan&& scan) {
          check(scan.cloud, bytes);
          fuzz::require(scan.time_s >= last_s, "scans are in the order of their times");
          last_s = scan.time_s;
          fuzz::require(!scan.world_from_sensor || scan.world_from_sensor->position.allFinite(),
                        "poses are finite");
        },
        warnings);
    for (const std::string& line : warnings)
      fuzz::require(line.find('\n') == line.npos, "warnings have one line");
  });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  const std::string_view kind = fuzz::text(data, size).substr(0, 2);
  const std::string_view bytes = fuzz::text(data, size).substr(kind.size());
  constexpr io::CameraModel kCamera{2, 1, 500, 500, 1, 0};
  if (kind == "cl") {
    decode([&] { check(io::read_point_cloud2(bytes), size); });
  } else if (kind == "de") {
    decode([&] { check(io::read_depth_image(bytes, kCamera), size); });
  } else if (kind == "ca") {
    decode([&] { io::read_camera_info(bytes); });
  } else if (kind == "mc") {
    const auto file = folder.write("scans.mcap", bytes);
    // A chunk of zeros may be a thousand times as long as its bytes.
    constexpr std::size_t kMostGrowth = 100'000;
    read_file(file, {{}, "/points"}, kMostGrowth * size);
    read_file(file, {{}, "/depth"}, kMostGrowth * size);
    read_file(file, {{}, "/points", {}, "/tf", "map"}, kMostGrowth * size);
  }
  return 0;
}
