// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/file/file_part.h"

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

bool has_surfaces(const std::filesystem::path& file) {
  const std::string suffix = suffix_of(file);
  return suffix == ".xml" || suffix == ".dxf";
}

}  // namespace

FilePart file_part(const std::filesystem::path& path) {
  const std::string text = path.string();
  std::error_code none;
  for (std::size_t at = text.find('#'); at != text.npos; at = text.find('#', at + 1)) {
    const std::filesystem::path file = text.substr(0, at);
    if (has_surfaces(file) && !std::filesystem::exists(path, none))
      return {file, text.substr(at + 1)};
  }
  return {path, ""};
}

bool is_tin(const std::filesystem::path& path) { return has_surfaces(file_part(path).file); }

}  // namespace soilvdb::inline v0::io
