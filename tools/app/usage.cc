// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/app/usage.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <vector>

#include "io/file/text.h"

namespace soilvdb::tools {
namespace {

std::vector<std::string> commands(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
    names.push_back(sub->get_name());
  return names;
}

/// The message about an unexpected word on the command line.
std::string not_expected(const CLI::App& app) {
  const std::vector<std::string> words = app.remaining(true);
  const auto option = std::find_if(words.begin(), words.end(),
                                   [](const std::string& w) { return w.starts_with('-'); });
  if (option == words.end())
    return fmt::format("unexpected word '{}'", io::printable(words.front()));
  const std::string word = option->substr(0, option->find('='));
  std::vector<std::string> known;
  for (const CLI::Option* o : app.get_subcommands().front()->get_options())
    for (const std::string& name : o->get_lnames()) known.push_back("--" + name);
  return fmt::format("no option '{}', the nearest is '{}'", io::printable(word),
                     io::nearest(word, known));
}

bool takes_value(const CLI::Option& option) { return option.get_expected_max() > 0; }

/// "--out DIR", "SCENARIO", "--no-mesh"
std::string with_value(const CLI::Option& option) {
  if (option.get_positional()) return option.get_name(true);
  return option.get_name() + (takes_value(option) ? ' ' + option.get_type_name() : "");
}

/// "export FILE --to OUT": a command with its required arguments.
std::string usage(const CLI::App& command) {
  std::string text = command.get_name();
  for (const CLI::Option* o : command.get_options())
    if (o->get_required()) text += ' ' + with_value(*o);
  return text;
}

/// The message about a missing or surplus argument. CLI11's own are "DIR is required", "--out: 1
/// required DIR missing" and "Could not convert: --no-mesh = maybe".
std::string missing_or_not_wanted(const CLI::App& command, const CLI::ParseError& error) {
  const std::string said = error.what();
  for (const CLI::Option* o : command.get_options()) {
    const std::string name = o->get_name(o->get_positional());
    if (said.starts_with(name + ' '))
      return fmt::format("{} is missing; usage: soilvdb {}", with_value(*o), usage(command));
    if (said.starts_with(name + ':') && takes_value(*o))
      return fmt::format("{} needs a value; usage: {}", name, with_value(*o));
    if (!takes_value(*o) && said.find(name + " = ") != said.npos)
      return fmt::format("{} takes no value", name);
  }
  return said;
}

}  // namespace

bool has_command(const CLI::App& app, const std::string& word) {
  const std::vector<std::string> known = commands(app);
  return std::find(known.begin(), known.end(), word) != known.end();
}

std::string unknown_command(const CLI::App& app, const std::string& word) {
  const std::vector<std::string> names = commands(app);
  return fmt::format("no command '{}', the nearest is '{}'; there are {}", io::printable(word),
                     io::nearest(word, names), fmt::join(names, ", "));
}

std::string explain(const CLI::App& app, const CLI::ParseError& error) {
  const auto used = app.get_subcommands();
  const std::string command = used.empty() ? "" : used.front()->get_name() + ' ';
  std::string what = error.what();
  if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr) {
    what = not_expected(app);
  } else if (used.empty()) {
    what = fmt::format("no command is named; there are {}", fmt::join(commands(app), ", "));
  } else if (dynamic_cast<const CLI::RequiredError*>(&error) != nullptr ||
             dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr ||
             dynamic_cast<const CLI::ConversionError*>(&error) != nullptr) {
    what = missing_or_not_wanted(*used.front(), error);
  }
  return fmt::format("{}; see soilvdb {}--help", what, command);
}

}  // namespace soilvdb::tools
