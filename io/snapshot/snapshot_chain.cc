// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/snapshot/snapshot_chain.h"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <optional>

#include "io/snapshot/snapshot_format.h"
#include "soilvdb/io/level_set_file.h"

namespace soilvdb::inline v0::io {
namespace {

std::string read_all(const std::filesystem::path& file) {
  check_readable(file);
  std::ifstream in(file, std::ios::binary);
  std::string bytes(std::filesystem::file_size(file), '\0');
  if (!in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()))) {
    throw InputError(file, "can't be read to its end");
  }
  return bytes;
}

/// Takes off the end of `bytes` a part and the line with its size. @return the part, if there is
/// one
std::optional<std::string> take_part(std::string_view& bytes, std::string_view word) {
  const std::size_t line_size = word.size() + kSizeDigits + 1;
  const std::string_view line = bytes.substr(bytes.size() - std::min(bytes.size(), line_size));
  std::uint64_t size = 0;
  const char* digits = line.data() + word.size();
  if (line.size() < line_size || !line.starts_with(word) ||
      std::from_chars(digits, digits + kSizeDigits, size, 16).ptr != digits + kSizeDigits ||
      size > bytes.size() - line_size)
    return std::nullopt;
  bytes.remove_suffix(line_size);
  const std::string_view part = bytes.substr(bytes.size() - size);
  bytes.remove_suffix(size);
  return std::string(part);
}

/// Checks a file against its checksum, and takes the parts after its grids.
void read_parts(ChainFile& member, std::string_view all) {
  const std::size_t end = all.size() - std::min(all.size(), kTrailerSize);
  if (!all.substr(end).starts_with(kTrailerWord)) {
    throw InputError(member.file, "is damaged: its end is missing; use a snapshot before it");
  }
  if (all.substr(end) != trailer(all.substr(0, end))) {
    throw InputError(member.file,
                     "is damaged: its checksum doesn't match; use a snapshot before it");
  }
  std::string_view left = all.substr(0, end);
  member.tracker_state = take_part(left, kStateWord).value_or("");
  member.samples = take_part(left, kSamplesWord);
}

ChainFile open_chain_file(const std::filesystem::path& file) {
  check_readable(file);
  if (!is_snapshot(file))
    throw InputError(file, "is not a snapshot; one that `soilvdb run` wrote would do");
  ChainFile member;
  member.file = file;
  {
    const std::string bytes = read_all(file);
    read_parts(member, bytes);
    member.digest = {bytes.size(), crc64(bytes)};
  }
  openvdb::io::File vdb(file.string());
  vdb.open(/*delayLoad=*/false);
  member.meta = vdb.getMetadata();
  const MetaReader meta(file, *member.meta);
  if (const int format = meta.integer("soilvdb_format"); format != kFormat) {
    throw InputError(
        file,
        fmt::format("is a snapshot of format {}, this version reads format {}; {}", format, kFormat,
                    format < kFormat ? "run its scenario again to make it anew"
                                     : "a newer soilvdb may read it"));
  }
  if (!member.samples) throw std::runtime_error("its samples are missing");
  const std::string name = meta.text(kParentKey), checksum = meta.text(kParentChecksumKey);
  if (name.empty()) return member;
  FileDigest digest;
  const char* text = checksum.data();
  if (checksum.size() != 33 || checksum[16] != ' ' ||
      std::from_chars(text, text + 16, digest.crc, 16).ptr != text + 16 ||
      std::from_chars(text + 17, text + 33, digest.size, 16).ptr != text + 33 ||
      std::filesystem::path(name).filename() != name || name == "." || name == "..")
    throw std::runtime_error("the snapshot that it continues is not in its folder");
  member.parent = SnapshotParent{name, digest};
  return member;
}

bool same_site(const openvdb::MetaMap& a, const openvdb::MetaMap& b) {
  for (const char* key :
       {"soilvdb_voxel_size_m", kOriginKey, "soilvdb_base", "soilvdb_base_height_m",
        "soilvdb_base_slope_x", "soilvdb_base_slope_y", "soilvdb_base_checksum"}) {
    const openvdb::Metadata::ConstPtr of_a = a[key], of_b = b[key];
    if (!of_a != !of_b || (of_a && *of_a != *of_b)) return false;
  }
  return true;
}

}  // namespace

bool is_snapshot(const std::filesystem::path& file) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(file, none)) return false;
  std::ifstream in(file, std::ios::binary);
  std::string head(kUuidAt + kUuidSize, '\0'), end(kTrailerSize, '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  if (std::string_view(head).substr(kUuidAt).starts_with(kMark)) return true;
  in.clear();
  in.seekg(-static_cast<std::streamoff>(kTrailerSize), std::ios::end);
  in.read(end.data(), static_cast<std::streamsize>(end.size()));
  return in && end.starts_with(kTrailerWord);
}

std::optional<SnapshotParent> read_snapshot_parent(const std::filesystem::path& file) {
  openvdb::initialize();
  return reading(file, file, [&] { return open_chain_file(file).parent; });
}

std::vector<ChainFile> open_chain(const std::filesystem::path& file) {
  std::vector<ChainFile> chain;
  chain.push_back(reading(file, file, [&] { return open_chain_file(file); }));
  while (const std::optional<SnapshotParent> parent = chain.back().parent) {
    if (chain.size() > kMaxChainLength)
      throw InputError(file, fmt::format("continues more than {} others; use a snapshot before it",
                                         kMaxChainLength));
    const std::filesystem::path next = file.parent_path() / parent->name;
    chain.push_back(reading(file, next, [&] {
      std::error_code none;
      if (!std::filesystem::exists(next, none)) throw InputError(next, "is missing");
      ChainFile member = open_chain_file(next);
      if (member.digest != parent->digest || !same_site(*member.meta, *chain.front().meta))
        throw InputError(next, "is not the snapshot that it continues");
      return member;
    }));
  }
  return chain;
}

}  // namespace soilvdb::inline v0::io
