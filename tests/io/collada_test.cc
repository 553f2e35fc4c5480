// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "soilvdb/io/error.h"
#include "soilvdb/io/mesh_file.h"
#include "tests/io/mesh_corners.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace collada_test {

using ::testing::HasSubstr;

/// A file of one geometry 'g' with five points, the corners of a square and one above it.
std::string file_of(const std::string& faces, const std::string& scene,
                    const std::string& unit = "") {
  return R"(<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>)" +
         unit + R"(<up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="15">0 0 0  1 0 0
1 1 0  0 1 0  0 0 2</float_array>
<technique_common><accessor source="#a" count="5" stride="3"/></technique_common></source>
<source id="n"><float_array id="b" count="3">0 0 1</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
)" + faces +
         "</mesh></geometry></library_geometries>\n" + scene + "</COLLADA>\n";
}
std::string scene_of(const std::string& nodes) {
  return "<library_visual_scenes><visual_scene id=\"s\">" + nodes +
         "</visual_scene></library_visual_scenes>"
         "<scene><instance_visual_scene url=\"#s\"/></scene>";
}
const std::string kInputs =
    "<input semantic=\"NORMAL\" source=\"#n\" offset=\"0\"/>"
    "<input semantic=\"VERTEX\" source=\"#v\" offset=\"1\"/>";
const std::string kTriangle =
    "<triangles count=\"1\">" + kInputs + "<p>0 0 0 1 0 4</p></triangles>";
const std::string kGeometry = "<instance_geometry url=\"#g\"/>";

TEST(Collada, ReadsEachKindOfFaces) {
  const test::TempFolder folder;
  using Points = std::vector<Eigen::Vector3f>;
  const Eigen::Vector3f a(0, 0, 0), b(1, 0, 0), c(1, 1, 0), d(0, 1, 0), e(0, 0, 2);
  const auto read = [&](const std::string& kind, const std::string& rest) {
    return corners(read_mesh(
        folder.write("a.dae", file_of("<" + kind + ">" + kInputs + rest + "</" + kind + ">", ""))));
  };
  EXPECT_EQ(read("triangles", "<p>0 0 0 1 0 2 0 0 0 1 0 4</p>"), (Points{a, b, c, a, b, e}));
  EXPECT_EQ(read("triangles", "<p>0 0 0 1<!-- text --> 0 4</p>"), (Points{a, b, e}));
  EXPECT_EQ(read("polylist", "<vcount>4 3</vcount><p>0 0 0 1 0 2 0 3 0 0 0 1 0 4</p>"),
            (Points{a, b, c, a, c, d, a, b, e}));
  EXPECT_EQ(read("polygons", "<p>0 0 0 1 0 2 0 3</p><p>0 0 0 1 0 4</p>"),
            (Points{a, b, c, a, c, d, a, b, e}));
  EXPECT_EQ(read("trifans", "<p>0 0 0 1 0 2 0 3</p>"), (Points{a, b, c, a, c, d}));
  // Each triangle of a strip turns the same way.
  EXPECT_EQ(read("tristrips", "<p>0 0 0 1 0 3 0 2 0 4</p>"), (Points{a, b, d, d, b, c, d, c, e}));
  EXPECT_THAT(test::message_of(folder, [&] { read("lines", "<p>0 0 0 1</p>"); }),
              HasSubstr("has no triangles"));
}

