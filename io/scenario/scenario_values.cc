// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The values of a scenario, independent of their notation.
#include <fmt/format.h>

#include <string>
#include <string_view>

#include "io/file/text.h"
#include "io/scenario/yaml_file.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostValues = 1'000'000;  // aliases could multiply them
constexpr int kDeepest = 20;

class Values {
 public:
  explicit Values(const std::filesystem::path& file) : file_(file) {}

  void add(const std::string& key, const YAML::Node& node, int depth = 0) {
    if (depth > kDeepest || values_.size() > kMostValues)
      throw InputError(file_, "has more values, or deeper ones, than a scenario");
    if (node.IsMap()) {
      for (const auto& entry : node) {
        const std::string name = entry.first.IsScalar() ? entry.first.Scalar() : "?";
        add(key.empty() ? name : key + "." + name, entry.second, depth + 1);
      }
    } else if (node.IsSequence()) {
      for (std::size_t i = 0; i < node.size(); ++i)
        add(fmt::format("{}[{}]", key, i), node[i], depth + 1);
      values_[key] = fmt::format("a list of {}", node.size());
    } else {
      values_[key] = text_of(key, node);
    }
  }
  ScenarioValues take() { return std::move(values_); }

 private:
  static std::string text_of(std::string_view key, const YAML::Node& node) {
    if (!node.IsScalar()) return "";
    // 0.050 equals 0.05 as a number, but not as a name.
    const auto number = parse_number(node.Scalar());
    return number && !key.ends_with("name") ? fmt::format("{}", *number) : node.Scalar();
  }

  const std::filesystem::path& file_;
  ScenarioValues values_;
};

}  // namespace

ScenarioValues scenario_values(const std::filesystem::path& file) {
  Values values(file);
  values.add("", read_yaml(file));
  return values.take();
}

std::string difference(const ScenarioValues& before, const ScenarioValues& now) {
  for (const auto& [key, value] : before) {
    const auto found = now.find(key);
    if (found == now.end())
      return fmt::format("{} was {} and is gone", printable(key), printable(value));
    if (found->second != value)
      return fmt::format("{} was {} and is {}", printable(key), printable(value),
                         printable(found->second));
  }
  for (const auto& [key, value] : now)
    if (!before.contains(key)) return fmt::format("{} was not there", printable(key));
  return "";
}

}  // namespace soilvdb::inline v0::io
