// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads meshes without Assimp, whose importers have had exploitable errors.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <string_view>

#include "io/file/text.h"
#include "io/mesh/collada.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/mesh_file.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::uintmax_t kMostMeshBytes = std::uintmax_t{1} << 29;

using MeshPoint = std::array<float, 3>;

/// Collects triangles, and merges corners with equal coordinates into one point.
class WeldedMesh {
 public:
  std::uint32_t point(const MeshPoint& p) {
    const auto [at, fresh] =
        numbers_.try_emplace(p, static_cast<std::uint32_t>(mesh_.points.size()));
    if (fresh) mesh_.points.emplace_back(p[0], p[1], p[2]);
    return at->second;
  }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (a != b && b != c && c != a) mesh_.triangles.push_back({a, b, c});
  }
  Mesh take() { return std::move(mesh_); }

 private:
  std::map<MeshPoint, std::uint32_t> numbers_;
  Mesh mesh_;
};

/// Words of a text, line by line.
class MeshWords {
 public:
  MeshWords(const std::filesystem::path& file, std::string_view text) : file_(file), text_(text) {}

  bool next_line() {
    if (text_.empty()) return false;
    const std::size_t end = std::min(text_.find('\n'), text_.size());
    line_ = text_.substr(0, end);
    text_.remove_prefix(std::min(end + 1, text_.size()));
    ++number_;
    return true;
  }
  /// The next word of the line; empty at its end.
  std::string_view word() {
    constexpr std::string_view kSpace = " \t\r";
    const std::size_t begin = std::min(line_.find_first_not_of(kSpace), line_.size());
    line_.remove_prefix(begin);
    const std::string_view word =
        line_.substr(0, std::min(line_.find_first_of(kSpace), line_.size()));
    line_.remove_prefix(word.size());
    return word;
  }
  MeshPoint point() {
    MeshPoint p;
    for (float& v : p) {
      const std::string_view text = word();
      const auto value = parsed<float>(text);
      if (!value) fail(fmt::format("not a coordinate: '{}'", printable(text)));
      v = *value;
    }
    return p;
  }
  [[noreturn]] void fail(const std::string& what) const { throw InputError(file_, number_, what); }

 private:
  const std::filesystem::path& file_;
  std::string_view text_, line_;
  long number_ = 0;
};

Mesh read_obj(const std::filesystem::path& file, std::string_view text) {
  MeshWords words(file, text);
  WeldedMesh corners;
  std::vector<std::uint32_t> numbers, face;  // of the file's vertices; of a face
  while (words.next_line()) {
    const std::string_view what = words.word();
    if (what == "v") numbers.push_back(corners.point(words.point()));
    if (what != "f") continue;
    face.clear();
    for (std::string_view one = words.word(); !one.empty(); one = words.word()) {
      one = one.substr(0, one.find('/'));
      std::int64_t k = parsed<std::int64_t>(one).value_or(0);
      const auto count = static_cast<std::int64_t>(numbers.size());
      if (k < 0) k += count + 1;
      if (k < 1 || k > count)
        words.fail(fmt::format("a face has the corner '{}'; there are {} vertices before it",
                               printable(one), count));
      face.push_back(numbers[static_cast<std::size_t>(k - 1)]);
    }
    for (std::size_t k = 2; k < face.size(); ++k) corners.triangle(face[0], face[k - 1], face[k]);
  }
  return corners.take();
}

Mesh read_ascii_stl(const std::filesystem::path& file, std::string_view text) {
  MeshWords words(file, text);
  WeldedMesh corners;
  std::array<std::uint32_t, 3> facet{};
  std::size_t k = 0;
  while (words.next_line()) {
    const std::string_view what = words.word();
    if (what == "facet") k = 0;
    if (what != "vertex") continue;
    if (k == 3) words.fail("a facet has more than three corners");
    facet[k++] = corners.point(words.point());
    if (k == 3) corners.triangle(facet[0], facet[1], facet[2]);
  }
  return corners.take();
}

Mesh read_stl(const std::filesystem::path& file, std::string_view bytes) {
  constexpr std::size_t kHead = 84, kFacet = 50;
  std::uint32_t count = 0;
  if (bytes.size() >= kHead) std::memcpy(&count, bytes.data() + kHead - sizeof count, sizeof count);
  if (bytes.size() < kHead || bytes.size() != kHead + std::size_t{count} * kFacet) {
    if (bytes.starts_with("solid")) return read_ascii_stl(file, bytes);
    throw InputError(file,
                     fmt::format("is damaged or not an STL file: {} bytes can't hold {} triangles",
                                 bytes.size(), count));
  }
  WeldedMesh corners;
  for (std::size_t at = kHead; at < bytes.size(); at += kFacet) {
    std::array<MeshPoint, 4> facet;  // its normal, then its corners
    std::memcpy(facet.data(), bytes.data() + at, sizeof facet);
    corners.triangle(corners.point(facet[1]), corners.point(facet[2]), corners.point(facet[3]));
  }
  return corners.take();
}

Mesh welded(const std::vector<std::array<Vec3, 3>>& triangles) {
  WeldedMesh corners;
  for (const auto& triangle : triangles) {
    std::array<std::uint32_t, 3> t;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3f p = triangle[k].cast<float>();
      t[k] = corners.point({p.x(), p.y(), p.z()});
    }
    corners.triangle(t[0], t[1], t[2]);
  }
  return corners.take();
}

Mesh read(const std::filesystem::path& file, const std::string& suffix) {
  if (suffix == ".dae") return welded(read_collada(file));
  std::ifstream in(file, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  return suffix == ".obj" ? read_obj(file, bytes) : read_stl(file, bytes);
}

}  // namespace

Mesh read_mesh(const std::filesystem::path& file) {
  check_readable(file);
  const std::string suffix = suffix_of(file);
  if (suffix != ".obj" && suffix != ".stl" && suffix != ".dae")
    throw InputError(file, "is not a readable mesh; use .stl, .obj or .dae");
  if (std::filesystem::file_size(file) > kMostMeshBytes)
    throw InputError(file, "is larger than 512 MB; a tool needs only some thousand triangles");
  const Mesh mesh = read(file, suffix);
  for (const Eigen::Vector3f& p : mesh.points)
    if (!p.allFinite()) throw InputError(file, "has a point that is not a number");
  if (mesh.triangles.empty()) throw InputError(file, "has no triangles");
  return mesh;
}

}  // namespace soilvdb::inline v0::io
