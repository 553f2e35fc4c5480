// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The program's commands, one file each, without the command line's syntax. A command throws
// io::InputError, with nothing written, if the input or the command line is wrong, and another
// exception for any other failure.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "tools/run/run_options.h"

namespace soilvdb::tools {

/// From now on SIGINT and SIGTERM request a stop. Before, they end the program.
void stop_on_signals();

void run(const RunOptions& options);

struct ResumeOptions {
  std::filesystem::path folder;
  std::optional<std::int64_t> memory_mb;  ///< in place of the run's
};
void resume(const ResumeOptions& options);

/// @param path the folder of a run, or a file
void verify(const std::filesystem::path& path);

void info(const std::filesystem::path& file);

struct ExportOptions {
  std::filesystem::path file, to;
  std::optional<std::string> region;  ///< XMIN,YMIN,XMAX,YMAX
  std::optional<std::string> view;    ///< for a picture: plan (default) or perspective
  bool occupancy = false;             ///< for a .vdb: fill fractions in place of a level set
};
void export_file(const ExportOptions& options);

struct DiffOptions {
  std::filesystem::path before, after;
  std::optional<std::filesystem::path> to;
  bool json = false;
};
void diff(const DiffOptions& options);

struct ServeOptions {
  std::filesystem::path scenario;            ///< or the folder of a run or a recording
  std::optional<std::filesystem::path> out;  ///< default: out/<scenario name>_live
  std::string listen = "127.0.0.1";
  std::int64_t port = 8470;                      ///< 0: any free port
  std::optional<std::string> token, view_token;  ///< on the command line
  std::optional<std::filesystem::path> token_file, view_token_file;
  bool public_view = false;     ///< nobody who looks needs a token
  std::string base_path;        ///< "/dig" or empty
  std::optional<double> speed;  ///< factor at which the scenario's motions are played
  std::optional<std::filesystem::path> design, lines;
  std::optional<std::filesystem::path> drape;     ///< orthophoto or map
  std::optional<std::filesystem::path> boundary;  ///< corners that machines must not leave
  bool feed_stdin = false;
  bool ros = false;                 ///< exchange messages with nodes of ROS 2
  std::optional<std::string> mqtt;  ///< broker of MQTT, and topic
  std::optional<std::filesystem::path> mqtt_password_file;
};
void serve(const ServeOptions& options);

}  // namespace soilvdb::tools
