// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Meshes are only ever written: any mesh, anywhere, under any name of a coordinate system, must
// make files of the right size that say what they should.
#include <cstring>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "soilvdb/io/mesh_file.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

namespace {

std::string content(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void check_ply(const std::string& bytes, const Mesh& mesh) {
  const std::string_view end = "\nend_header\n";
  const auto at = bytes.find(end);
  fuzz::require(at != bytes.npos, "a PLY has a header");
  fuzz::require(
      bytes.size() - at - end.size() == 12 * mesh.points.size() + 13 * mesh.triangles.size(),
      "a PLY ends where its header says");
}

void check_glb(const std::string& bytes) {
  std::uint32_t whole = 0, json = 0;
  std::memcpy(&whole, bytes.data() + 8, 4);
  std::memcpy(&json, bytes.data() + 12, 4);
  fuzz::require(whole == bytes.size() && json % 4 == 0, "a GLB knows its size");
  const auto header = nlohmann::json::parse(bytes.substr(20, json));
  fuzz::require(header["asset"]["extras"].contains("origin"), "a GLB knows where it is");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  Mesh mesh;
  Vec3 origin = Vec3::Zero();
  std::uint8_t points = 0, triangles = 0;
  std::string_view rest = fuzz::text(data, size);
  const auto take = [&](auto& value) {
    if (rest.size() < sizeof value) return;
    std::memcpy(static_cast<void*>(&value), rest.data(), sizeof value);
    rest.remove_prefix(sizeof value);
  };
  take(points);
  take(triangles);
  for (double& v : origin) take(v);
  for (int i = 0; i < 1 + points; ++i) take(mesh.points.emplace_back(0, 0, 0));
  for (int i = 0; i < 1 + triangles; ++i) {
    std::uint8_t corners[3] = {};
    take(corners);
    auto& triangle = mesh.triangles.emplace_back();
    for (std::size_t k = 0; k < 3; ++k)
      triangle[k] = static_cast<std::uint32_t>(corners[k] % mesh.points.size());
  }
  const std::string crs(rest);
  for (const char* name : {"m.ply", "m.obj", "m.stl", "m.glb"}) {
    fuzz::expect_read_or_refused([&] { io::write_mesh(folder / name, mesh, origin, crs); });
  }
  check_ply(content(folder / "m.ply"), mesh);
  fuzz::require(content(folder / "m.stl").size() == 84 + 50 * mesh.triangles.size(),
                "an STL has its triangles");
  check_glb(content(folder / "m.glb"));
  return 0;
}
