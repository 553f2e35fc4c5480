// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A snapshot's file and those that it continues, checked and opened.
#pragma once

#include <fmt/format.h>
#include <openvdb/openvdb.h>

#include <filesystem>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "io/file/text.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/snapshot.h"

namespace soilvdb::inline v0::io {

/// A file whose samples are not read yet.
struct ChainFile {
  std::filesystem::path file;
  FileDigest digest;
  std::string tracker_state;
  std::optional<std::string> samples;
  openvdb::MetaMap::Ptr meta;
  std::optional<SnapshotParent> parent;
};

/// Required metadata of a snapshot.
class MetaReader {
 public:
  MetaReader(const std::filesystem::path& file, const openvdb::MetaMap& meta)
      : file_(file), meta_(meta) {}

  double number(const char* name) const { return need<double>(name); }
  openvdb::Vec3d vector(const char* name) const { return need<openvdb::Vec3d>(name); }
  int integer(const char* name) const { return need<std::int32_t>(name); }
  /// Empty strings are not stored in a file.
  std::string text(const char* name) const {
    const auto value = meta_.getMetadata<openvdb::StringMetadata>(name);
    return value ? value->value() : "";
  }

 private:
  template <typename T>
  T need(const char* name) const {
    const auto value = meta_.getMetadata<openvdb::TypedMetadata<T>>(name);
    if (!value) throw InputError(file_, fmt::format("is not a snapshot: it has no {}", name));
    return value->value();
  }

  const std::filesystem::path& file_;
  const openvdb::MetaMap& meta_;
};

/// A snapshot and all that it continues, newest first, with a whole one at the end.
/// @throw InputError if a file is damaged, or is not the one that was continued.
std::vector<ChainFile> open_chain(const std::filesystem::path& file);

/// Calls `f()`, which reads a file that a snapshot is or needs, and adds this to its exceptions.
template <typename F>
auto reading(const std::filesystem::path& snapshot, const std::filesystem::path& file, F f) {
  std::string why;
  try {
    return f();
  } catch (const InputError& error) {
    if (file == snapshot) throw;
    why = error.what();
    if (const std::string at = file.string() + ": "; why.starts_with(at)) why.erase(0, at.size());
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    why = fmt::format("is damaged ({})", printable(error.what()));
  }
  if (file == snapshot) throw InputError(file, why);
  throw InputError(snapshot, fmt::format("is good by itself but needs {}, which {}",
                                         printable(file.filename().string()), why));
}

}  // namespace soilvdb::inline v0::io
