// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/target.h"

#include <algorithm>
#include <string_view>

namespace soilvdb::tools {
namespace {

int hex(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::optional<std::string> decoded(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i] == '+' ? ' ' : text[i];
      continue;
    }
    if (i + 2 >= text.size() || hex(text[i + 1]) < 0 || hex(text[i + 2]) < 0) return {};
    out += static_cast<char>(hex(text[i + 1]) * 16 + hex(text[i + 2]));
    i += 2;
  }
  return out;
}

}  // namespace

std::optional<Target> parse_target(const std::string& text) {
  Target target;
  const std::size_t mark = std::min(text.find('?'), text.size());
  const auto path = decoded(std::string_view(text).substr(0, mark));
  if (!path || path->empty() || path->front() != '/') return {};
  target.path = *path;
  for (std::size_t at = mark + 1; at < text.size();) {
    const std::size_t end = std::min(text.find('&', at), text.size());
    const std::string_view pair = std::string_view(text).substr(at, end - at);
    const std::size_t equals = pair.find('=');
    at = end + 1;
    if (pair.empty()) continue;
    if (equals == std::string_view::npos) return {};
    const auto name = decoded(pair.substr(0, equals)), value = decoded(pair.substr(equals + 1));
    if (!name || !value || !target.values.emplace(*name, *value).second) return {};
  }
  return target;
}

}  // namespace soilvdb::tools
