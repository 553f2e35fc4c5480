// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads a YAML file, and detects a missing blank after a key's colon.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <string_view>

namespace soilvdb::inline v0::io {

/// The only document of a YAML file. @throw InputError naming the line, also for a second document.
YAML::Node read_yaml(const std::filesystem::path& file);

/// The word before a colon without a blank, at the start of a line or item, as in voxel_size:0.05;
/// such a word is no key. Empty otherwise, also for paths such as C:/ or http://.
std::string key_without_blank(std::string_view line);
/// The message about such a word.
std::string no_blank(const std::string& key);

}  // namespace soilvdb::inline v0::io
