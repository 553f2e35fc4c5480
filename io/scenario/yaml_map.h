// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Strict reading of a YAML map: every value has the type asked for, every key is known.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/io/error.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// One map of a YAML file. All members throw InputError with file and line.
class YamlMap {
 public:
  /// @param what name of the map in messages
  /// @param known all allowed keys; a repeated key is an error, too
  YamlMap(const std::filesystem::path& file, const YAML::Node& node, std::string what,
          std::vector<std::string> known);

  /// The document of read_yaml(), if it is a map; throws otherwise.
  static YamlMap load(const std::filesystem::path& file, std::string what,
                      std::vector<std::string> known);

  bool has(const std::string& key) const;
  bool is_map(const std::string& key) const;
  /// Keys of the map under `key`, in the file's order.
  std::vector<std::string> keys(const std::string& key) const;
  /// The map or list under `key`; throws if it is missing.
  YamlMap map(const std::string& key, std::vector<std::string> known) const;
  std::vector<YamlMap> maps(const std::string& key, const std::string& what,
                            std::vector<std::string> known) const;
  std::string text(const std::string& key) const;
  /// One text, or a list of at least one.
  std::vector<std::string> texts(const std::string& key) const;
  /// One line that can be a file name.
  std::string name(const std::string& key) const;
  /// A path, resolved against the YAML file's folder.
  std::filesystem::path path(const std::string& key) const;
  std::vector<std::filesystem::path> paths(const std::string& key) const;  ///< like texts()
  double number(const std::string& key) const;
  double number(const std::string& key, double least, double most, const char* unit) const;
  std::size_t count(const std::string& key, std::size_t least, std::size_t most) const;
  bool flag(const std::string& key) const;
  /// `n` numbers.
  std::vector<double> numbers(const std::string& key, std::size_t n) const;
  /// Points [x, z].
  std::vector<Vec2> points(const std::string& key) const;
  /// Points [x, y, z].
  std::vector<Vec3> places(const std::string& key) const;

  /// "FILE:LINE" of `key`, or of the map if it lacks the key.
  std::string place(const std::string& key) const;
  /// @throw InputError at place(key).
  [[noreturn]] void fail(const std::string& key, const std::string& message) const;

 private:
  YAML::Node at(const std::string& key) const;
  YAML::Node node_of(const std::string& key) const;
  [[noreturn]] void fail(const YAML::Node& node, const std::string& message) const;
  double number(const YAML::Node& node, const std::string& name) const;
  std::vector<double> numbers(const YAML::Node& node, std::size_t n, const std::string& name) const;
  std::vector<std::vector<double>> lists(const std::string& key, std::size_t n,
                                         const char* form) const;

  std::filesystem::path file_;
  YAML::Node node_;
  std::string what_;
};

/// @throw std::invalid_argument unless `name` is one line that can be a file name.
void check_name(const std::string& name);

}  // namespace soilvdb::inline v0::io
