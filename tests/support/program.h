// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs the program as its users do, in a folder of its own, and scenarios written for it.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>
#include <string>

#include "tests/support/temp_folder.h"

#ifndef SOILVDB_PROGRAM
#error "the program's tests need SOILVDB_TOOLS"
#endif

namespace soilvdb::test {

namespace fs = std::filesystem;

inline std::string read_file(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

inline void write_file(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

inline nlohmann::json read_json(const fs::path& file) {
  return nlohmann::json::parse(read_file(file), nullptr, false);
}

struct Result {
  int status = -1;
  std::string out, err;
};

/// A fresh folder for each test, gone at its end; the program runs in it.
class ProgramTest : public ::testing::Test {
 protected:
  void SetUp() override { fs::create_directories(folder_); }

  const fs::path& folder() const { return folder_; }

  /// Runs `soilvdb ARGUMENTS`, which a shell reads.
  Result run(const std::string& arguments) const {
    return shell(fmt::format("'{}' {}", SOILVDB_PROGRAM, arguments));
  }
  Result shell(const std::string& command) const {
    const int status =
        std::system(fmt::format("cd '{}' && {{ {}\n}} >'{}/out' 2>'{}/err'", folder_.string(),
                                command, temp_.path().string(), temp_.path().string())
                        .c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status),
            read_file(temp_ / "out"), read_file(temp_ / "err")};
  }

  /// Runs it and expects exit status 0.
  Result good(const std::string& arguments) const {
    const Result result = run(arguments);
    EXPECT_EQ(result.status, 0) << arguments << ": " << result.err;
    return result;
  }
  /// Runs it and expects exit status 1 with `hint` on stderr.
  Result bad(const std::string& arguments, const std::string& hint) const {
    const Result result = run(arguments);
    EXPECT_EQ(result.status, 1) << arguments;
    EXPECT_NE(result.err.find(hint), std::string::npos) << arguments << ": " << result.err;
    return result;
  }

  /// Leaves of a run's journal its first frame, the configuration, and a share of the rest.
  static void cut_journal(const fs::path& journal, double share) {
    const std::string bytes = read_file(journal);
    std::uint32_t content = 0;
    std::memcpy(&content, bytes.data() + 4, sizeof content);
    const double first = 32.0 + content, rest = static_cast<double>(bytes.size()) - first;
    fs::resize_file(journal, static_cast<std::uintmax_t>(first + rest * share));
  }

  /// Everything in the folder, by name, with its content.
  std::map<std::string, std::string> content() const {
    std::map<std::string, std::string> all;
    for (const auto& entry : fs::recursive_directory_iterator(folder_))
      all[entry.path().string()] = entry.is_regular_file() ? read_file(entry.path()) : "";
    return all;
  }

  /// Runs it and expects exit status 2 with one line on stderr that has `hint` in it, nothing on
  /// stdout, and nothing written.
  void expect_refused(const std::string& arguments, const std::string& hint) const {
    SCOPED_TRACE(arguments);
    const auto before = content();
    const Result result = run(arguments);
    EXPECT_EQ(result.status, 2);
    EXPECT_EQ(result.out, "");
    EXPECT_TRUE(result.err.starts_with("soilvdb: ")) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_TRUE(result.err.ends_with("\n"));
    EXPECT_NE(result.err.find(hint), std::string::npos) << result.err;
    EXPECT_EQ(content(), before);
  }

 private:
  test::TempFolder temp_;
  const fs::path folder_ = temp_ / "work";
};

/// A dig with a closed form: a mouth 0.2 m wide that stays upright while its lip follows half a
/// sine, 1 m long, down to pi^2 / 32 m below flat ground: 2 / pi of 1 m x depth x width is cut.
struct HalfSine {
  static constexpr double kWidth_m = 0.2, kLength_m = 1;
  static constexpr double kDepth_m = std::numbers::pi * std::numbers::pi / 32;
  static constexpr double kVolume_m3 = 2 / std::numbers::pi * kLength_m * kDepth_m * kWidth_m;

  double x_m = 0, y_m = 0, yaw_rad = 0;  ///< where the dig begins, and its direction
  double duration_s = 5;

  /// Rows first..last of `rows` even in time.
  std::string csv(int rows, int first, int last) const {
    std::string text = "time,x,y,z,yaw\n";
    for (int i = first; i <= last; ++i) {
      const double s = static_cast<double>(i) / (rows - 1);
      text +=
          fmt::format("{},{},{},{},{}\n", duration_s * s, x_m + kLength_m * s * std::cos(yaw_rad),
                      y_m + kLength_m * s * std::sin(yaw_rad),
                      -kDepth_m * std::sin(std::numbers::pi * s), yaw_rad);
    }
    return text;
  }
  std::string csv(int rows) const { return csv(rows, 0, rows - 1); }
};

inline std::string half_sine_scenario(const std::string& terrain = "{plane: {z: 0}}",
                                      const std::string& motion = "dig.csv",
                                      const std::string& output = "") {
  return fmt::format(
      "soilvdb: 1\nname: dig\nvoxel_size: 0.025\nterrain: {}\nmachines:\n"
      "  - name: digger\n    bucket: {{width: 0.2, height: 0.5}}\n    motion: {}\n{}",
      terrain, motion, output.empty() ? "" : "output: " + output + "\n");
}

}  // namespace soilvdb::test
