// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// XML by TinyXML-2. No text of a file reaches a formatting function of the parser; of its errors
// only number and line are used.
#pragma once

#include <tinyxml2.h>

#include <filesystem>
#include <string_view>

namespace soilvdb::inline v0::io {

/// Parses a whole file. Its names go into messages and summaries, so it must be UTF-8.
/// @param begins what such a file begins with, for the message: `a URDF begins with <robot ..>`
/// @return the root element
/// @throw InputError if it isn't XML, has another encoding or no element
const tinyxml2::XMLElement& parse_xml(const std::filesystem::path& file, std::string_view text,
                                      std::string_view begins, tinyxml2::XMLDocument& document);

}  // namespace soilvdb::inline v0::io
