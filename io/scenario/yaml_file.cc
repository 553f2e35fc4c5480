// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/yaml_file.h"

#include <yaml-cpp/eventhandler.h>

#include <algorithm>
#include <sstream>
#include <string_view>

#include "io/file/text.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMaxYamlBytes = 16 << 20;

/// Lines where documents start. Stops at the second: with a misplaced comma yaml-cpp reports
/// documents without end.
struct DocumentStarts : YAML::EventHandler {
  explicit DocumentStarts(const std::string& text) {
    std::istringstream in(text);
    YAML::Parser parser(in);
    if (parser.HandleNextDocument(*this)) parser.HandleNextDocument(*this);
  }

  void OnDocumentStart(const YAML::Mark& mark) override {
    if (++count == 2) second_line = mark.line + 1;
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
  void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t,
                const std::string&) override {}
  void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                  YAML::EmitterStyle::value) override {}
  void OnMapEnd() override {}

  int count = 0;
  long second_line = 0;  ///< 0: there is none
};

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& text,
                         const YAML::Exception& e) {
  const std::string message = "is not valid YAML: " + printable(e.msg);
  if (e.mark.is_null()) throw InputError(file, message);
  std::istringstream in(text);
  std::string line, key;
  long line_of_key = 0;
  for (long n = 0; n <= e.mark.line && std::getline(in, line); ++n) {
    // yaml-cpp reports the error only at the next key.
    if (const std::string found = key_without_blank(line); !found.empty()) {
      key = found;
      line_of_key = n + 1;
    }
    // yaml-cpp's message about a tab varies, and names this line or the one before.
    const std::size_t indent = std::min(line.find_first_not_of(" \t"), line.size());
    if (n + 1 < e.mark.line || line.find('\t') >= indent) continue;
    throw InputError(file, n + 1, "is not valid YAML: a tab indents this line; use spaces instead");
  }
  if (!key.empty()) {
    throw InputError(file, line_of_key, "is not valid YAML: " + no_blank(key));
  }
  throw InputError(file, e.mark.line + 1, message);
}

}  // namespace

YAML::Node read_yaml(const std::filesystem::path& file) {
  if (suffix_of(file) == ".vdb")
    throw InputError(file,
                     "is a .vdb, and a scenario is YAML; its 'terrain: {level_set: FILE}' may be a "
                     ".vdb, and 'soilvdb info' shows what is in it");
  const std::string text = read_text(file, kMaxYamlBytes);
  try {
    const DocumentStarts starts(text);
    if (starts.second_line > 0) {
      throw InputError(file, starts.second_line, "a second document starts; there must be one");
    }
    const YAML::Node document = YAML::Load(text);
    if (document.IsNull()) throw InputError(file, "is empty");
    return document;
  } catch (const YAML::Exception& e) {
    refuse(file, text, e);
  }
}

std::string key_without_blank(std::string_view line) {
  const auto skip = [&](const char* characters) {
    line.remove_prefix(std::min(line.find_first_not_of(characters), line.size()));
  };
  skip(" ");
  while (line.starts_with("- ")) {
    line.remove_prefix(1);
    skip(" ");
  }
  if (line.empty()) return "";
  const std::size_t colon = line.find_first_not_of("abcdefghijklmnopqrstuvwxyz_");
  if (colon == 0 || colon >= line.size() - 1 || line[colon] != ':') return "";
  return std::string_view(" \t\r\n:/\\").find(line[colon + 1]) == std::string_view::npos
             ? std::string(line.substr(0, colon))
             : "";
}

std::string no_blank(const std::string& key) {
  return "a blank is missing after the colon of '" + printable(key) + "'";
}

}  // namespace soilvdb::inline v0::io
