// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// JSON to text and CBOR and back. These templates are slow to compile: this is the one place.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace soilvdb::inline v0::io {

/// JSON text; bytes that aren't UTF-8 are replaced. @param indent spaces a level; -1: on one line
std::string to_text(const nlohmann::json& json, int indent = -1);
std::string to_text(const nlohmann::ordered_json& json, int indent = -1);

/// Numbers of a vector as JSON of any kind takes them.
std::vector<double> numbers(const auto& values) { return {values.begin(), values.end()}; }

bool is_utf8(std::string_view text);

/// What a text says; a discarded value if it isn't JSON.
nlohmann::json parse_json(std::string_view text);

std::string to_cbor(const nlohmann::json& json);
/// What CBOR says; a discarded value if it isn't CBOR.
nlohmann::json from_cbor(std::string_view bytes);

}  // namespace soilvdb::inline v0::io
