// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/recorded_scans.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <functional>
#include <limits>
#include <random>

#include "tests/support/scan_messages_fixture.h"

namespace soilvdb::io {
namespace recorded_scans_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

class Scans : public RecordedMotion {
 protected:
  using Messages = std::function<void(Recording&)>;
  struct All {
    std::vector<RecordedScan> scans;
    std::vector<std::string> warnings;

    std::vector<double> times_s() const {
      std::vector<double> times;
      for (const RecordedScan& scan : scans) times.push_back(scan.time_s);
      return times;
    }
  };

  static All all_of(const ScanSource& source) {
    All all;
    RecordedScans recording(source);
    recording.each([&](RecordedScan&& scan) { all.scans.push_back(std::move(scan)); },
                   all.warnings);
    return all;
  }
  All clouds(const Messages& messages, const ScanSource& like = {{}, "/points"}) const {
    ScanSource source = like;
    source.files = {record("a.mcap", messages)};
    return all_of(source);
  }
  std::string error_of(const Messages& messages, const ScanSource& like = {{}, "/points"}) const {
    ScanSource source = like;
    source.files = {record("a.mcap", messages)};
    return test::message_of(folder_, [&] { all_of(source); });
  }
  static void put(Recording& r, const CloudMessage& cloud, double stamp_s,
                  std::optional<double> log_s = {}, const std::string& frame = "lidar") {
    r.message("/points", "sensor_msgs/msg/PointCloud2", cloud.cdr(stamp_s, frame),
              log_s.value_or(stamp_s));
  }
  static void put(Recording& r, const DepthMessage& image, double stamp_s) {
    r.message("/cam/depth", "sensor_msgs/msg/Image", image.cdr(stamp_s), stamp_s);
  }
  static void put(Recording& r, const InfoMessage& info, double stamp_s,
                  const std::string& topic = "/cam/camera_info") {
    r.message(topic, "sensor_msgs/msg/CameraInfo", info.cdr(stamp_s), stamp_s);
  }
  /// The only scan of a recording with one cloud.
  PointCloud only(const CloudMessage& cloud) const {
    const All all = clouds([&](Recording& r) { put(r, cloud, 1); });
    EXPECT_EQ(all.scans.size(), 1U);
    return all.scans.at(0).cloud;
  }
  std::string fault(const CloudMessage& cloud) const {
    return error_of([&](Recording& r) { put(r, cloud, 1); });
  }
  PointCloud only(const DepthMessage& image, const InfoMessage& info = {}) const {
    const All all = clouds(
        [&](Recording& r) {
          put(r, info, 1);
          put(r, image, 1);
        },
        {{}, "/cam/depth"});
    return all.scans.at(0).cloud;
  }
  std::string fault(const DepthMessage& image, const InfoMessage& info = {}) const {
    return error_of(
        [&](Recording& r) {
          put(r, info, 1);
          put(r, image, 1);
        },
        {{}, "/cam/depth"});
  }
};

TEST_F(Scans, OfPointCloudsHaveTheirPointsTimesAndFrames) {
  const All all = clouds([](Recording& r) {
    put(r, one_point(1, 2, 3), 10.25);
    put(r, one_point(4, 5, 6), 10.5, {}, "mast");
  });
  ASSERT_EQ(all.scans.size(), 2U);
  EXPECT_EQ(all.scans[0].time_s, 10.25);
  EXPECT_EQ(all.scans[0].frame_id, "lidar");
  EXPECT_THAT(all.scans[0].cloud.points_m, ElementsAre(Vec3(1, 2, 3)));
  EXPECT_EQ(all.scans[1].frame_id, "mast");
  EXPECT_FALSE(all.scans[1].world_from_sensor.has_value());
  EXPECT_THAT(all.warnings, IsEmpty());
}

TEST_F(Scans, OfPointCloudsHaveAnyFieldsRowsAndByteOrder) {
  for (const bool big : {false, true}) {
    CloudMessage cloud;
    cloud.height = 2;
    cloud.width = 2;
    cloud.big_endian = big;
    cloud.fields = {{"t", 0, 6}, {"z", 4, 7}, {"ring", 8, 4}, {"x", 10, 8}, {"y", 18, 7}};
    cloud.point_step = 24;
    cloud.row_step = 50;
    const auto point = [&](double x, float y, float z) {
      return bytes_of(big, std::uint32_t{7}, z, std::uint16_t{3}, x, y, std::uint16_t{0});
    };
    cloud.data =
        point(0.1, 2, 3) + point(0, 0, 0) + "--" + point(4, kNan, 6) + point(7, -8, 9) + "--";
    const PointCloud read = only(cloud);
    EXPECT_THAT(read.points_m, ElementsAre(Vec3(0.1, 2, 3), Vec3(7, -8, 9)));
    EXPECT_EQ(read.without_return, 2U);
    // The last row needs no padding.
    cloud.data.resize(cloud.data.size() - 2);
    EXPECT_EQ(only(cloud).points_m.size(), 2U);
  }
  EXPECT_THAT(only(CloudMessage{}).points_m, IsEmpty());
}

TEST_F(Scans, OfDepthImagesAreInTheOpticalFrame) {
  // fx 100, fy 50, the centre in the middle of 3 x 2 pixels.
  for (const bool big : {false, true}) {
    DepthMessage mm{.big_endian = big, .step = 8};
    const auto row = [&](int a, int b, int c) {
      return bytes_of(big, static_cast<std::uint16_t>(a), static_cast<std::uint16_t>(b),
                      static_cast<std::uint16_t>(c)) +
             "--";
    };
    mm.data = row(2000, 0, 4000) + row(0, 65535, 1);
    const PointCloud depths = only(mm);
    ASSERT_EQ(depths.points_m.size(), 4U);
    EXPECT_EQ(depths.without_return, 2U);
    const double far = 65.535;
    const Vec3 expected[] = {
        {-0.02, -0.02, 2}, {0.04, -0.04, 4}, {0, 0.5 / 50 * far, far}, {1e-5, 1e-5, 1e-3}};
    for (std::size_t i = 0; i < 4; ++i)
      EXPECT_LT((depths.points_m[i] - expected[i]).norm(), 1e-12) << i;
    DepthMessage m{.encoding = "32FC1", .big_endian = big, .step = 12};
    m.data = bytes_of(big, 2.F, kNan, 4.F) + bytes_of(big, kInf, -1.F, -kInf);
    const PointCloud metres = only(m);
    EXPECT_EQ(metres.without_return, 4U);
    ASSERT_EQ(metres.points_m.size(), 2U);
    EXPECT_EQ(metres.points_m[1], depths.points_m[1]);
  }
}

TEST_F(Scans, OfDepthImagesHaveTheCameraOfTheirTime) {
  DepthMessage image{.height = 1, .width = 1, .step = 2};
  image.data = bytes_of(false, std::uint16_t{1000});
  const All all = clouds(
      [&](Recording& r) {
        put(r, image, 1);
        put(r, InfoMessage{.height = 1, .width = 1, .cx = -100}, 2, "/info");
        put(r, InfoMessage{.height = 1, .width = 1, .cx = -100}, 3, "/info");
        put(r, image, 4);
        put(r, InfoMessage{.height = 1, .width = 1, .cx = -200}, 5, "/info");
        put(r, image, 6);
      },
      {{}, "/cam/depth", "/info"});
  std::vector<double> x;
  for (const RecordedScan& scan : all.scans) x.push_back(scan.cloud.points_m.at(0).x());
  EXPECT_THAT(x, ElementsAre(1, 1, 2));
}

TEST_F(Scans, OfPartsAreInTheOrderOfTheirTimes) {
  std::filesystem::create_directory(folder_ / "parts");
  for (const int part : {1, 0})
    record(part == 1 ? "parts/a.mcap" : "parts/b.mcap", [&](Recording& r) {
      for (const int i : {3, 1, 2, 0, 4}) {
        const double s = 5 * part + i;
        put(r, one_point(static_cast<float>(s + 1), 0, 0), s, 20 + 0.1 * s);
        r.pose("/other", s, Vec3::Zero());
        if (i == 2) r.chunk();
      }
    });
  const All all = all_of({{folder_ / "parts"}, "/points"});
  EXPECT_THAT(all.times_s(), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9));
  for (const RecordedScan& scan : all.scans)
    EXPECT_EQ(scan.cloud.points_m.at(0).x(), scan.time_s + 1);
  EXPECT_THAT(all.warnings, IsEmpty());
}

