// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include "soilvdb/io/error.h"
#include "soilvdb/io/mesh_file.h"
#include "tests/io/mesh_corners.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace mesh_read_test {

using ::testing::HasSubstr;

/// A corner of a cube: four points, four triangles.
Mesh corner() {
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {0.5F, 0, 0}, {0, 1.25F, 0}, {0, 0, 2}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  return mesh;
}

TEST(ReadMesh, GivesBackWhatIsWritten) {
  const test::TempFolder folder;
  for (const char* name : {"a.stl", "a.obj"}) {
    write_mesh(folder / name, corner(), Vec3::Zero(), "");
    const Mesh mesh = read_mesh(folder / name);
    EXPECT_EQ(mesh.points.size(), 4U) << name << ": points at one place are one";
    EXPECT_EQ(corners(mesh), corners(corner())) << name;
  }
}

TEST(ReadMesh, TakesTextAsProgramsWriteIt) {
  const test::TempFolder folder;
  const Mesh obj = read_mesh(folder.write(
      "a.obj",
      "# a square\r\nmtllib none.mtl\no x\nv 0 0 0 1.0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\n"
      "f 1/1/1 2//1 -2 -1\n"));
  EXPECT_EQ(obj.triangles.size(), 2U);
  const Mesh stl = read_mesh(folder.write(
      "a.STL",
      "solid x\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1e0 0 0\n"
      "   vertex 0 1 -2.5e-1\n  endloop\n endfacet\nendsolid\n"));
  ASSERT_EQ(stl.triangles.size(), 1U);
  EXPECT_EQ(stl.points[2], Eigen::Vector3f(0, 1, -0.25F));
}

TEST(ReadMesh, RefusesWhatIsNone) {
  const test::TempFolder folder;
  const auto said = [&](const char* name, const std::string& bytes) {
    const auto file = folder.write(name, bytes);
    return test::message_of(folder, [&] { read_mesh(file); });
  };
  EXPECT_THAT(said("a.obj", ""), HasSubstr("a.obj: has no triangles"));
  EXPECT_THAT(said("a.obj", "v 0 0\n"), HasSubstr("a.obj:1: not a coordinate: ''"));
  EXPECT_THAT(said("a.obj", "v 0 0 0\nf 1 2 3\n"), HasSubstr("a.obj:2: a face has the corner '2'"));
  EXPECT_THAT(said("a.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), HasSubstr("not a number"));
  EXPECT_THAT(said("a.stl", "solid\nvertex 1 2 x\n"), HasSubstr("a.stl:2: not a coordinate: 'x'"));
  EXPECT_THAT(said("a.stl", std::string(200, 'x')),
              HasSubstr("a.stl: is damaged or not an STL file"));
  EXPECT_THAT(said("a.ply", "ply\n"),
              HasSubstr("a.ply: is not a readable mesh; use .stl, .obj or .dae"));
  // Whatever is done to a file: a mesh or a refusal.
  write_mesh(folder / "whole.stl", corner(), Vec3::Zero(), "");
  write_mesh(folder / "whole.obj", corner(), Vec3::Zero(), "");
  std::mt19937 random(4);
  for (const char* whole : {"whole.stl", "whole.obj"}) {
    std::ifstream in(folder / whole, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(in), {}};
    for (int i = 0; i < 2000; ++i) {
      std::string other = bytes.substr(0, i % 3 == 0 ? random() % bytes.size() : bytes.size());
      for (int k = 0; k < 3 && !other.empty(); ++k)
        other[random() % other.size()] = static_cast<char>(random());
      try {
        read_mesh(folder.write(std::string("x") + (whole + 5), other));
      } catch (const InputError&) {
      }
    }
  }
}

}  // namespace mesh_read_test
}  // namespace soilvdb::io
