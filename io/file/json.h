// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// JSON to text and CBOR and back. Only this unit compiles these slow templates.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace soilvdb::inline v0::io {

/// JSON text; bytes that are not UTF-8 are replaced. @param indent spaces per level; -1: one line
std::string to_text(const nlohmann::json& json, int indent = -1);
std::string to_text(const nlohmann::ordered_json& json, int indent = -1);

/// Numbers of any vector, in a type that JSON takes.
std::vector<double> numbers(const auto& values) { return {values.begin(), values.end()}; }

bool is_utf8(std::string_view text);

/// The JSON value of a text; a discarded value if it is not JSON.
nlohmann::json parse_json(std::string_view text);

std::string to_cbor(const nlohmann::json& json);
/// The JSON value of CBOR; a discarded value if it is not CBOR.
nlohmann::json from_cbor(std::string_view bytes);

}  // namespace soilvdb::inline v0::io
