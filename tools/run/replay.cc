// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/replay.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "soilvdb/io/error.h"
#include "tools/run/run_files.h"

namespace soilvdb::tools {
namespace {

/// Updates per batch.
constexpr std::size_t kReplayBatch = 256;

std::uint64_t whole(std::span<const io::JournalUpdate> updates) {
  return static_cast<std::uint64_t>(
      std::count_if(updates.begin(), updates.end(),
                    [](const io::JournalUpdate& update) { return update.ends_update; }));
}

}  // namespace

std::optional<ResumePoint> newest_snapshot(
    const std::filesystem::path& folder, std::span<const io::JournalFile> files,
    const SiteModel& model, const std::function<bool(const SiteState&, std::uint64_t)>& fits,
    const std::function<void(const std::string&)>& refused) {
  for (; !files.empty(); files = files.first(files.size() - 1)) {
    const io::JournalFile& file = files.back();
    if (file.updates == 0 || !fault_of(folder / file.name, file).empty()) continue;
    try {
      io::SnapshotInfo info;
      auto state = std::make_unique<SiteState>(model, io::read_snapshot(folder / file.name, &info));
      state->set_progress(info.tracker_state);
      if (fits(*state, file.updates))
        return ResumePoint{std::move(state), file.updates, file.name, info.parent};
    } catch (const io::InputError& e) {
      refused(e.what());
    } catch (const std::invalid_argument& e) {
      refused((folder / file.name).string() + ": " + e.what());
    }
  }
  return std::nullopt;
}

void replay(const std::filesystem::path& journal, std::uint64_t seen, std::uint64_t end,
            SiteState& site, const std::function<bool(const io::JournalUpdate&)>& ends_batch,
            const std::function<void(std::span<const io::JournalUpdate>)>& made) {
  io::JournalReader reader(journal);
  std::vector<io::JournalUpdate> batch;
  std::uint64_t count = 0;  // updates before the batch
  const auto make = [&] {
    if (batch.empty()) return;
    try {
      if (count >= seen) site.redo(batch);
    } catch (const UpdateDiffers& e) {
      const std::uint64_t good = count + whole(std::span(batch).first(e.index));
      throw differs(journal, good + 1, batch[e.index].end_s, e);
    }
    count += whole(batch);
    made(batch);
    batch.clear();
  };
  std::uint64_t read = 0;
  while (read < end) {
    std::optional<io::JournalRecord> record = reader.next();
    if (!record) break;
    auto* update = std::get_if<io::JournalUpdate>(&*record);
    if (update == nullptr) continue;  // of a file or the configuration
    read += update->ends_update;
    const bool ends = ends_batch(*update) || read == seen;
    batch.push_back(std::move(*update));
    if (ends || batch.size() == kReplayBatch) make();
  }
  make();
}

}  // namespace soilvdb::tools