TEST_F(Scans, WithoutStampsHaveTheTimeOfTheirRecording) {
  const All all = clouds([](Recording& r) {
    put(r, one_point(1, 0, 0), 0, 7);
    put(r, one_point(1, 0, 0), 0, 8.5);
  });
  EXPECT_THAT(all.times_s(), ElementsAre(7, 8.5));
  ASSERT_EQ(all.warnings.size(), 1U);
  EXPECT_THAT(all.warnings[0], HasSubstr("a.mcap: 2 scans of topic '/points' have no stamp"));
}

TEST_F(Scans, OfASetClockAreLeftOut) {
  const All all = clouds([](Recording& r) {
    put(r, one_point(1, 0, 0), 100, 10);
    for (const double s : {11, 12, 13}) put(r, one_point(1, 0, 0), s, s);
  });
  EXPECT_THAT(all.times_s(), ElementsAre(11, 12, 13));
  ASSERT_EQ(all.warnings.size(), 1U);
  EXPECT_THAT(
      all.warnings[0],
      HasSubstr("a.mcap:1: has the stamp 100.000000000 s, later than that of a message that "
                "was recorded 3 s after it; a clock was set, or a stamp is wrong; this scan "
                "is left out"));
}

TEST_F(Scans, ThatAreDamagedAreLeftOut) {
  const All all = clouds([](Recording& r) {
    put(r, one_point(1, 0, 0), 1);
    r.bytes("/points", 2, "what is this");
    const std::string whole = one_point(1, 0, 0).cdr(3).bytes();
    r.bytes("/points", 3, whole.substr(0, whole.size() - 9));
    put(r, one_point(1, 0, 0), 4);
  });
  EXPECT_THAT(all.times_s(), ElementsAre(1, 4));
  ASSERT_EQ(all.warnings.size(), 1U);
  EXPECT_THAT(all.warnings[0],
              HasSubstr("a.mcap:2: is not a sensor_msgs/PointCloud2 in CDR: it has "
                        "a head that isn't that of plain CDR, 00 00 or 00 01 and 1 "
                        "more; these scans are left out"));
}

