// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/report.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <string_view>
#include <thread>

namespace soilvdb::bench {
namespace {

std::string goal(const Figure& f) {
  if (f.at_most && f.at_least) return fmt::format("{:g} to {:g}", *f.at_least, *f.at_most);
  if (f.at_most) return fmt::format("<= {:g}", *f.at_most);
  if (f.at_least) return fmt::format(">= {:g}", *f.at_least);
  return "";
}

std::string verdict(const Figure& f) {
  if (!f.at_most && !f.at_least) return "";
  const bool met = (!f.at_most || f.value <= *f.at_most) && (!f.at_least || f.value >= *f.at_least);
  return met ? "PASS" : "miss";
}

}  // namespace

Options parse(int argc, char** argv, const std::string& name) {
  Options options;
  options.out = std::filesystem::path("out/bench") / name;
  for (int i = 1; i < argc; ++i) {
    const std::string_view arg = argv[i];
    if (arg == "--quick") {
      options.quick = true;
    } else if (arg == "--out" && i + 1 < argc) {
      options.out = argv[++i];
    } else if (arg == "--threads" && i + 1 < argc && std::atoi(argv[i + 1]) > 0) {
      options.threads = std::atoi(argv[++i]);
    } else {
      throw std::invalid_argument(
          fmt::format("'{}': expected --quick, --out DIR, --threads N", arg));
    }
  }
  std::filesystem::create_directories(options.out);
  return options;
}

double quantile(std::vector<double>& values, double part) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  const auto at = static_cast<std::size_t>(part * static_cast<double>(values.size()));
  return values[std::min(at, values.size() - 1)];
}

double rss_bytes() {
  std::ifstream in("/proc/self/statm");
  double total = 0, resident = 0;
  in >> total >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

std::string machine() {
  std::string line, model = "unknown CPU", load = "?";
  for (std::ifstream in("/proc/cpuinfo"); std::getline(in, line);) {
    if (line.starts_with("model name")) model = line.substr(line.find(':') + 2);
  }
  std::ifstream("/proc/loadavg") >> load;
  return fmt::format("{}, {} threads, load average {} at the start", model,
                     std::thread::hardware_concurrency(), load);
}

Progress::~Progress() {
  if (isatty(STDERR_FILENO)) fmt::print(stderr, "\r\033[K");
}

void Progress::step(const std::string& what) {
  const std::size_t n = std::min(done_++, steps_);
  if (!isatty(STDERR_FILENO)) {
    fmt::print(stderr, "[{}/{}] {:.0f} s  {}\n", n + 1, steps_, since_.seconds(), what);
    return;
  }
  const std::size_t filled = steps_ > 0 ? 30 * n / steps_ : 0;
  const double left =
      n > 0 ? since_.seconds() * static_cast<double>(steps_ - n) / static_cast<double>(n) : 0;
  fmt::print(stderr, "\r\033[K[{:-<30}] {}/{} ~{:.0f} s left  {}", std::string(filled, '#'), n,
             steps_, left, what);
}

Csv::Csv(const std::filesystem::path& file, const std::string& header) : out_(file) {
  if (!out_) throw std::runtime_error(file.string() + ": can't be written");
  row(header);
}

void Csv::row(const std::string& line) { out_ << line << '\n' << std::flush; }

void Goals::add(const Figure& f) {
  figures_.push_back(f);
  csv_.row(fmt::format("\"{}\",{:.6g},{},{},{},\"{}\"", f.what, f.value, f.unit, goal(f),
                       verdict(f), f.note));
}

void Goals::print() const {
  fmt::print("\n{:<62} {:>12} {:<10} {:>10}  {}\n", "figure", "measured", "", "goal", "");
  for (const Figure& f : figures_) {
    fmt::print("{:<62} {:>12.4g} {:<10} {:>10}  {} {}\n", f.what, f.value, f.unit, goal(f),
               verdict(f), f.note);
  }
}

}  // namespace soilvdb::bench
