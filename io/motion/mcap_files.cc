// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/mcap_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <string_view>

#include "io/file/text.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSqliteMagic("SQLite format 3\0", 16);

std::vector<fs::path> files_like(const fs::path& folder, const char* extension) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == extension) files.push_back(entry.path());
  if (error) throw InputError(folder, "can't be read: " + error.message());
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

void refuse_sqlite(const fs::path& path) {
  bool is_it = false;
  if (fs::is_directory(path)) {
    is_it = files_like(path, ".mcap").empty() && !files_like(path, ".db3").empty();
  } else {
    std::string begin(kSqliteMagic.size(), '\0');
    std::ifstream(path, std::ios::binary).read(begin.data(), std::ssize(begin));
    is_it = begin == kSqliteMagic;
  }
  if (!is_it) return;
  const fs::path named = path.has_filename() ? path : path.parent_path();
  const std::string to = named.stem().string() + "_mcap";
  throw InputError(path, fmt::format("is a rosbag2 recording in sqlite3; make one in MCAP of it: "
                                     "ros2 bag convert -i {} -o to_mcap.yaml, where to_mcap.yaml "
                                     "says 'output_bags: [{{uri: {}, storage_id: mcap, all: "
                                     "true}}]'",
                                     shell_quoted(named.filename()), printable(to)));
}

std::vector<fs::path> mcap_files(const fs::path& path) {
  if (fs::is_directory(path)) {
    refuse_sqlite(path);
    std::vector<fs::path> files = files_like(path, ".mcap");
    if (files.empty())
      throw InputError(path, "is a folder without .mcap files; name one with some");
    for (const fs::path& file : files) check_readable(file);
    return files;
  }
  check_readable(path);
  refuse_sqlite(path);
  return {path};
}

}  // namespace soilvdb::inline v0::io
