// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a request asks for.
#pragma once

#include <map>
#include <optional>
#include <string>

namespace soilvdb::tools {

/// Parts of "/path?a=b&c=d", decoded.
struct Target {
  std::string path;
  std::map<std::string, std::string> values;
};
/// Nothing if it isn't one, or names a value twice.
std::optional<Target> parse_target(const std::string& text);

}  // namespace soilvdb::tools
