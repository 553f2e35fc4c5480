// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/mesh_file.h"

#include <assimp/scene.h>
#include <fmt/format.h>

#include <algorithm>
#include <assimp/Exporter.hpp>
#include <cctype>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string_view>

#include "io/atomic_file.h"
#include "io/text.h"

namespace soilvdb::io {
namespace {

enum class Format { kPly, kObj, kStl, kGlb };

Format format_of(const std::filesystem::path& file) {
  std::string suffix = file.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (suffix == ".ply") return Format::kPly;
  if (suffix == ".obj") return Format::kObj;
  if (suffix == ".stl") return Format::kStl;
  if (suffix == ".glb") return Format::kGlb;
  throw std::invalid_argument(file.string() + ": unknown mesh format '" + printable(suffix) +
                              "'; .ply, .obj, .stl or .glb would do");
}

/// Assimp's name of the format.
const char* exporter(Format format) {
  switch (format) {
    case Format::kPly: return "plyb";
    case Format::kObj: return "objnomtl";
    case Format::kStl: return "stlb";
    case Format::kGlb: return "glb2";
  }
  return "";
}

/// WKT on one line.
std::string one_line(std::string text) {
  std::replace_if(text.begin(), text.end(),
                  [](unsigned char c) { return std::iscntrl(c) != 0; }, ' ');
  return text;
}

std::string origin_text(const Vec3& origin) {
  return fmt::format("{} {} {}", origin.x(), origin.y(), origin.z());
}

std::unique_ptr<aiScene> make_scene(const Mesh& mesh, Format format, const Vec3& origin,
                                    const std::string& crs_wkt) {
  auto scene = std::make_unique<aiScene>();
  scene->mMaterials = new aiMaterial*[1]{new aiMaterial};
  scene->mNumMaterials = 1;
  auto* out = new aiMesh;
  scene->mMeshes = new aiMesh*[1]{out};
  scene->mNumMeshes = 1;
  out->mName = "surface";
  out->mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  out->mVertices = new aiVector3D[mesh.points.size()];
  out->mNumVertices = static_cast<unsigned>(mesh.points.size());
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const Eigen::Vector3f& p = mesh.points[i];
    out->mVertices[i] = format == Format::kGlb ? aiVector3D(p.x(), p.z(), -p.y())
                                               : aiVector3D(p.x(), p.y(), p.z());
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
  if (format == Format::kGlb) {
    scene->mRootNode->mMetaData = aiMetadata::Alloc(crs_wkt.empty() ? 3 : 4);
    constexpr const char* kAxes[] = {"origin_x", "origin_y", "origin_z"};
    for (unsigned a = 0; a < 3; ++a) {
      scene->mRootNode->mMetaData->Set(a, kAxes[a], double(origin[a]));
    }
    if (!crs_wkt.empty()) scene->mRootNode->mMetaData->Set(3, "crs", aiString(crs_wkt));
  }
  return scene;
}

/// Puts lines after the first `lines` lines of a text header.
void insert_after(std::string& bytes, int lines, std::string_view text) {
  std::size_t at = 0;
  for (; lines > 0 && at != bytes.npos; --lines) at = bytes.find('\n', at) + 1;
  bytes.insert(at, text);
}

/// Says where the mesh is, in the format's own way.
void note_origin(std::string& bytes, Format format, const Vec3& origin,
                 const std::string& crs_wkt) {
  const std::string at = origin_text(origin);
  if (format == Format::kPly) {   // after "ply" and "format ..."
    insert_after(bytes, 2, fmt::format("comment origin {}\n", at) +
                 (crs_wkt.empty() ? "" : "comment crs " + one_line(crs_wkt) + "\n"));
  } else if (format == Format::kObj) {
    insert_after(bytes, 0, fmt::format("# origin {}\n", at) +
                 (crs_wkt.empty() ? "" : "# crs " + one_line(crs_wkt) + "\n"));
  } else if (format == Format::kStl) {
    constexpr std::size_t kHeader = 80;
    std::string header = "soilvdb origin " + at;
    header.resize(kHeader, '\0');
    bytes.replace(0, kHeader, header);
  }
}

}  // namespace

void write_mesh(const std::filesystem::path& file, const Mesh& mesh, const Vec3& origin,
                const std::string& crs_wkt) {
  const Format format = format_of(file);
  if (mesh.triangles.empty()) {
    throw std::invalid_argument(file.string() + ": there is no surface to write");
  }
  Assimp::Exporter exporters;
  const aiExportDataBlob* blob =
      exporters.ExportToBlob(make_scene(mesh, format, origin, crs_wkt).get(), exporter(format), 0u);
  if (blob == nullptr || blob->size == 0) {
    throw std::runtime_error(file.string() + ": can't be written: " +
                             printable(exporters.GetErrorString()));
  }
  std::string bytes(static_cast<const char*>(blob->data), blob->size);
  exporters.FreeBlob();
  note_origin(bytes, format, origin, crs_wkt);
  write_atomically(file, bytes);
}

}  // namespace soilvdb::io
