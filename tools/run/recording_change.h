// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A recording whose site has other machines or hoppers now.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace soilvdb::tools {

/// What became of a recording's machines.
struct MachineChange {
  std::vector<std::string> names;                   ///< of the recording's
  std::vector<std::optional<std::uint32_t>> index;  ///< of each in the site now; empty: gone
};

/// Compares a recorded site's description with the present one.
/// @param until_s end of the recording: a hopper may begin or end from then on
/// @return empty if nothing changed, or if another recording is needed for what did: then `before`
///         differs from `now` as before. Else both have the same machines and hoppers afterwards.
std::optional<MachineChange> change_of_machines(nlohmann::json& before, const nlohmann::json& now,
                                                double until_s);

/// Copies a journal for the changed site.
/// @param config of the copy
/// @throw io::InputError if a machine with states is gone or elsewhere in the list;
/// std::runtime_error if it can't be
///        written. There is no copy then.
void copy_journal(const std::filesystem::path& journal, const std::filesystem::path& copy,
                  const std::string& config, const MachineChange& change);

}  // namespace soilvdb::tools
