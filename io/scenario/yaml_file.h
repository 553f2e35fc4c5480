// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads a YAML file, and knows the slip that makes no key of one.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <string_view>

namespace soilvdb::inline v0::io {

/// The one document in a YAML file. @throw InputError naming the line, or if there is another.
YAML::Node read_yaml(const std::filesystem::path& file);

/// The word before a colon that another character follows at once, where that is how a line or an
/// item begins, as in voxel_size:0.05, which is no key; else nothing. Not of paths, C:/ or http://.
std::string key_without_blank(std::string_view line);
/// What is said of it.
std::string no_blank(const std::string& key);

}  // namespace soilvdb::inline v0::io