TEST_F(Scans, OfFaultyPointCloudsAreRefused) {
  const auto with = [](auto change) {
    CloudMessage cloud = one_point(1, 2, 3);
    change(cloud);
    return cloud;
  };
  EXPECT_EQ(fault(with([](auto& c) { c.fields[1].name = "v"; })), "a.mcap:1: has no field 'y'");
  EXPECT_EQ(fault(with([](auto& c) { c.fields[1].name = "x"; })), "a.mcap:1: has two fields 'x'");
  EXPECT_EQ(fault(with([](auto& c) { c.fields[2].datatype = 5; })),
            "a.mcap:1: has the field 'z' of datatype 5; it must be FLOAT32, 7, or FLOAT64, 8");
  EXPECT_EQ(fault(with([](auto& c) { c.fields[2].datatype = 8; })),
            "a.mcap:1: has the field 'z' at byte 8 of points of 12 bytes");
  EXPECT_EQ(fault(with([](auto& c) { c.fields[2].offset = 0xFFFFFFFF; })),
            "a.mcap:1: has the field 'z' at byte 4294967295 of points of 12 bytes");
  EXPECT_EQ(fault(with([](auto& c) { c.width = 2; })),
            "a.mcap:1: has 12 bytes of data; 1 rows of 24 bytes need more");
  EXPECT_EQ(fault(with([](auto& c) { c.height = 2; })),
            "a.mcap:1: has rows of 0 bytes; 1 columns of 12 bytes need 12");
  EXPECT_EQ(fault(with([](auto& c) {
              c.height = c.width = c.point_step = 0xFFFFFFFF;
              c.row_step = 0xFFFFFFFF;
            })),
            "a.mcap:1: has rows of 4294967295 bytes; 4294967295 columns of 4294967295 bytes need "
            "18446744065119617025");
  EXPECT_EQ(fault(one_point(1, 2e9F, 3)),
            "a.mcap:1: has the point 1 that is at (1, 2e+09, 3); "
            "coordinates must be metres within 1e+09");
}

