// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A library that is loaded when it is first needed, because its own libraries take long to start.
#pragma once

#include <string>

namespace soilvdb::inline v0::io {

/// It stays loaded.
class SharedLibrary {
 public:
  /// @param file its soname @param name for messages, "GDAL" @param users "rasters"
  /// @throw std::runtime_error if it can't be loaded
  SharedLibrary(std::string file, std::string name, const char* users);

  /// A function of it, cast to its type. @throw std::runtime_error if there is none
  template <typename Function>
  Function function(const std::string& symbol) const {
    return reinterpret_cast<Function>(find(symbol));
  }

 private:
  void* find(const std::string& symbol) const;

  std::string file_, name_;
  void* library_;
};

}  // namespace soilvdb::inline v0::io
