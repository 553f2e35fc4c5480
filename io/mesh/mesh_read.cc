// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reading meshes.
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <cstdint>
#include <map>
#include <string>

#include "io/file/text.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/mesh_file.h"

namespace soilvdb::inline v0::io {

Mesh read_mesh(const std::filesystem::path& file) {
  check_readable(file);
  std::string suffix = file.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (suffix != ".ply" && suffix != ".obj" && suffix != ".stl" && suffix != ".glb")
    throw InputError(file, "is no mesh that is read; .ply, .obj, .stl or .glb would do");
  Assimp::Importer importer;
  const aiScene* scene =
      importer.ReadFile(file.string(), aiProcess_Triangulate | aiProcess_PreTransformVertices);
  if (scene == nullptr)
    throw InputError(file, fmt::format("is damaged ({})", printable(importer.GetErrorString())));
  Mesh mesh;
  std::map<std::array<float, 3>, std::uint32_t> points;  // files of facets repeat them
  for (unsigned m = 0; m < scene->mNumMeshes; ++m) {
    const aiMesh& part = *scene->mMeshes[m];
    for (unsigned f = 0; f < part.mNumFaces; ++f) {
      const aiFace& face = part.mFaces[f];
      if (face.mNumIndices != 3) continue;  // a point or a line
      std::array<std::uint32_t, 3> triangle;
      for (std::size_t k = 0; k < 3; ++k) {
        const aiVector3D& v = part.mVertices[face.mIndices[k]];
        const std::array<float, 3> p =
            suffix == ".glb" ? std::array{v.x, -v.z, v.y} : std::array{v.x, v.y, v.z};
        const auto [at, fresh] =
            points.try_emplace(p, static_cast<std::uint32_t>(mesh.points.size()));
        if (fresh) mesh.points.emplace_back(p[0], p[1], p[2]);
        triangle[k] = at->second;
      }
      if (triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0])
        mesh.triangles.push_back(triangle);
    }
  }
  if (mesh.triangles.empty()) throw InputError(file, "has no triangles");
  return mesh;
}

}  // namespace soilvdb::inline v0::io
