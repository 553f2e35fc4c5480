// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run_files.h"

#include <fmt/format.h>

#include <map>
#include <optional>

#include "soilvdb/io/checksum.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/run_folder.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kGoodButNeeds = "is good by itself but needs";

/// The fault of the snapshots that an intact snapshot continues.
/// @param before the files before it
std::string fault_before(const fs::path& file, const io::JournalFile& known,
                         const std::map<std::string, const RunFile*>& before) {
  const auto found = before.find(known.parent);
  std::string what;
  if (found == before.end()) {
    what = "the journal doesn't know";
  } else if (found->second->fault.starts_with(kGoodButNeeds)) {
    return found->second->fault;
  } else if (what = found->second->fault; what.empty()) {
    const io::JournalFile& base = found->second->known;
    const std::optional<io::SnapshotParent> parent = io::read_snapshot_parent(file);
    if (parent && parent->name == base.name &&
        parent->digest == io::FileDigest{base.size, base.crc})
      return "";
    what = "is not the snapshot that it continues";
  }
  return fmt::format("{} {}, which {}", kGoodButNeeds, known.parent, what);
}

}  // namespace

std::string fault_of(const fs::path& file, const io::JournalFile& known) {
  std::error_code none;
  if (!fs::exists(file, none)) return "is missing";
  if (!fs::is_regular_file(file, none)) return "can't be read";  // reading a pipe would not end
  try {
    if (io::file_digest(file) != io::FileDigest{known.size, known.crc})
      return "is damaged: its checksum is not the journal's";
  } catch (const io::InputError&) {
    return "can't be read";
  }
  return "";
}

std::vector<RunFile> check_files(const fs::path& folder, const io::JournalContent& journal) {
  std::vector<RunFile> files;
  files.reserve(journal.files.size());  // pointers to its elements must stay valid
  std::map<std::string, const RunFile*> before;
  for (const io::JournalFile& known : journal.files) {
    RunFile& file = files.emplace_back();
    file.known = known;
    file.outdated = !is_periodic(known.name) && known.updates != journal.done.updates;
    file.fault = fault_of(folder / known.name, known);
    if (file.fault.empty() && !known.parent.empty())
      file.fault = fault_before(folder / known.name, known, before);
    before[known.name] = &file;
  }
  return files;
}

std::vector<io::JournalFile> good_snapshots(const fs::path& folder,
                                            const io::JournalContent& journal) {
  std::vector<io::JournalFile> good;
  for (const RunFile& file : check_files(folder, journal))
    if (file.fault.empty() && is_periodic(file.known.name)) good.push_back(file.known);
  return good;
}

}  // namespace soilvdb::tools
