// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/mesh_file.h"

#include <assimp/scene.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <assimp/Importer.hpp>
#include <fstream>
#include <map>
#include <sstream>
#include <utility>

#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace mesh_file_test {

using test::TempFolder;
using ::testing::HasSubstr;

const Vec3 kOrigin(556400, 5394900.5, 500);

/// A closed box of 1 x 2 x 3 m, its corner at numbers that have no short decimal form.
Mesh box() {
  Mesh mesh;
  for (int i = 0; i < 8; ++i) {
    mesh.points.emplace_back(1.0f / 3 + float(i & 1), 2.0f / 7 + 2 * float(i >> 1 & 1),
                             -1.0f / 9 + 3 * float(i >> 2));
  }
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

/// Six times the signed volume.
double volume6(const Mesh& mesh) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.points[t[0]].cast<double>(), b = mesh.points[t[1]].cast<double>(),
               c = mesh.points[t[2]].cast<double>();
    sum += a.dot(b.cross(c));
  }
  return sum;
}

Mesh read_back(const std::filesystem::path& file) {
  Assimp::Importer importer;
  const aiScene* scene = importer.ReadFile(file.string(), 0);
  Mesh mesh;
  if (scene == nullptr || scene->mNumMeshes != 1) {
    ADD_FAILURE() << importer.GetErrorString();
    return mesh;
  }
  const aiMesh& in = *scene->mMeshes[0];
  for (unsigned i = 0; i < in.mNumVertices; ++i) {
    mesh.points.emplace_back(in.mVertices[i].x, in.mVertices[i].y, in.mVertices[i].z);
  }
  for (unsigned i = 0; i < in.mNumFaces; ++i) {
    const unsigned* t = in.mFaces[i].mIndices;
    mesh.triangles.push_back({t[0], t[1], t[2]});
  }
  return mesh;
}

/// Makes one of vertices with the same bits.
Mesh joined(const Mesh& in) {
  Mesh out;
  std::map<std::array<float, 3>, std::uint32_t> seen;
  for (auto t : in.triangles) {
    for (auto& v : t) {
      const Eigen::Vector3f& p = in.points[v];
      const auto next = static_cast<std::uint32_t>(out.points.size());
      const auto [at, fresh] = seen.try_emplace({p.x(), p.y(), p.z()}, next);
      if (fresh) out.points.push_back(p);
      v = at->second;
    }
    out.triangles.push_back(t);
  }
  return out;
}

/// Edges that are not shared by two triangles in opposite directions.
int open_edges(const Mesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
  }
  int open = 0;
  for (const auto& [edge, count] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    open += count != 1 || back == edges.end() || back->second != 1;
  }
  return open;
}

std::string content(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

class MeshFile : public ::testing::TestWithParam<const char*> {};

TEST_P(MeshFile, IsReadBackAsTheSameClosedSurface) {
  const TempFolder folder;
  const std::string name = std::string("a.") + GetParam();
  write_mesh(folder / name, box(), kOrigin, "LOCAL_CS[\"site\"]");
  const std::string format = GetParam();
  Mesh back = read_back(folder / name);
  if (format == "stl" || format == "obj") {  // STL and Assimp's OBJ reader share no vertices
    EXPECT_EQ(back.points.size(), 36u);
    back = joined(back);
  }
  EXPECT_EQ(back.points.size(), 8u);
  EXPECT_EQ(back.triangles.size(), 12u);
  EXPECT_EQ(open_edges(back), 0);
  EXPECT_NEAR(volume6(back), 36, 1e-4);  // 3 x 2 x 1 m in float; outward
  Eigen::AlignedBox3f bounds;
  for (const auto& p : back.points) bounds.extend(p);
  if (format == "glb") {  // y up
    EXPECT_EQ(bounds.min(),
              Eigen::Vector3f(box().points[0].x(), box().points[0].z(), -box().points[2].y()));
  } else {
    EXPECT_EQ(bounds.min(), box().points[0]);
    EXPECT_EQ(bounds.max(), box().points[7]);
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, MeshFile, ::testing::Values("ply", "obj", "stl", "glb"));

TEST(MeshFile, SaysWhereItIs) {
  const TempFolder folder;
  for (const char* name : {"a.ply", "a.obj", "a.stl", "a.glb"}) {
    write_mesh(folder / name, box(), kOrigin, "LOCAL_CS[\"site\",\n UNIT[\"metre\",1]]");
  }
  const std::string ply = content(folder / "a.ply");
  EXPECT_TRUE(
      ply.starts_with("ply\nformat binary_little_endian 1.0\n"
                      "comment origin 556400 5394900.5 500\n"
                      "comment crs LOCAL_CS[\"site\",  UNIT[\"metre\",1]]\n"));
  const std::string obj = content(folder / "a.obj");
  EXPECT_TRUE(obj.starts_with("# origin 556400 5394900.5 500\n# crs LOCAL_CS[\"site\","));
  const std::string stl = content(folder / "a.stl");
  EXPECT_EQ(stl.size(), 84u + 12 * 50);
  EXPECT_TRUE(stl.starts_with("soilvdb origin 556400 5394900.5 500"));
  const std::string glb = content(folder / "a.glb");
  EXPECT_TRUE(glb.starts_with("glTF"));
  EXPECT_THAT(glb, HasSubstr("\"origin\":[556400.0,5394900.5,500.0]"));
}

TEST(MeshFile, TheSameMeshMakesTheSameBytes) {
  const TempFolder folder;
  for (const char* suffix : {".ply", ".obj", ".stl", ".glb"}) {
    write_mesh(folder / (std::string("a") + suffix), box(), kOrigin, "");
    write_mesh(folder / (std::string("b") + suffix), box(), kOrigin, "");
    EXPECT_EQ(content(folder / (std::string("a") + suffix)),
              content(folder / (std::string("b") + suffix)))
        << suffix;
  }
}

TEST(MeshFile, IsRefusedWhereItCantBeWritten) {
  const TempFolder folder;
  EXPECT_THAT(test::message_of(folder, [&] { write_mesh(folder / "a.dae", box(), kOrigin, ""); }),
              HasSubstr("unknown mesh format '.dae'"));
  EXPECT_THAT(
      test::message_of(folder, [&] { write_mesh(folder / "no/a.ply", box(), kOrigin, ""); }),
      HasSubstr("no/a.ply: can't be written"));
  EXPECT_THAT(test::message_of(folder, [&] { write_mesh(folder / "a.ply", {}, kOrigin, ""); }),
              HasSubstr("no surface to write"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(StlFile, NormalsOfAnStlPointOutwards) {
  const test::TempFolder folder;
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {2, 0, 0}, {0, 3, 0}, {0, 0, 1}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};  // of a tetrahedron, outwards
  io::write_mesh(folder / "a.stl", mesh, Vec3::Zero(), "");
  std::ostringstream text;
  text << std::ifstream(folder / "a.stl", std::ios::binary).rdbuf();
  const std::string bytes = text.str();
  for (std::size_t k = 0; k < mesh.triangles.size(); ++k) {
    Eigen::Vector3f normal, a, b, c;
    const char* at = bytes.data() + 84 + 50 * k;
    for (Eigen::Vector3f* v : {&normal, &a, &b, &c}) {
      std::memcpy(v->data(), at, 12);
      at += 12;
    }
    EXPECT_LT((normal - (b - a).cross(c - a).normalized()).norm(), 1e-6f) << k;
  }
}

}  // namespace mesh_file_test
}  // namespace soilvdb::io
