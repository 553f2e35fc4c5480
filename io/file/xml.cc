// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/file/xml.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>

#include "io/file/json.h"
#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

void check_encoding(const std::filesystem::path& file, std::string_view text) {
  long line = 1;
  for (std::size_t from = 0, end = 0; from < text.size(); from = end + 1, ++line) {
    end = std::min(text.find('\n', from), text.size());
    if (!is_utf8(text.substr(from, end - from)))
      throw InputError(file, line, "isn't UTF-8; convert the file to that");
  }
}

std::string explain(tinyxml2::XMLError error, std::string_view begins) {
  switch (error) {
    case tinyxml2::XML_ERROR_PARSING_ATTRIBUTE:
      return "an attribute isn't name=\"value\"; the file may be cut short";
    case tinyxml2::XML_ERROR_PARSING_COMMENT:
      return "a comment isn't closed; '-->' is missing";
    case tinyxml2::XML_ERROR_PARSING_CDATA:
      return "a CDATA section isn't closed; ']]>' is missing";
    case tinyxml2::XML_ERROR_MISMATCHED_ELEMENT:
      return "an element isn't closed, or closed without being opened; each needs an end tag";
    case tinyxml2::XML_ELEMENT_DEPTH_EXCEEDED:
      return "elements are nested too deep; such a file has a few levels";
    case tinyxml2::XML_ERROR_PARSING_ELEMENT:
    case tinyxml2::XML_ERROR_PARSING:
      return "a tag isn't closed; the file may be cut short";
    default:
      return fmt::format("isn't XML; {}", begins);
  }
}

}  // namespace

const tinyxml2::XMLElement& parse_xml(const std::filesystem::path& file, std::string_view text,
                                      std::string_view begins, tinyxml2::XMLDocument& document) {
  check_encoding(file, text);
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS)
    throw InputError(file, document.ErrorLineNum(), explain(document.ErrorID(), begins));
  if (document.RootElement() == nullptr)
    throw InputError(file, fmt::format("has no element; {}", begins));
  return *document.RootElement();
}

}  // namespace soilvdb::inline v0::io