TEST(Collada, PlacesNodesAsTheySay) {
  // Chains of nodes with all kinds of transforms against the same by products of 4 x 4 matrices.
  const test::TempFolder folder;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-2, 2);
  const auto turned = [](double degrees, const Vec3& axis) {
    // Rodrigues' formula.
    const double angle = degrees * 3.14159265358979323846 / 180;
    const Vec3 k = axis / axis.norm();
    Eigen::Matrix3d cross;
    cross << 0, -k.z(), k.y(), k.z(), 0, -k.x(), -k.y(), k.x(), 0;
    return Eigen::Matrix3d(Eigen::Matrix3d::Identity() + std::sin(angle) * cross +
                           (1 - std::cos(angle)) * cross * cross);
  };
  for (int n = 0; n < 50; ++n) {
    const double unit = n % 2 == 0 ? 1 : 0.0254;
    Eigen::Matrix4d all = Eigen::Matrix4d::Identity();
    all.topLeftCorner<3, 3>() *= unit;
    std::string nodes, ends;
    for (int depth = 0; depth < 3; ++depth) {
      nodes += "<node>";
      ends += "</node>";
      for (int k = 0; k < 3; ++k) {
        Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
        const Vec3 v(any(random), any(random), any(random));
        switch (random() % 4) {
          case 0:
            m.topRightCorner<3, 1>() = v;
            nodes += fmt::format("<translate>{} {} {}</translate>", v.x(), v.y(), v.z());
            break;
          case 1:
            m.diagonal().head<3>() = v;
            nodes += fmt::format("<scale>{} {} {}</scale>", v.x(), v.y(), v.z());
            break;
          case 2: {
            const double degrees = 90 * any(random);
            m.topLeftCorner<3, 3>() = turned(degrees, v);
            nodes += fmt::format("<rotate>{} {} {} {}</rotate>", v.x(), v.y(), v.z(), degrees);
            break;
          }
          default:
            for (int row = 0; row < 3; ++row)
              for (int column = 0; column < 4; ++column) m(row, column) = any(random);
            nodes += "<matrix>";
            for (int i = 0; i < 16; ++i) nodes += fmt::format("{} ", m(i / 4, i % 4));
            nodes += "</matrix>";
        }
        all = all * m;
      }
    }
    const Mesh mesh = read_mesh(
        folder.write("a.dae", file_of(kTriangle, scene_of(nodes + kGeometry + ends),
                                      unit == 1 ? "" : "<unit name=\"inch\" meter=\"0.0254\"/>")));
    const std::vector<Eigen::Vector3f> found = corners(mesh);
    ASSERT_EQ(found.size(), 3U);
    const Vec3 points[] = {{0, 0, 0}, {1, 0, 0}, {0, 0, 2}};
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 right = (all * points[k].homogeneous()).head<3>();
      EXPECT_LT((found[k].cast<double>() - right).norm(), 1e-6 * (1 + right.norm()))
          << "draw " << n << " corner " << k;
    }
  }
}

TEST(Collada, ANodeMayStandForAnother) {
  const test::TempFolder folder;
  const auto read = [&](const std::string& scene) {
    return read_mesh(folder.write("a.dae", file_of(kTriangle, scene))).triangles.size();
  };
  EXPECT_EQ(read(scene_of("<node id=\"one\">" + kGeometry +
                          "</node><node><translate>5 0 0</translate>"
                          "<instance_node url=\"#one\"/></node>")),
            2U);
  EXPECT_EQ(read(""), 1U) << "without a scene";
  const auto said = [&](const std::string& scene) {
    return test::message_of(folder, [&] { read(scene); });
  };
  EXPECT_THAT(said(scene_of("<node id=\"one\"><instance_node url=\"#one\"/></node>")),
              HasSubstr("stands for itself"));
  // Nodes that stand for two others each, down to one.
  const auto doubled = [&](int levels) {
    std::string nodes = "<library_nodes><node id=\"n0\">" + kGeometry + "</node>";
    for (int i = 1; i <= levels; ++i)
      nodes += fmt::format(
          "<node id=\"n{0}\"><instance_node url=\"#n{1}\"/><instance_node url=\"#n{1}\"/></node>",
          i, i - 1);
    return nodes + "</library_nodes>" +
           scene_of(fmt::format("<node><instance_node url=\"#n{}\"/></node>", levels));
  };
  EXPECT_EQ(read(doubled(10)), 1024U);
  EXPECT_THAT(said(doubled(40)), HasSubstr("one of more than"));
  // Faces that make no triangles are read once, not 2^16 times.
  std::string edges = "<polygons>" + kInputs;
  for (int i = 0; i < 3000; ++i) edges += "<p>0 0 0 1</p>";
  const auto file = folder.write("a.dae", file_of(edges + "</polygons>", doubled(16)));
  EXPECT_THAT(test::message_of(folder, [&] { read_mesh(file); }), HasSubstr("has no triangles"));
}

