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

/// Members of a struct after its SharedLibrary `library`: up to 256 functions of it, each by its
/// own name.
#define SOILVDB_FUNCTIONS(...) SOILVDB_RESCAN(SOILVDB_FUNCTION(__VA_ARGS__)) static_assert(true)

// A macro isn't expanded within itself, so each scan of the text takes one more of the names.
#define SOILVDB_FUNCTION(name, ...)                                          \
  const decltype(&::name) name = library.function<decltype(&::name)>(#name); \
  __VA_OPT__(SOILVDB_NEXT_FUNCTION SOILVDB_NO_NAMES(__VA_ARGS__))
#define SOILVDB_NEXT_FUNCTION() SOILVDB_FUNCTION
#define SOILVDB_NO_NAMES ()
#define SOILVDB_RESCAN(...) SOILVDB_MANY(SOILVDB_MANY(SOILVDB_MANY(SOILVDB_MANY(__VA_ARGS__))))
#define SOILVDB_MANY(...) SOILVDB_SOME(SOILVDB_SOME(SOILVDB_SOME(SOILVDB_SOME(__VA_ARGS__))))
#define SOILVDB_SOME(...) SOILVDB_FEW(SOILVDB_FEW(SOILVDB_FEW(SOILVDB_FEW(__VA_ARGS__))))
#define SOILVDB_FEW(...) SOILVDB_ONE(SOILVDB_ONE(SOILVDB_ONE(SOILVDB_ONE(__VA_ARGS__))))
#define SOILVDB_ONE(...) __VA_ARGS__
