// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans of each format, from bytes that are put together here by the formats' specifications.
#include "soilvdb/io/point_cloud.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace point_cloud_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

/// The bytes of numbers, least significant first.
template <typename... T>
std::string le(T... values) {
  std::string bytes;
  (bytes.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
  return bytes;
}
/// Most significant first.
template <typename... T>
std::string be(T... values) {
  std::string bytes;
  const auto put = [&](const std::string& one) { bytes.append(one.rbegin(), one.rend()); };
  (put(le(values)), ...);
  return bytes;
}

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

class Points : public ::testing::Test {
 protected:
  PointCloud read(const std::string& bytes, const std::string& name = "a.scan") const {
    return read_points(folder_.write(name, bytes));
  }
  std::string error(const std::string& bytes, const std::string& name = "a.scan") const {
    const auto file = folder_.write(name, bytes);
    return test::message_of(folder_, [&] { read_points(file); });
  }
  void expect_three(const std::string& bytes) const {
    const PointCloud cloud = read(bytes);
    EXPECT_THAT(cloud.points_m, ElementsAre(Vec3(1, -2, 0.5), Vec3(4, 5, 6)));
    EXPECT_EQ(cloud.without_return, 1U);
  }

  const test::TempFolder folder_;
};

// --- PLY ---

std::string ply(const std::string& format, const std::string& elements, const std::string& data) {
  return "ply\nformat " + format + " 1.0\ncomment of a test\n" + elements + "end_header\n" + data;
}
const char* const kThreeVertices =
    "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";

TEST_F(Points, OfPlyAreTextOrBinaryOfBothByteOrders) {
  expect_three(ply("ascii", kThreeVertices, "1 -2 .5\n\n4 5 6.0e0 \nnan 0 0\n"));
  expect_three(ply("binary_little_endian", kThreeVertices,
                   le(1.F, -2.F, 0.5F, 4.F, 5.F, 6.F, 0.F, 0.F, 0.F)));
  expect_three(
      ply("binary_big_endian", kThreeVertices, be(1.F, -2.F, 0.5F, 4.F, 5.F, 6.F, 7.F, kNan, 0.F)));
}

TEST_F(Points, OfPlyStandAmongOtherPropertiesAndElements) {
  const std::string elements =
      "obj_info by hand\nelement camera 2\nproperty list uchar short steps\nproperty double t\n"
      "element vertex 3\nproperty uchar red\nproperty double z\nproperty list uint8 float32 w\n"
      "property int16 x\nproperty float y\n"
      "element face 9\nproperty list uchar int vertex_indices\n";
  const auto binary = [](auto bytes) {
    const auto u8 = [](int i) { return static_cast<std::uint8_t>(i); };
    const auto i16 = [](int i) { return static_cast<std::int16_t>(i); };
    return bytes(u8(3), i16(7), i16(8), i16(9), 0.25) + bytes(u8(0), 0.5) +
           bytes(u8(9), 0.5, u8(0), i16(1), -2.F) + bytes(u8(9), 6., u8(2), 1.F, 2.F, i16(4), 5.F) +
           bytes(u8(9), 0., u8(1), 1.F, i16(0), 0.F);
  };
  expect_three(ply("binary_little_endian", elements, binary([](auto... v) { return le(v...); })));
  expect_three(ply("binary_big_endian", elements, binary([](auto... v) { return be(v...); })));
  expect_three(ply("ascii", elements,
                   "3 7 8 9 .25\n0 .5\n9 .5 0 1 -2\n9 6 2 1 2 4 5\n9 0 1 1 0 0\n3 0 1 2\n"));
  // Lines may end as those of Windows.
  expect_three(
      "ply\r\nformat binary_little_endian 1.0\r\nelement vertex 3\r\nproperty int x\r\n"
      "property int y\r\nproperty double z\r\nend_header\r\n" +
      le(1, -2, 0.5) + le(4, 5, 6.) + le(0, 0, 0.));
}

TEST_F(Points, OfPlyHaveEachTypeOfNumber) {
  const auto x_of = [&](const std::string& type, const std::string& bytes) {
    const PointCloud cloud =
        read(ply("binary_little_endian",
                 "element vertex 1\nproperty " + type + " x\nproperty uchar y\nproperty uchar z\n",
                 bytes + le(std::uint8_t{1}, std::uint8_t{2})));
    EXPECT_EQ(cloud.points_m.at(0).tail<2>(), Vec2(1, 2));
    return cloud.points_m[0].x();
  };
  EXPECT_EQ(x_of("char", le(std::int8_t{-100})), -100);
  EXPECT_EQ(x_of("uint8", le(std::uint8_t{200})), 200);
  EXPECT_EQ(x_of("short", le(std::int16_t{-30000})), -30000);
  EXPECT_EQ(x_of("ushort", le(std::uint16_t{60000})), 60000);
  EXPECT_EQ(x_of("int32", le(std::int32_t{-70000})), -70000);
  EXPECT_EQ(x_of("uint", le(std::uint32_t{900'000'000})), 900'000'000);
  EXPECT_EQ(x_of("float32", le(0.1F)), double{0.1F});
  EXPECT_EQ(x_of("float64", le(512345.678)), 512345.678);
}

TEST_F(Points, OfBadPlyAreRefusedAtTheirLineOrByte) {
  const std::string three = kThreeVertices;
  EXPECT_EQ(error(ply("ascii", three, "1 2 3\n4 5 6\n")),
            "a.scan:10: is the last line, after 2 of 3 elements 'vertex'");
  EXPECT_EQ(error(ply("ascii", three, "1 2 3\n4 5\n7 8 9\n")),
            "a.scan:10: z is ''; it must be a number, such as -1.5e3");
  EXPECT_EQ(error(ply("ascii", three, "1 2 3\n4 5,0 6\n7 8 9\n")),
            "a.scan:10: y is '5,0'; it must be a number, such as -1.5e3");
  EXPECT_EQ(error(ply("ascii", three, "1 2 3\n4 5 6\n7 8 -2e9\n")),
            "a.scan:11: a point is at (7, 8, -2e+09); coordinates must be metres within 1e+09");
  EXPECT_EQ(error(ply("binary_little_endian", three, std::string(35, '\0'))),
            "a.scan: is truncated or damaged: 3 elements 'vertex' of 12 bytes each, from byte 133 "
            "on, don't fit into a file of 168 bytes");
  EXPECT_EQ(error(ply("binary_little_endian", three,
                      le(1.F, 2.F, 3.F, 1.F, 1e20F, 3.F) + std::string(12, '\0'))),
            "a.scan: point 2 is at (1, 1e+20, 3); coordinates must be metres within 1e+09");
  EXPECT_EQ(error(ply("binary_middle_endian", three, "")),
            "a.scan:2: has the format 'binary_middle_endian 1.0'; it must be ascii, "
            "binary_little_endian or binary_big_endian, and 1.0");
  EXPECT_EQ(error("ply\nelement vertex 0\nend_header\n"),
            "a.scan:3: the header has no line 'format'");
  EXPECT_EQ(error(ply("ascii", "element face 1\nproperty int a\n", "")),
            "a.scan:6: the header has no 'element vertex'");
  EXPECT_EQ(error(ply("ascii", "element vertex 1\nproperty int x\nproperty int y\n", "")),
            "a.scan:7: 'element vertex' has no number 'property float z'");
  EXPECT_EQ(error(ply("ascii", three + "property float y\n", "")),
            "a.scan:9: 'element vertex' has two properties 'y'");
  EXPECT_EQ(error(ply("ascii", "element vertex -1\n", "")),
            "a.scan:4: '-1' is no number of elements");
  EXPECT_EQ(error(ply("ascii", "property float x\n", "")),
            "a.scan:4: a property precedes all elements");
  EXPECT_EQ(error(ply("ascii", "element vertex 1\nproperty half x\n", "")),
            "a.scan:5: 'half' is no type of PLY, such as float or double");
  EXPECT_EQ(error(ply("ascii", "element a 1\nproperty list float int x\n", "")),
            "a.scan:5: a list's length must have a type of integers");
  EXPECT_EQ(error(ply("ascii", "vertices 4\n", "")),
            "a.scan:4: 'vertices' is no line of a PLY header, which 'end_header' must end");
  EXPECT_EQ(error("ply\nformat ascii 1.0\n"),
            "a.scan:2: ends within the header; 'end_header' must end it");
  EXPECT_EQ(
      error(ply("ascii", "element vertex 0\nproperty int x\nproperty int y\nproperty int z\n", "")),
      "a.scan: has no points");
  const std::string lists = "element a 1\nproperty list char double l\n" + three;
  EXPECT_EQ(error(ply("binary_little_endian", lists, le(std::int8_t{-3}) + std::string(99, '\0'))),
            "a.scan: has a list of -3 numbers at byte 173");
  EXPECT_EQ(error(ply("binary_little_endian", lists, le(std::int8_t{99}) + std::string(99, '\0'))),
            "a.scan: is truncated or damaged: 99 numbers of 8 bytes each, from byte 174 on, don't "
            "fit into a file of 273 bytes");
}

// --- PCD ---

std::string pcd(const std::string& fields, const std::string& points, const std::string& data) {
  return "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n" + fields + points +
         "VIEWPOINT 0 0 0 1 0 0 0\nDATA " + data;
}
const char* const kXyz = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n";
const char* const kThreePoints = "WIDTH 3\nHEIGHT 1\nPOINTS 3\n";
/// With colours, padding and a field of several numbers.
const char* const kRich =
    "FIELDS rgb _ y normal x z\nSIZE 4 1 4 4 8 2\nTYPE U U F F F I\n"
    "COUNT 1 3 1 2 1 1\n";

/// A block of literal bytes only.
std::string lzf_literals(const std::string& bytes) {
  std::string block;
  for (std::size_t at = 0; at < bytes.size(); at += 32) {
    const std::string part = bytes.substr(at, 32);
    block += static_cast<char>(part.size() - 1);
    block += part;
  }
  return block;
}
std::string compressed(const std::string& block, std::size_t size) {
  return "binary_compressed\n" + le(static_cast<std::uint32_t>(block.size())) +
         le(static_cast<std::uint32_t>(size)) + block;
}

TEST_F(Points, OfPcdAreTextOrBinary) {
  expect_three(pcd(kXyz, kThreePoints, "ascii\n1 -2 0.5\n4 5 6\nnan nan nan\n"));
  expect_three(
      pcd(kXyz, kThreePoints, "binary\n" + le(1.F, -2.F, .5F, 4.F, 5.F, 6.F, 0.F, 0.F, 0.F)));
  // What POINTS or COUNT would say may be missing, and older files have other words.
  expect_three(
      "VERSION .5\nCOLUMNS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 3\nDATA ascii\n"
      "1 -2 0.5\n4 5 6\n0 0 0\n");
  expect_three(pcd(kXyz, "WIDTH 1\nHEIGHT 3\n", "ascii\n1 -2 0.5\n4 5 6\n0 0 0\n"));
}

TEST_F(Points, OfPcdStandAmongOtherFields) {
  const std::string three = "WIDTH 3\nHEIGHT 1\nPOINTS 3\n";
  std::string rich = kRich;
  rich.replace(rich.find("SIZE 4 1 4 4 8 2"), 16, "SIZE 4 1 4 4 8 4");
  rich.replace(rich.find("TYPE U U F F F I"), 16, "TYPE U U F F F F");
  expect_three(
      pcd(rich, three, "ascii\n7 0 0 0 -2 9 9 1 .5\n7 0 0 0 5 9 9 4 6\n7 1 1 1 0 9 9 0 0\n"));
  const auto point = [](float y, double x, float z) {
    return le(std::uint32_t{7}) + std::string(3, 'p') + le(y, 9.F, 9.F, x, z);
  };
  expect_three(pcd(rich, three, "binary\n" + point(-2, 1, .5F) + point(5, 4, 6) + point(0, 0, 0)));
}

TEST_F(Points, OfCompressedPcdHaveEachFieldInOnePiece) {
  const std::string columns = le(1.F, 4.F, 0.F, -2.F, 5.F, 0.F, .5F, 6.F, 0.F);
  expect_three(pcd(kXyz, kThreePoints, compressed(lzf_literals(columns), columns.size())));
  // With padding, and as PCL writes it, without.
  const std::string ints = "FIELDS x _ y z\nSIZE 2 1 4 8\nTYPE I U F F\nCOUNT 1 5 1 1\n";
  const auto i16 = [](int i) { return static_cast<std::int16_t>(i); };
  const std::string x = le(i16(1), i16(4), i16(0));
  const std::string yz = le(-2.F, 5.F, 0.F) + le(.5, 6., 0.);
  for (const std::string& all : {x + yz, x + std::string(15, 'p') + yz})
    expect_three(pcd(ints, kThreePoints, compressed(lzf_literals(all), all.size())));
}

TEST_F(Points, OfCompressedPcdRepeatWhatCameBefore) {
  // 2000 points at x = y = z = 1: the four bytes of 1.F, and copies of them.
  const std::string one = le(1.F);
  std::size_t left = 2000 * 12 - 4;
  std::string block = "\3" + one;
  while (left > 0) {
    std::size_t length = std::min<std::size_t>(left, 264);
    if (left - length == 1 || left - length == 2) length -= 4;  // copies have three bytes or more
    left -= length;
    if (length >= 9)
      block += std::string("\xE0") + static_cast<char>(length - 9) + '\3';
    else
      block += std::string(1, static_cast<char>((length - 2) << 5)) + '\3';
  }
  const PointCloud cloud =
      read(pcd(kXyz, "WIDTH 2000\nHEIGHT 1\nPOINTS 2000\n", compressed(block, 24000)));
  EXPECT_EQ(cloud.points_m, std::vector<Vec3>(2000, Vec3::Ones()));
  // Copies from 400 bytes back: y and z are x.
  std::string x;
  std::vector<Vec3> diagonal;
  for (int i = 1; i <= 100; ++i) {
    x += le(static_cast<float>(i));
    diagonal.push_back(Vec3::Constant(i));
  }
  std::string far = lzf_literals(x);
  for (int i = 0; i < 3; ++i) far += "\xE1\xFF\x8F";  // 264 bytes
  far += "\xC1\x8F";                                  // 8 bytes
  EXPECT_EQ(read(pcd(kXyz, "WIDTH 10\nHEIGHT 10\n", compressed(far, 1200))).points_m, diagonal);
}

TEST_F(Points, OfBadPcdAreRefusedAtTheirLineOrByte) {
  const std::string xyz = kXyz, three = kThreePoints;
  EXPECT_EQ(error(pcd(xyz, three, "ascii\n1 2 3\n4 5 6\n")),
            "a.scan:13: is the last line, after 2 of 3 points");
  EXPECT_EQ(error(pcd(xyz, three, "ascii\n1 2 3\n4 5\n7 8 9\n")),
            "a.scan:13: ends before the point's field 'z'");
  EXPECT_EQ(error(pcd(xyz, three, "ascii\n1 x 3\n")),
            "a.scan:12: y is 'x'; it must be a number, such as -1.5e3");
  EXPECT_EQ(error(pcd(xyz, three, "binary\n" + std::string(35, '\0'))),
            "a.scan: is truncated or damaged: 3 points of 12 bytes each, from byte 164 on, don't "
            "fit into a file of 199 bytes");
  EXPECT_EQ(error(pcd(xyz, "WIDTH 2\nHEIGHT 2\nPOINTS 3\n", "ascii\n")),
            "a.scan:11: WIDTH 2 times HEIGHT 2 isn't POINTS, 3");
  EXPECT_EQ(error(pcd(xyz, "", "ascii\n")), "a.scan:8: the header has no number of POINTS");
  EXPECT_EQ(error(pcd(xyz, "WIDTH 18446744073709551615\nHEIGHT 9\n", "binary\n")),
            "a.scan: is truncated or damaged: 18446744073709551615 points of 12 bytes each, from "
            "byte 174 on, don't fit into a file of 174 bytes");
  EXPECT_EQ(error(pcd(xyz, "WIDTH many\n", "ascii\n")),
            "a.scan:7: WIDTH is 'many'; it must be a whole number");
  EXPECT_EQ(
      error(pcd(xyz, three, "zipped\n")),
      "a.scan:11: the header must end with DATA ascii, DATA binary or DATA binary_compressed");
  EXPECT_EQ(error(pcd("FIELDS x y z\nSIZE 4 4\n", three, "ascii\n")),
            "a.scan:4: SIZE has too few words for 3 fields");
  EXPECT_EQ(error(pcd("FIELDS x y z\nSIZE 4 4 4 4\n", three, "ascii\n")),
            "a.scan:4: SIZE has more words than the 3 fields");
  EXPECT_EQ(error(pcd("SIZE 4 4 4\n", three, "ascii\n")), "a.scan:3: SIZE precedes FIELDS");
  EXPECT_EQ(error(pcd("FIELDS x y z\nSIZE 4 4 4\n", three, "ascii\n")),
            "a.scan:9: the header needs the lines FIELDS, SIZE and TYPE before DATA");
  EXPECT_EQ(error(pcd("FIELDS x y z\nSIZE 4 4 2\nTYPE F F F\n", three, "ascii\n")),
            "a.scan:10: field 'z' has type 'F' and size 2; there are I and U of 1, 2, 4 and 8 "
            "bytes, and F of 4 and 8");
  EXPECT_EQ(error(pcd("FIELDS x y\nSIZE 4 4\nTYPE F F\n", three, "ascii\n")),
            "a.scan:10: FIELDS has no field 'z' with COUNT 1");
  EXPECT_EQ(error(pcd("FIELDS x y z x\nSIZE 4 4 4 4\nTYPE F F F F\n", three, "ascii\n")),
            "a.scan:10: FIELDS has two fields 'x'");
  EXPECT_EQ(error(pcd("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 0\n", three, "ascii\n")),
            "a.scan:6: a COUNT is 0; it must be from 1 to 1048576");
  EXPECT_EQ(error(pcd(xyz + "SORTED yes\n", three, "ascii\n")),
            "a.scan:7: 'SORTED' is no line of a PCD header, which DATA must end");
}

TEST_F(Points, OfDamagedCompressedPcdAreRefused) {
  const auto damaged = [&](const std::string& block, std::size_t size) {
    return error(pcd(kXyz, "POINTS 1\n", compressed(block, size)));
  };
  EXPECT_EQ(damaged("\2abc", 13),
            "a.scan: is damaged: at byte 162 it claims 13 bytes; the points have 1 x 12");
  const std::string at = "a.scan: is damaged: the compressed block from byte 166 on ";
  EXPECT_EQ(damaged("\2abc", 12), at + "holds less than it should");
  EXPECT_EQ(damaged("\2ab", 12), at + "ends too early");
  EXPECT_EQ(damaged(std::string("\2abc\xE0", 5), 12), at + "ends too early");
  EXPECT_EQ(damaged(std::string("\0a\x20\2", 4), 12), at + "refers to bytes before its beginning");
  EXPECT_EQ(damaged(std::string("\0a\xE0\7\0", 5), 12), at + "holds more than it should");
  EXPECT_EQ(damaged("\14abcdefghijklm", 12), at + "holds more than it should");
  EXPECT_EQ(error(pcd(kXyz, "POINTS 300000000\n", compressed("\2abc", 3'600'000'000))),
            "a.scan: is damaged: the compressed block from byte 174 on is too short for what it "
            "should hold");
  EXPECT_THAT(
      error(pcd(kXyz, "POINTS 1\n", "binary_compressed\n" + le(99, 12))),
      HasSubstr("is truncated: 99 compressed bytes, from byte 166 on, don't fit into a file "
                "of 166 bytes"));
  EXPECT_THAT(
      error(pcd(kXyz, "POINTS 1\n", "binary_compressed\nabc")),
      HasSubstr("is truncated: the sizes of its compressed bytes, at byte 158, are missing"));
}

// --- LAS ---

struct Las {
  std::uint8_t minor = 2, format = 0;
  std::uint16_t head = 227;
  std::uint32_t gap = 0;  ///< bytes between header and points
  std::uint16_t record = 20;
  std::uint32_t count = 2;
  std::uint64_t count14 = 0;
  double scale = 0.01;
  std::string behind = {};

  std::string bytes() const {
    std::string b = "LASF" + std::string(20, '\0') + le(std::uint8_t{1}, minor);
    b.resize(94);
    b += le(head, static_cast<std::uint32_t>(head + gap), std::uint32_t{1'000'000}, format, record,
            count);
    b.resize(131);
    b += le(scale, scale, scale, 500'000., 5'400'000., 100.);
    b.resize(247);
    if (head > 247) b += le(count14);
    b.resize(head);
    b += std::string(gap, 'v');
    for (const auto& p : {std::array{100, -200, 50}, std::array{0, 0, 0}}) {
      b += le(p[0], p[1], p[2]);
      b.resize(b.size() + record - 12, 'r');
    }
    return b + behind;
  }
};

TEST_F(Points, OfLasHaveEachVersionAndFormat) {
  const std::uint16_t sizes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
  for (std::uint8_t format = 0; format < 11; ++format) {
    Las las{.minor = 4, .format = format, .head = 375, .gap = 54, .record = sizes[format]};
    las.count = format < 6 ? 2 : 0;
    las.count14 = 2;
    las.behind = "records of variable length";
    const PointCloud cloud = read(las.bytes());
    EXPECT_THAT(cloud.points_m,
                ElementsAre(Vec3(500'001, 5'399'998, 100.5), Vec3(500'000, 5'400'000, 100)))
        << int{format};
    EXPECT_EQ(cloud.without_return, 0U);
  }
  for (const auto& [minor, head] : {std::pair{0, 227}, {1, 227}, {2, 227}, {3, 235}}) {
    Las las{.minor = static_cast<std::uint8_t>(minor), .head = static_cast<std::uint16_t>(head)};
    las.record = 33;  // with bytes of the user
    EXPECT_EQ(read(las.bytes()).points_m.size(), 2U) << minor;
  }
  // Version 1.4 with the older count only.
  EXPECT_EQ(read(Las{.minor = 4, .head = 375}.bytes()).points_m.size(), 2U);
  EXPECT_EQ(read(Las{.minor = 4, .head = 227}.bytes()).points_m.size(), 2U);
  // (0, 0, 0) is a place as others are.
  std::string origin = Las{}.bytes();
  origin.replace(155, 24, std::string(24, '\0'));
  EXPECT_EQ(read(origin).points_m.at(1), Vec3::Zero());
}

TEST_F(Points, OfBadLasAreRefusedAtTheirByte) {
  EXPECT_EQ(error(Las{}.bytes().substr(0, 100)),
            "a.scan: is truncated: 100 bytes can't hold the header of a LAS file, 227 bytes");
  EXPECT_EQ(error(Las{.minor = 5}.bytes()),
            "a.scan: is LAS 1.5, at byte 24; versions 1.0 to 1.4 are read");
  EXPECT_EQ(error(Las{.format = 11}.bytes()),
            "a.scan: has point format 11, at byte 104; formats 0 to 10 are read");
  EXPECT_EQ(
      error(Las{.format = 3}.bytes()),
      "a.scan: has records of 20 bytes, at byte 105; those of point format 3 have 34 or more");
  EXPECT_EQ(error(Las{.count = 3}.bytes()),
            "a.scan: is truncated or damaged: 3 points of 20 bytes each, from byte 227 on, don't "
            "fit into a file of 267 bytes");
  EXPECT_THAT(error(Las{.minor = 4, .head = 375, .count14 = UINT64_MAX}.bytes()),
              HasSubstr("18446744073709551615 points of 20 bytes each, from byte 375 on"));
  EXPECT_THAT(error(Las{.count = 0}.bytes()), HasSubstr("a.scan: has no points"));
  EXPECT_EQ(error(Las{.scale = std::nan("")}.bytes()),
            "a.scan: has the scale nan and the offset 500000 of x, at bytes 131 and 155; they must "
            "be finite, the scale above 0");
  EXPECT_THAT(error(Las{.scale = 0}.bytes()), HasSubstr("the scale 0"));
  for (const double scale : {1e8, 1e300, 1e308})
    EXPECT_THAT(error(Las{.scale = scale}.bytes()), HasSubstr("the point at byte 227 is at ("))
        << scale;
  std::string early = Las{}.bytes();
  early[96] = 9;
  early[97] = 0;
  EXPECT_EQ(error(early),
            "a.scan: has its points from byte 9 on, by byte 96; the header ends at byte 227");
}

TEST_F(Points, OfPackedFormatsAreRefusedWithTheWayToConvertThem) {
  EXPECT_EQ(error(Las{.format = 0x83}.bytes(), "a b.laz"),
            "a b.laz: is compressed (LAZ), which isn't read; convert it: `pdal translate 'a b.laz' "
            "'a b.las'`, or `laszip -i 'a b.laz' -o 'a b.las'`");
  EXPECT_EQ(error("ASTM-E57" + std::string(99, '\0')),
            "a.scan: is an E57 file, which isn't read; convert it, as by `pdal translate a.scan "
            "a.las`, or by CloudCompare");
}

// --- text ---

TEST_F(Points, OfTextAreTheFirstColumnsOrThoseNamedSo) {
  expect_three("1 -2 .5\n4\t5  6 255\n0 0 0\n");
  expect_three("# a comment\n// X Y Z\n\n1, -2, +0.5, 7\r\n4,5,6\r\nnan,nan,nan");
  expect_three("1;-2;.5\n4; 5;6\n0;0;inf\n");
  expect_three("\xEF\xBB\xBFtime,Z,\"X\",y\n9,.5,1,-2\n9,6,4,5,,\n9,0,0,0\n");
  expect_three("x y z intensity\n1 -2 0.5 9\n4 5 6 9\n0 0 0 9\n");
  expect_three("3\n1 -2 0.5 9 1 2 3\n4 5 6 9 1 2 3\n0 0 0 9 1 2 3\n");  // PTS
}

TEST_F(Points, OfBadTextAreRefusedAtTheirLine) {
  EXPECT_EQ(error("1 2 3\n4 5\n"), "a.scan:2: has 2 columns; at least 3 are needed for x, y and z");
  EXPECT_EQ(error("1 2 3\n\n4 5 six\n"),
            "a.scan:3: z is 'six'; it must be a number, such as -1.5e3");
  EXPECT_EQ(error("1,5;2,5;3,5\n"),
            "a.scan:1: has neither three numbers nor a column 'x': its "
            "columns must be x, y, z, or named so");
  EXPECT_EQ(error("x;y;z\n1,5;2,5;3,5\n"),
            "a.scan:2: x is '1,5'; it must be a number, such as -1.5e3");
  EXPECT_EQ(error("1,5 2,5 3,5\n"), "a.scan:1: y is '5 2'; it must be a number, such as -1.5e3");
  EXPECT_EQ(error("x,y\n1,2\n"),
            "a.scan:1: has neither three numbers nor a column 'z': its columns "
            "must be x, y, z, or named so");
  EXPECT_EQ(error("x,y,Z,z\n1,2,3,4\n"), "a.scan:1: has two columns 'z'");
  EXPECT_EQ(error("1 2 3e9\n"),
            "a.scan:1: a point is at (1, 2, 3e+09); coordinates must be metres within 1e+09");
  EXPECT_EQ(error("1 2 3\r4 5 6\r"), "a.scan:1: z is '3?4'; it must be a number, such as -1.5e3");
  EXPECT_THAT(error("\r\r"), HasSubstr("a.scan:1: has neither three numbers nor a column 'x'"));
  EXPECT_EQ(error("# nothing\n"), "a.scan: has no points");
  EXPECT_EQ(error(""), "a.scan: has no points");
  EXPECT_EQ(error("1 2 3\n\xFFs 5 6\n"),
            "a.scan:2: x is '?s'; it must be a number, such as -1.5e3");
  EXPECT_EQ(error(std::string("PK\3\4\0\0", 6)),
            "a.scan: is not a readable scan; use PLY, PCD, LAS, or text with x, y, z");
}

// --- all ---

TEST_F(Points, OfAFileWithAnothersNameAreRefused) {
  EXPECT_EQ(error("1 2 3\n", "a.ply"),
            "a.ply: is not a ply file: at byte 0 it begins with '1 2 3?'");
  EXPECT_EQ(error("", "a.LAS"), "a.LAS: is not a las file: at byte 0 it begins with ''");
  expect_three(pcd(kXyz, kThreePoints, "ascii\n1 -2 0.5\n4 5 6\nnan nan nan\n"));
  EXPECT_EQ(test::message_of(folder_, [&] { read_points(folder_ / "none.ply"); }),
            "none.ply: no such file");
  EXPECT_EQ(test::message_of(folder_, [&] { read_points(folder_.path()); }).find("is a folder"),
            folder_.path().string().size() + 2);
}

TEST_F(Points, WithoutAnyReturnAreCounted) {
  const PointCloud none = read("0 0 0\nnan 1 1\n");
  EXPECT_TRUE(none.points_m.empty());
  EXPECT_EQ(none.without_return, 2U);
}

TEST_F(Points, OfTruncatedOrDamagedFilesAreReadOrRefusedInOneLine) {
  const std::string columns = le(1.F, 4.F, 0.F, -2.F, 5.F, 0.F, .5F, 6.F, 0.F);
  const std::string lists = "element a 2\nproperty list char short l\n";
  const std::vector<std::string> files = {
      ply("ascii", kThreeVertices, "1 -2 .5\n4 5 6\nnan 0 0\n"),
      ply("binary_big_endian", lists + kThreeVertices,
          be(std::int8_t{1}, std::int16_t{5}, std::int8_t{0}) + std::string(36, 'A')),
      pcd(kRich, kThreePoints, "binary\n" + std::string(3 * 29, 'A')),
      pcd(kXyz, kThreePoints, compressed(lzf_literals(columns), columns.size())),
      Las{.minor = 4, .head = 375, .gap = 9}.bytes(),
      "time,x,y,z\n1,2,3,4\n5,6,7,8\n"};
  const auto look = [&](const std::string& bytes) {
    try {
      const PointCloud cloud = read(bytes);
      EXPECT_LE(cloud.points_m.size() + cloud.without_return, bytes.size());
      EXPECT_LE(cloud.points_m.capacity(), 2 * bytes.size());
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), Not(HasSubstr("\n")));
    }
  };
  std::mt19937 random(7);
  for (const std::string& whole : files) {
    read(whole);
    for (std::size_t size = 0; size < whole.size(); ++size) look(whole.substr(0, size));
    for (int i = 0; i < 300; ++i) {
      std::string damaged = whole;
      for (int k = 0; k < 3; ++k)
        damaged[random() % damaged.size()] = static_cast<char>(random() % 2 ? random() : '9');
      look(damaged);
    }
  }
}

}  // namespace point_cloud_test
}  // namespace soilvdb::io