TEST_F(Scans, OfFaultyDepthImagesAreRefused) {
  DepthMessage image;
  image.data = std::string(12, 'd');
  EXPECT_EQ(only(image).points_m.size(), 6U);
  DepthMessage other = image;
  other.encoding = "rgb8";
  EXPECT_EQ(fault(other),
            "a.mcap:1: is an image of 'rgb8'; depths are 16UC1, in mm, or 32FC1, in m");
  other = image;
  other.data.pop_back();
  EXPECT_EQ(fault(other), "a.mcap:1: has 11 bytes of data; 2 rows of 6 bytes need more");
  other = image;
  other.step = 5;
  EXPECT_EQ(fault(other), "a.mcap:1: has rows of 5 bytes; 3 columns of 2 bytes need 6");
  EXPECT_EQ(fault(image, {.width = 6}), "a.mcap:1: has 3 x 2 pixels, and its CameraInfo 6 x 2");
  const std::string camera =
      "a.mcap:1: has no usable camera: a message of topic '/cam/camera_info' ";
  EXPECT_EQ(fault(image, {.distortion = 0.1}),
            camera +
                "has a distortion, D, other than 0; use the topic of rectified depths, whose D "
                "is 0");
  EXPECT_EQ(fault(image, {.distortion = kNan}).substr(0, camera.size()), camera);
  EXPECT_EQ(fault(image, {.binning = 2}),
            camera + "has a binning or a region of interest; only whole images are read");
  EXPECT_EQ(fault(image, {.fy = 0}), camera +
                                         "has no K of a pinhole camera, fx 0 cx 0 fy cy 0 0 1, "
                                         "but 100 0 1 0 0 0.5");
  EXPECT_EQ(fault(image, {.cx = std::nan("")}).substr(0, camera.size()), camera);
}

TEST_F(Scans, OfAnotherTopicOrTypeAreRefused) {
  EXPECT_EQ(error_of([](Recording& r) { put(r, one_point(1, 2, 3), 1); }, {{}, "/pionts"}),
            "a.mcap: has no message of topic '/pionts'; its topics are '/points'");
  EXPECT_EQ(error_of([](Recording& r) { r.pose("/points", 1, Vec3::Zero()); }),
            "a.mcap: topic '/points' is of geometry_msgs/PoseStamped; it must be of "
            "sensor_msgs/PointCloud2 or sensor_msgs/Image");
  EXPECT_EQ(error_of([](Recording& r) { put(r, DepthMessage{}, 1); }, {{}, "/cam/depth"}),
            "a.mcap: topic '/cam/depth' has images, and topic '/cam/camera_info' no "
            "sensor_msgs/CameraInfo for them; its topics are '/cam/depth'");
  EXPECT_EQ(test::message_of(folder_,
                             [&] {
                               all_of({{folder_ / "none"}, "/points"});
                             }),
            "none: no such file");
  EXPECT_EQ(test::message_of(folder_,
                             [&] {
                               all_of({{}, "/points"});
                             }),
            "scans need a file or folder in MCAP");
}

TEST_F(Scans, AreTheSameHoweverAFileIsPacked) {
  folder_.write("c.csv", "time,x,y,z\n1.5,1,2,0.3\n2.25,-4,5,6\n4,7,8,9\n");
  folder_.write("d.csv", "time,mm\n1.5,1000\n2.25,500\n4,65000\n");
  folder_.write("i.csv", "time,f,c\n1,500,1\n3,500,-9\n");
  folder_.write("t.csv",
                "time,x,y,z,qx,qy,qz,qw\n1,1,0,0,0,0,0,1\n2,2,0,0,0,0,0,1\n"
                "3,3,0,0,0,0,0,1\n4,4,0,0,0,0,0,1\n");
  for (const char* how : {"", "--chunk 1", "--chunk 3 --compression lz4",
                          "--chunk 100 --compression zstd", "--big-endian --no-summary --idl"}) {
    const std::string command = fmt::format(
        "cd '{}' && python3 '{}/tests/mcap/make_mcap.py' m.mcap {} "
        "cloud:/points:lidar:c.csv camera:/cam/camera_info:optical:i.csv "
        "depth:/cam/depth:optical:d.csv tf:/tf:map:lidar:t.csv",
        folder_.path().string(), SOILVDB_SOURCE_DIR, how);
    ASSERT_EQ(std::system(command.c_str()), 0);
    const All all = all_of({{folder_ / "m.mcap"}, "/points"});
    ASSERT_THAT(all.times_s(), ElementsAre(1.5, 2.25, 4)) << how;
    EXPECT_THAT(all.warnings, IsEmpty());
    const Vec3 points[] = {{1, 2, 0.3}, {-4, 5, 6}, {7, 8, 9}};
    for (std::size_t i = 0; i < 3; ++i) {
      const RecordedScan& scan = all.scans[i];
      EXPECT_EQ(scan.frame_id, "lidar");
      EXPECT_THAT(scan.cloud.points_m, ElementsAre(points[i]));
      EXPECT_EQ(scan.cloud.without_return, 1U);
      ASSERT_TRUE(scan.world_from_sensor);
      EXPECT_NEAR(scan.world_from_sensor->position.x(), scan.time_s, 1e-12);
    }
    const All depths = all_of({{folder_ / "m.mcap"}, "/cam/depth"});
    ASSERT_THAT(depths.times_s(), ElementsAre(1.5, 2.25, 4)) << how;
    EXPECT_THAT(depths.scans[0].cloud.points_m, ElementsAre(Vec3(-1. / 500, 0, 1)));
    EXPECT_THAT(depths.scans[2].cloud.points_m, ElementsAre(Vec3(9. / 500 * 65, 0, 65)));
    EXPECT_EQ(depths.scans[2].cloud.without_return, 1U);
    EXPECT_FALSE(depths.scans[0].world_from_sensor);
  }
}

