// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One-line messages about a wrong command line.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace soilvdb::tools {

bool has_command(const CLI::App& app, const std::string& word);
std::string unknown_command(const CLI::App& app, const std::string& word);

/// The message about a parse error of CLI11.
std::string explain(const CLI::App& app, const CLI::ParseError& error);

}  // namespace soilvdb::tools
