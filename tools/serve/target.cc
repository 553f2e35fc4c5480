// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/target.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <stdexcept>

#include "io/file/instant.h"
#include "io/file/text.h"

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

bool QueryParameters::are_for(std::string_view path,
                              std::initializer_list<const char*> known) const {
  if (target_.path != path) return false;
  for (const auto& [name, value] : target_.values)
    if (name != "token" && std::find(known.begin(), known.end(), name) == known.end())
      throw std::invalid_argument(
          fmt::format("unknown '{}' for {}", io::printable(name), target_.path));
  return true;
}

const std::string& QueryParameters::text(const std::string& name) const {
  const auto found = target_.values.find(name);
  if (found == target_.values.end())
    throw std::invalid_argument(fmt::format("'{}' is missing", name));
  return found->second;
}

std::string QueryParameters::text_if(const std::string& name) const {
  return target_.values.contains(name) ? text(name) : std::string();
}

std::vector<double> QueryParameters::numbers(const std::string& name, double most) const {
  std::vector<double> all;
  const std::string_view whole = text(name);
  for (std::size_t at = 0; at <= whole.size();) {
    const std::size_t end = std::min(whole.find(',', at), whole.size());
    const auto value = io::parse_number(whole.substr(at, end - at));
    if (!value || !(std::abs(*value) <= most))
      throw std::invalid_argument(fmt::format("'{}' must be numbers, and '{}' is not", name,
                                              io::printable(whole.substr(at, end - at))));
    all.push_back(*value);
    at = end + 1;
  }
  return all;
}

double QueryParameters::number(const std::string& name, double most) const {
  const std::vector<double> all = numbers(name, most);
  if (all.size() != 1) throw std::invalid_argument(fmt::format("'{}' must be one number", name));
  return all[0];
}

double QueryParameters::time(const std::string& name) const {
  const auto given = target_.values.find(name);
  if (given == target_.values.end() || !io::is_date(given->second))
    return number(name, kMostTime_s);
  try {
    return io::date_time_s(given->second);
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(fmt::format("'{}': {}", name, e.what()));
  }
}

std::optional<double> QueryParameters::number_if(const std::string& name) const {
  if (!target_.values.contains(name)) return {};
  return number(name, kMostTime_s);
}

std::optional<double> QueryParameters::time_if(const std::string& name) const {
  if (!target_.values.contains(name)) return {};
  return time(name);
}

std::string QueryParameters::word(const std::string& name,
                                  const std::vector<std::string>& words) const {
  const auto found = target_.values.find(name);
  if (found == target_.values.end()) return words.front();
  if (std::find(words.begin(), words.end(), found->second) == words.end())
    throw std::invalid_argument(
        fmt::format("'{}' must be one of {}", name, fmt::join(words, ", ")));
  return found->second;
}

Vec2 QueryParameters::place(const std::string& name) const {
  const std::vector<double> all = numbers(name);
  if (all.size() != 2) throw std::invalid_argument(fmt::format("'{}' must be x,y", name));
  return {all[0], all[1]};
}

std::vector<Vec2> QueryParameters::corners(const std::string& name) const {
  const std::vector<double> all = numbers(name);
  if (all.size() % 2 != 0 || all.size() < 6 || all.size() > 2 * kMostCorners)
    throw std::invalid_argument(
        fmt::format("'{}' must be 3 to {} corners x,y", name, kMostCorners));
  std::vector<Vec2> corners;
  for (std::size_t i = 0; i < all.size(); i += 2) corners.emplace_back(all[i], all[i + 1]);
  return corners;
}

std::string in_address(std::string_view value) {
  std::string out;
  for (const char c : value) {
    const auto byte = static_cast<unsigned char>(c);
    const bool plain = byte < 0x80 && (std::isalnum(byte) != 0 || c == '-' || c == '_' || c == '.');
    out += plain ? std::string(1, c) : fmt::format("%{:02X}", byte);
  }
  return out;
}

}  // namespace soilvdb::tools
