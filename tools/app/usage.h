// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is wrong with a command line and what would be right, in one line.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace soilvdb::tools {

bool has_command(const CLI::App& app, const std::string& word);
std::string unknown_command(const CLI::App& app, const std::string& word);

/// What CLI11 found wrong when it parsed, in our words.
std::string explain(const CLI::App& app, const CLI::ParseError& error);

}  // namespace soilvdb::tools
