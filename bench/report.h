// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What every benchmark program shares: options, clock, progress, CSV files, the table of goals.
#pragma once

#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

namespace soilvdb::bench {

struct Options {
  bool quick = false;         ///< small sizes, seconds instead of minutes
  std::filesystem::path out;  ///< folder for CSV and data for plots
  int threads = 0;            ///< 0: all
};

/// From `--quick`, `--out DIR`, `--threads N`; makes the folder. @throw std::invalid_argument.
Options parse(int argc, char** argv, const std::string& name);

class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }
  double us() const { return seconds() * 1e6; }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// The fraction below which `part` of the values lie; sorts them.
double quantile(std::vector<double>& values, double part);
/// Resident set of this process now, bytes.
double rss_bytes();
/// Machine, cores, load: one line.
std::string machine();

/// On stderr: a bar on a terminal, a line for each step otherwise.
class Progress {
 public:
  explicit Progress(std::size_t steps) : steps_(steps) {}
  ~Progress();
  void step(const std::string& what);

 private:
  std::size_t steps_, done_ = 0;
  Stopwatch since_;
};

/// A CSV file, complete as soon as a row is added.
class Csv {
 public:
  Csv(const std::filesystem::path& file, const std::string& header);
  void row(const std::string& line);

 private:
  std::ofstream out_;
};

/// One figure with the goal it is held against.
struct Figure {
  std::string what;
  double value = 0;
  std::string unit;
  std::optional<double> at_most = {}, at_least = {};
  std::string note = {};
};

/// Figures as they come; printed as a table and kept in goals.csv.
class Goals {
 public:
  explicit Goals(const std::filesystem::path& folder)
      : csv_(folder / "goals.csv", "what,value,unit,goal,verdict,note") {}
  void add(const Figure& figure);
  void print() const;

 private:
  std::vector<Figure> figures_;
  Csv csv_;
};

}  // namespace soilvdb::bench