TEST(Collada, RefusesWhatItCannotRead) {
  const test::TempFolder folder;
  const auto said = [&](const std::string& text) {
    return test::message_of(folder, [&] { read_mesh(folder.write("a.dae", text)); });
  };
  const auto faces = [&](const std::string& f) { return said(file_of(f, "")); };
  EXPECT_THAT(said("x"), HasSubstr("a.dae:1: isn't XML; a .dae begins with <COLLADA ..>"));
  EXPECT_THAT(said("<robot/>"), HasSubstr("a.dae:1: <robot> is not the <COLLADA> of a .dae"));
  EXPECT_THAT(said("<COLLADA>"), HasSubstr("isn't closed"));
  EXPECT_THAT(faces("<triangles><p>0 1 2</p></triangles>"), HasSubstr("<triangles> has no <input"));
  EXPECT_THAT(faces("<triangles>" + kInputs + "<p>0 0 0 1 0 5</p></triangles>"),
              HasSubstr("a.dae:10: <p> has the corner 5; there are 5 points"));
  EXPECT_THAT(faces("<triangles>" + kInputs + "<p>0 0 0 1 0</p></triangles>"),
              HasSubstr("has 5 indices; each corner has 2"));
  EXPECT_THAT(faces("<triangles>" + kInputs + "<p>0 0 0 1</p></triangles>"),
              HasSubstr("a triangle without three corners"));
  EXPECT_THAT(faces("<triangles>" + kInputs + "<p>0 -1</p></triangles>"), HasSubstr("'-1'"));
  for (const char* vcount : {"4", "2", "4294967295"})
    EXPECT_THAT(faces("<polylist>" + kInputs + "<vcount>" + vcount +
                      "</vcount><p>0 0 0 1 0 2</p></polylist>"),
                HasSubstr("corners than <vcount> says"));
  EXPECT_THAT(faces("<polygons>" + kInputs + "<ph><p>0 0 0 1 0 2</p></ph></polygons>"),
              HasSubstr("with holes"));
  EXPECT_THAT(said(file_of(kTriangle, scene_of("<node><skew>1 0 0 0 0 0 0</skew></node>"))),
              HasSubstr("<skew> isn't read"));
  EXPECT_THAT(said(file_of(kTriangle, scene_of("<node><rotate>0 0 0 9</rotate></node>"))),
              HasSubstr("without a direction"));
  EXPECT_THAT(said(file_of(kTriangle, scene_of("<node><translate>0 0</translate></node>"))),
              HasSubstr("has 2 numbers; it must have 3"));
  EXPECT_THAT(said(file_of(kTriangle, scene_of("<node><translate>0 0 x</translate></node>"))),
              HasSubstr("has 'x' where a number is needed"));
  EXPECT_THAT(said(file_of(kTriangle, scene_of("<node><instance_controller url=\"#c\"/></node>"))),
              HasSubstr("skinned"));
  EXPECT_THAT(said(file_of(kTriangle, scene_of("<node><instance_geometry url=\"#v\"/></node>"))),
              HasSubstr("names '#v', but there is no such <geometry>"));
  EXPECT_THAT(said(file_of(kTriangle, "", "<unit meter=\"0\"/>")), HasSubstr("above 0"));
  // Whatever is done to a file: a mesh or a refusal.
  const std::string whole = file_of(kTriangle, scene_of("<node>" + kGeometry + "</node>"));
  std::mt19937 random(4);
  for (int i = 0; i < 3000; ++i) {
    std::string other = whole;
    for (int k = 0; k < 3; ++k) other[random() % other.size()] = static_cast<char>(random() % 128);
    if (i % 3 == 0) other.erase(random() % other.size(), random() % 40);
    try {
      read_mesh(folder.write("x.dae", other));
    } catch (const InputError&) {
    }
  }
}

}  // namespace collada_test
}  // namespace soilvdb::io
