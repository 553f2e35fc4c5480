// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/snapshot_writer.h"

#include <fmt/format.h>

#include <exception>
#include <set>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "core/ground/ground_writer.h"
#include "io/file/atomic_file.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/io/checksum.h"

namespace soilvdb::tools {
namespace {

/// The resident chunks within two chunks of the given ones: those that determine their surface.
std::vector<Coord3> chunks_around(const Ground& ground, const std::vector<Coord3>& chunks) {
  std::vector<Coord3> around;
  for (const Coord3& c : chunks) {
    for (int n = 0; n < 125; ++n) {
      const Coord3 other = c + kChunkSide * Coord3(n / 25 - 2, n / 5 % 5 - 2, n % 5 - 2);
      if (ground.find(other) != nullptr) around.push_back(other);
    }
  }
  sort_once(around);
  return around;
}

}  // namespace

SnapshotWriter::SnapshotWriter(RunFolder& folder, io::JournalWriter& journal,
                               const Options& options)
    : folder_(folder), journal_(journal), options_(options) {}

void SnapshotWriter::go_on(std::vector<io::JournalFile> files,
                           const std::optional<io::SnapshotParent>& parent) {
  files_ = std::move(files);
  depth_ = parent ? parent->depth : 0;
  chunks_ = parent ? parent->chunks : 0;
}

void SnapshotWriter::write(io::JournalFile file, bool there, const std::vector<Coord3>& changed,
                           const io::Site& site, io::SnapshotInfo info) {
  finish();
  const Ground& ground = *site.ground;
  const bool whole = !options_.incremental || files_.empty() || depth_ == io::kMaxChainLength ||
                     chunks_ + changed.size() >= ground.chunk_count();
  depth_ = whole ? 0 : depth_ + 1;
  chunks_ = whole ? 0 : chunks_ + changed.size();
  if (whole) anew_ = false;
  // A rewritten snapshot may have other bytes, so snapshots that continue it must be rewritten,
  // too.
  if (there && !anew_) {
    files_.push_back(std::move(file));
    done_.push_back(files_.back().name);
    delete_old();
    return finish();
  }
  anew_ = true;
  file.parent.clear();
  if (!whole) {
    const io::JournalFile& last = files_.back();
    info.parent = io::SnapshotParent{last.name, {last.size, last.crc}};
    file.parent = last.name;
  }
  io::Site copy = io::undug_site(site);
  for (const Coord3& origin : whole ? ground.origins() : changed) {
    GroundWriter(*copy.ground).copy_from(ground, origin);
    if (!whole && ground.find(origin) == nullptr) info.parent->dropped.push_back(origin);
  }
  std::shared_ptr<Ground> surroundings;
  if (!whole) {
    surroundings = io::undug_site(site).ground;
    for (const Coord3& origin : chunks_around(ground, changed)) {
      GroundWriter(*surroundings).copy_from(ground, origin);
    }
  }
  auto work = [this, file = std::move(file),
               copy = std::make_shared<const io::Site>(std::move(copy)),
               surroundings = std::shared_ptr<const Ground>(surroundings),
               info = std::move(info)] { save(file, *copy, surroundings.get(), info); };
  if (!background_) background_.emplace(options_.beside);
  background_->run(std::move(work));
  if (!options_.beside) finish();
}

void SnapshotWriter::save(io::JournalFile file, const io::Site& site, const Ground* surroundings,
                          const io::SnapshotInfo& info) {
  const std::filesystem::path path = folder_.path() / file.name;
  const std::string bytes = io::snapshot_bytes(path, site, info, surroundings);
  io::write_atomically(path, bytes);
  file.size = bytes.size();
  file.crc = io::crc64(bytes);
  done_.push_back(file.name);
  journal_.add(file);
  files_.push_back(std::move(file));
  delete_old();
}

void SnapshotWriter::delete_old() {
  if (!options_.keep || files_.size() <= *options_.keep) return;
  std::set<std::string> needed;
  std::vector<io::JournalFile> stay, go;
  for (auto file = files_.rbegin(); file != files_.rend(); ++file) {
    const bool stays = stay.size() < *options_.keep || needed.contains(file->name);
    if (stays) needed.insert(file->parent);
    (stays ? stay : go).push_back(*file);
  }
  if (go.empty()) return;
  for (const io::JournalFile& file : go) journal_.add(io::JournalRemoval{file.name});
  journal_.flush();  // the journal must contain the newest snapshot first
  for (const io::JournalFile& file : go) {
    std::error_code error;
    std::filesystem::remove(folder_.path() / file.name, error);
    if (error)
      throw std::runtime_error(fmt::format("{}: can't be deleted: {}",
                                           (folder_.path() / file.name).string(), error.message()));
    deleted_.push_back(file.name);
  }
  files_.assign(stay.rbegin(), stay.rend());
}

void SnapshotWriter::check() {
  if (background_ && background_->done()) finish();
}

void SnapshotWriter::finish() {
  std::exception_ptr error;
  try {
    if (background_) background_->wait();
  } catch (...) {
    error = std::current_exception();
  }
  for (const std::string& name : std::exchange(done_, {})) folder_.done(name);
  for (const std::string& name : std::exchange(deleted_, {})) folder_.forget(name);
  if (error) std::rethrow_exception(error);
}

}  // namespace soilvdb::tools
