// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/mesh_file.h"

#include <assimp/scene.h>
#include <fmt/format.h>

#include <assimp/Exporter.hpp>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>

#include "core/lattice/bytes.h"
#include "io/file/atomic_file.h"
#include "io/file/json.h"
#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

enum class Format { kPly, kObj, kGlb, kStl };
constexpr const char* kSuffixes[] = {".ply", ".obj", ".glb", ".stl"};
constexpr const char* kExporters[] = {"plyb", "objnomtl", "glb2"};  // in Assimp; .stl is ours

Format format_of(const std::filesystem::path& file) {
  const std::string suffix = suffix_of(file);
  for (std::size_t i = 0; i < std::size(kSuffixes); ++i)
    if (suffix == kSuffixes[i]) return static_cast<Format>(i);
  throw std::invalid_argument(file.string() + ": unknown mesh format '" + printable(suffix) +
                              "'; use .ply, .obj, .stl or .glb");
}

std::string origin_text(const Vec3& origin) {
  return fmt::format("{} {} {}", origin.x(), origin.y(), origin.z());
}

std::unique_ptr<aiScene> make_scene(const Mesh& mesh, Format format) {
  auto scene = std::make_unique<aiScene>();
  scene->mMaterials = new aiMaterial* [1] { new aiMaterial };
  scene->mNumMaterials = 1;
  auto* out = new aiMesh;
  scene->mMeshes = new aiMesh* [1] { out };
  scene->mNumMeshes = 1;
  out->mName = "surface";
  out->mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  out->mVertices = new aiVector3D[mesh.points.size()];
  out->mNumVertices = static_cast<unsigned>(mesh.points.size());
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const Eigen::Vector3f& p = mesh.points[i];
    out->mVertices[i] =
        format == Format::kGlb ? aiVector3D(p.x(), p.z(), -p.y()) : aiVector3D(p.x(), p.y(), p.z());
  }
  out->mFaces = new aiFace[mesh.triangles.size()];
  out->mNumFaces = static_cast<unsigned>(mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto& t = mesh.triangles[i];
    out->mFaces[i].mIndices = new unsigned[3]{t[0], t[1], t[2]};
    out->mFaces[i].mNumIndices = 3;
  }
  scene->mRootNode = new aiNode("soilvdb");
  scene->mRootNode->mMeshes = new unsigned[1]{0};
  scene->mRootNode->mNumMeshes = 1;
  return scene;
}

/// An STL with facet normals, which Assimp's exporter leaves out.
std::string stl_bytes(const Mesh& mesh, const Vec3& origin) {
  constexpr std::size_t kHeader = 80;
  std::string bytes = "soilvdb origin " + origin_text(origin);
  bytes.resize(kHeader, '\0');
  bytes.reserve(kHeader + 4 + 50 * mesh.triangles.size());
  put(bytes, static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3f &a = mesh.points[t[0]], &b = mesh.points[t[1]], &c = mesh.points[t[2]];
    const Vec3 normal = (b - a).cast<double>().cross((c - a).cast<double>()).stableNormalized();
    for (const Eigen::Vector3f& v : {Eigen::Vector3f(normal.cast<float>()), a, b, c}) {
      for (int i = 0; i < 3; ++i) put(bytes, v[i]);
    }
    put(bytes, std::uint16_t{0});
  }
  return bytes;
}

/// Puts text after the first `lines` lines of a header.
void insert_after(std::string& bytes, int lines, const std::string& text) {
  std::size_t at = 0;
  for (; lines > 0; --lines) at = bytes.find('\n', at) + 1;
  bytes.insert(at, text);
}

/// Adds extras to the asset, and removes an extension that Assimp declares without using it.
std::string annotated_glb(std::string_view bytes, const Vec3& origin, const std::string& crs_wkt) {
  // 12 bytes of header, then chunks of length, type and data: JSON first.
  constexpr std::size_t kJson = 20;
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 12, sizeof length);
  nlohmann::json json = parse_json(bytes.substr(kJson, length));
  json["asset"]["extras"]["origin"] = {origin.x(), origin.y(), origin.z()};
  if (!crs_wkt.empty()) json["asset"]["extras"]["crs"] = crs_wkt;
  json["asset"]["generator"] = "soilvdb with " + json["asset"]["generator"].get<std::string>();
  json.erase("extensionsUsed");
  std::string text = to_text(json);
  text.resize((text.size() + 3) / 4 * 4, ' ');
  std::string out(bytes.substr(0, kJson));
  out += text;
  out += bytes.substr(kJson + length);
  const auto whole = static_cast<std::uint32_t>(out.size());
  length = static_cast<std::uint32_t>(text.size());
  std::memcpy(out.data() + 8, &whole, sizeof whole);
  std::memcpy(out.data() + 12, &length, sizeof length);
  return out;
}

/// The file by Assimp, with the mesh's place as the format stores it.
std::string exported(const std::filesystem::path& file, const Mesh& mesh, Format format,
                     const Vec3& origin, const std::string& crs_wkt) {
  Assimp::Exporter exporters;
  const aiExportDataBlob* blob = exporters.ExportToBlob(
      make_scene(mesh, format).get(), kExporters[static_cast<std::size_t>(format)], 0u);
  if (blob == nullptr || blob->size == 0) {
    throw std::runtime_error(file.string() +
                             ": can't be written: " + printable(exporters.GetErrorString()));
  }
  std::string bytes(static_cast<const char*>(blob->data), blob->size);
  exporters.FreeBlob();
  if (format == Format::kGlb) return annotated_glb(bytes, origin, crs_wkt);
  const bool ply = format == Format::kPly;
  const char* comment = ply ? "comment" : "#";
  std::string lines = fmt::format("{} origin {}\n", comment, origin_text(origin));
  if (!crs_wkt.empty()) lines += fmt::format("{} crs {}\n", comment, one_line(crs_wkt, ' '));
  insert_after(bytes, ply ? 2 : 0, lines);  // after "ply" and "format ..."
  return bytes;
}

}  // namespace

void write_mesh(const std::filesystem::path& file, const Mesh& mesh, const Vec3& origin,
                const std::string& crs_wkt) {
  const Format format = format_of(file);
  if (mesh.triangles.empty()) {
    throw std::invalid_argument(file.string() + ": there is no surface to write");
  }
  write_atomically(file, format == Format::kStl ? stl_bytes(mesh, origin)
                                                : exported(file, mesh, format, origin, crs_wkt));
}

}  // namespace soilvdb::inline v0::io