// --- poses ---

/// A transform with a turn about z.
void turn(Recording& r, const std::string& topic, double stamp_s, const std::string& parent,
          const std::string& child, const Vec3& p, double angle) {
  CdrWriter cdr;
  cdr.put(std::uint32_t{1});
  const CdrWriter head = Recording::stamped(stamp_s, parent);
  for (std::size_t i = 4; i < head.bytes().size(); ++i) cdr.put(head.bytes()[i]);
  cdr.put(std::string_view(child));
  cdr.put_all(p.x(), p.y(), p.z(), 0.0, 0.0, std::sin(angle / 2), std::cos(angle / 2));
  r.message(topic, "tf2_msgs/msg/TFMessage", cdr, stamp_s);
}

/// A lidar that is fixed on a machine, turned by a quarter; the machine drives along x.
void drive(Recording& r, double begin_s, double end_s) {
  for (double s = begin_s; s <= end_s; s += 0.5)
    turn(r, "/tf", s, "map", "base", {2 * s, 0, 0}, 0.1 * s);
}

TEST_F(Scans, OnAMachineHaveThePoseOfTheirTime) {
  const auto recording = [](Recording& r) {
    turn(r, "/tf_static", 0, "base", "lidar", {1, 0, 3}, M_PI / 2);
    for (const double s : {0.5, 1.125, 2.0, 3.0, 7.0}) put(r, one_point(1, 0, 0), s);
    drive(r, 1, 2.5);
    drive(r, 5, 7);  // after a gap
  };
  for (const char* world : {"", "map"}) {
    const All all = clouds(recording, {{}, "/points", {}, "/tf", world});
    ASSERT_EQ(all.scans.size(), 5U);
    EXPECT_FALSE(all.scans[0].world_from_sensor) << "before the first transform";
    EXPECT_FALSE(all.scans[3].world_from_sensor) << "in the gap";
    for (const std::size_t i : {std::size_t{1}, std::size_t{2}, std::size_t{4}}) {
      const double s = all.scans[i].time_s, angle = 0.1 * s;
      ASSERT_TRUE(all.scans[i].world_from_sensor) << s;
      const Pose& pose = *all.scans[i].world_from_sensor;
      // The linear way of the sensor between two transforms leaves its arc by less than r (a/2)^2 /
      // 2, at r = 1 and a = 0.05.
      const Vec3 at(2 * s + std::cos(angle), std::sin(angle), 3);
      EXPECT_LT((pose.position - at).norm(), 0.05 * 0.05 / 8 + 1e-9) << s;
      const Vec3 ahead = pose.rotation * Vec3::UnitX();
      EXPECT_LT((ahead - Vec3(-std::sin(angle), std::cos(angle), 0)).norm(), 1e-9) << s;
    }
    ASSERT_EQ(all.warnings.size(), 1U);
    EXPECT_THAT(all.warnings[0],
                HasSubstr("frame 'base' isn't known from 2.5 to 5 s, a gap; at most "
                          "1.5 s are bridged; poses of frame 'lidar' are unknown "
                          "there"));
  }
}

