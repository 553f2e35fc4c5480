// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/file/shared_library.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <stdexcept>
#include <utility>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {

SharedLibrary::SharedLibrary(std::string file, std::string name, const char* users)
    : file_(std::move(file)),
      name_(std::move(name)),
      library_(dlopen(file_.c_str(), RTLD_LAZY | RTLD_LOCAL)) {
  if (library_ != nullptr) return;
  const char* const why = dlerror();
  throw std::runtime_error(fmt::format("{} can't be loaded, which {} need: {}", name_, users,
                                       printable(why != nullptr ? why : file_)));
}

void* SharedLibrary::find(const std::string& symbol) const {
  if (void* const found = dlsym(library_, symbol.c_str())) return found;
  throw std::runtime_error(
      fmt::format("{} can't be used: {} has no function {}", name_, file_, symbol));
}

}  // namespace soilvdb::inline v0::io
