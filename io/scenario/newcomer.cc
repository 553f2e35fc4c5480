// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/newcomer.h"

#include <fmt/format.h>

#include "io/file/text.h"
#include "io/scenario/earthmoving.h"

namespace soilvdb::inline v0::io {

void read_newcomer(const std::string& text, const Scenario& site, const char* what,
                   std::vector<std::string> known,
                   const std::function<void(const YamlMap&)>& read) {
  try {
    read(YamlMap(site.file, YAML::Load(text), what, std::move(known)));
  } catch (const YAML::Exception& e) {
    throw InputError(fmt::format("{} can't be read: {}", what, e.msg));
  } catch (const InputError& e) {
    std::string why = e.what();
    for (const char* line : {":1: ", ": "})
      if (const std::string place = site.file.string() + line; why.starts_with(place))
        why.erase(0, place.size());
    throw InputError(why);
  }
}

void require_new_name(const std::string& name, const Scenario& site) {
  try {
    check_name(name);
  } catch (const std::invalid_argument& e) {
    throw InputError(std::string("name ") + e.what());
  }
  const auto require_other = [&](const auto& all, const char* kind) {
    for (const auto& one : all)
      if (one.name == name)
        throw InputError(
            fmt::format("'{}' is the name of a {}; names must differ", printable(name), kind));
  };
  require_other(site.machines, "machine");
  require_other(site.pours, "pour");
  require_other(site.hoppers, "hopper");
}

}  // namespace soilvdb::inline v0::io
