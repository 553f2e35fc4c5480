// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The program's commands, one file each, apart from how their options are spelt. A command returns
// when it is done and throws io::InputError where the input or the command line is wrong (nothing
// is written then), any other exception where something else went wrong.
#pragma once

#include <csignal>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace soilvdb::tools {

/// Set by SIGINT and SIGTERM: finish the update, save and stop.
extern volatile std::sig_atomic_t stop_requested;

struct RunOptions {
  std::filesystem::path scenario;
  std::optional<std::filesystem::path> out;  ///< default: out/<scenario name>
  std::optional<double> voxel_size_m;        ///< instead of the scenario's
  int threads = 0;                           ///< 0: one per core
  std::optional<std::int64_t> updates;       ///< of each machine; default: one per row
  std::optional<std::int64_t> memory_mb;     ///< for the ground; default: what it takes
  bool mesh = true;
  bool snapshots = true;
};
void run(const RunOptions& options);

struct ResumeOptions {
  std::filesystem::path folder;
  std::optional<std::int64_t> memory_mb;  ///< instead of the run's
};
void resume(const ResumeOptions& options);

struct VerifyOptions {
  std::filesystem::path path;
};
void verify(const VerifyOptions& options);

struct InfoOptions {
  std::filesystem::path file;
};
void info(const InfoOptions& options);

struct ExportOptions {
  std::filesystem::path file, to;
  std::optional<std::string> region;  ///< XMIN,YMIN,XMAX,YMAX
  std::optional<std::string> view;    ///< of a picture: plan (default) or perspective
};
void export_file(const ExportOptions& options);

struct DiffOptions {
  std::filesystem::path before, after;
  std::optional<std::filesystem::path> to;
  bool json = false;
};
void diff(const DiffOptions& options);

}  // namespace soilvdb::tools