TEST_F(Scans, OnAMastHaveAFixedPose) {
  const auto recording = [](Recording& r) {
    turn(r, "/tf_static", 0, "map", "mast", {5, 6, 0}, M_PI);
    turn(r, "/tf_static", 0, "mast", "lidar", {1, 0, 3}, 0);
    for (const double s : {1.0, 100.0}) put(r, one_point(1, 0, 0), s);
  };
  for (const bool others_move : {false, true}) {
    const All all = clouds([&](Recording& r) {
      recording(r);
      if (others_move) drive(r, 1, 2);
    });
    EXPECT_THAT(all.warnings, IsEmpty());
    ASSERT_EQ(all.scans.size(), 2U);
    for (const RecordedScan& scan : all.scans) {
      ASSERT_TRUE(scan.world_from_sensor);
      EXPECT_LT((*scan.world_from_sensor * Vec3(1, 0, 0) - Vec3(3, 6, 3)).norm(), 1e-12);
    }
  }
}

TEST_F(Scans, InTheWorldsFrameAreAtItsOrigin) {
  const auto recording = [](Recording& r) {
    put(r, one_point(1, 0, 0), 1, {}, "map");
    drive(r, 1, 2);
  };
  for (const char* world : {"", "map"}) {
    const All all = clouds(recording, {{}, "/points", {}, "/tf", world});
    ASSERT_TRUE(all.scans.at(0).world_from_sensor);
    EXPECT_EQ(all.scans[0].world_from_sensor->position, Vec3::Zero());
  }
  // Without any transform.
  const All alone = clouds([](Recording& r) { put(r, one_point(1, 0, 0), 1, {}, "map"); },
                           {{}, "/points", {}, "/tf", "map"});
  EXPECT_TRUE(alone.scans.at(0).world_from_sensor);
}

TEST_F(Scans, InAnUnknownFrameHaveNoPose) {
  const auto recording = [](Recording& r) {
    put(r, one_point(1, 0, 0), 1, {}, "camera");
    drive(r, 1, 2);
  };
  const All all = clouds(recording);
  EXPECT_FALSE(all.scans.at(0).world_from_sensor);
  ASSERT_EQ(all.warnings.size(), 1U);
  EXPECT_THAT(all.warnings[0], HasSubstr("a.mcap: topic '/tf' has no transform of frame 'camera'"));
  // A world that is named has to be there.
  EXPECT_THAT(error_of(recording, {{}, "/points", {}, "/tf", "map"}),
              HasSubstr("a.mcap: topic '/tf' has no transform of frame 'camera'"));
  EXPECT_THAT(error_of([](Recording& r) { put(r, one_point(1, 0, 0), 1); },
                       {{}, "/points", {}, "/tf", "map"}),
              HasSubstr("a.mcap: has no message of topic '/tf'; its topics are '/points'"));
}

TEST_F(Scans, OfTruncatedOrDamagedMessagesAreReadOrLeftOut) {
  CloudMessage cloud;
  cloud.height = cloud.width = 2;
  cloud.row_step = 24;
  cloud.data = bytes_of(false, 1.F, 2.F, 3.F, 4.F, 5.F, 6.F, 7.F, 8.F, 9.F, 0.F, 0.F, 0.F);
  DepthMessage image;
  image.data = std::string(12, 'd');
  std::mt19937 random(3);
  const auto damaged = [&](Recording& r, const std::string& topic, const std::string& whole) {
    for (std::size_t size = 0; size < whole.size(); ++size)
      r.bytes(topic, 2, whole.substr(0, size));
    for (int i = 0; i < 2000; ++i) {
      std::string one = whole;
      for (int k = 0; k < 2; ++k) one[random() % one.size()] = static_cast<char>(random());
      r.bytes(topic, 2, one);
    }
  };
  const auto look = [&](const All& all) {
    for (const RecordedScan& scan : all.scans) {
      EXPECT_LE(scan.cloud.points_m.size() + scan.cloud.without_return, 6U);
      EXPECT_LE(scan.cloud.points_m.capacity(), 24U);
    }
    for (const std::string& warning : all.warnings) EXPECT_EQ(warning.find('\n'), warning.npos);
  };
  look(clouds([&](Recording& r) {
    put(r, cloud, 1);
    damaged(r, "/points", cloud.cdr(2).bytes());
  }));
  look(clouds(
      [&](Recording& r) {
        put(r, InfoMessage{}, 1);
        put(r, image, 1);
        damaged(r, "/cam/depth", image.cdr(2).bytes());
        damaged(r, "/cam/camera_info", InfoMessage{}.cdr(2).bytes());
        put(r, InfoMessage{}, 3);
        put(r, image, 3);
      },
      {{}, "/cam/depth"}));
}

}  // namespace recorded_scans_test
}  // namespace soilvdb::io
