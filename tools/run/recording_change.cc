// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/recording_change.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <system_error>
#include <variant>

#include "io/file/text.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/journal.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::json;

constexpr double kSyncCopy_s = 3600;  // it is flushed at the end

/// "begin end" of a hopper's description.
std::pair<double, double> times_of(const Json& hopper) {
  const std::string text = hopper[3].get<std::string>();
  const std::size_t space = text.find(' ');
  return {io::parse_number(text.substr(0, space)).value_or(0),
          io::parse_number(text.substr(space + 1)).value_or(0)};
}

/// Did both hoppers take the same soil up to a time?
bool same_hopper(const Json& before, const Json& now, double until_s) {
  if (before == now) return true;
  const auto [begin_s, end_s] = times_of(before);
  const auto [now_begin_s, now_end_s] = times_of(now);
  return before[0] == now[0] && before[1] == now[1] && before[2] == now[2] &&
         begin_s == now_begin_s && std::min(end_s, now_end_s) >= until_s;
}

/// New hoppers follow the others, and begin when the recording has ended.
bool same_hoppers(const Json& before, const Json& now, double until_s) {
  if (now.size() < before.size()) return false;
  for (std::size_t i = 0; i < now.size(); ++i) {
    const bool same = i < before.size() ? same_hopper(before[i], now[i], until_s)
                                        : times_of(now[i]).first >= until_s;
    if (!same) return false;
  }
  return true;
}

Json list_of(const Json& site, const char* key) {
  return site.contains(key) && site[key].is_array() ? site[key] : Json::array();
}

}  // namespace

std::optional<MachineChange> change_of_machines(Json& before, const Json& now, double until_s) {
  const Json old_machines = list_of(before, "machines"), machines = list_of(now, "machines");
  const Json old_hoppers = list_of(before, "hoppers"), hoppers = list_of(now, "hoppers");
  if (old_machines == machines && old_hoppers == hoppers) return {};
  if (!same_hoppers(old_hoppers, hoppers, until_s)) return {};
  MachineChange change;
  for (const Json& old : old_machines) {
    change.names.push_back(old["name"].get<std::string>());
    change.index.emplace_back();
    for (std::size_t i = 0; i < machines.size(); ++i) {
      if (machines[i]["name"] != old["name"]) continue;
      if (machines[i] != old) return {};
      change.index.back() = static_cast<std::uint32_t>(i);
    }
  }
  for (const char* key : {"machines", "hoppers"}) {
    if (now.contains(key))
      before[key] = now[key];
    else
      before.erase(key);
  }
  return change;
}

void copy_journal(const std::filesystem::path& journal, const std::filesystem::path& copy,
                  const std::string& config, const MachineChange& change) {
  try {
    io::JournalWriter writer(copy, io::begin_journal(copy, {config}), {}, kSyncCopy_s);
    io::JournalReader reader(journal);
    while (std::optional<io::JournalRecord> record = reader.next()) {
      if (const auto* update = std::get_if<io::JournalUpdate>(&*record)) {
        const bool of_machine =
            update->has_rows() || update->kind == io::JournalUpdate::Kind::kClock;
        if (of_machine && update->machine < change.index.size()) {
          const auto index = change.index[update->machine];
          if (!index)
            throw io::InputError(
                journal.parent_path(),
                fmt::format("has states of machine '{}', which the site no longer has; keep it in "
                            "the list of machines, even if it never comes back",
                            io::printable(change.names[update->machine])));
          if (*index != update->machine)  // snapshots know machines by their numbers
            throw io::InputError(
                journal.parent_path(),
                fmt::format("has states of machine '{}' as number {} in the list of machines; keep "
                            "its place, and add machines at the end",
                            io::printable(change.names[update->machine]), update->machine + 1));
        }
        writer.add(*update);
      } else if (const auto* file = std::get_if<io::JournalFile>(&*record)) {
        writer.add(*file);
      } else if (const auto* removed = std::get_if<io::JournalRemoval>(&*record)) {
        writer.add(*removed);
      }
    }
    writer.flush();
  } catch (...) {
    std::error_code none;
    std::filesystem::remove(copy, none);
    throw;
  }
}

}  // namespace soilvdb::tools
