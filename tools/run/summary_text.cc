// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/summary_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tools/run/progress.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

constexpr std::size_t kMostListed = 8;  // machines, files

void line(std::string_view label, const std::string& text) {
  fmt::print("{:<12}{}\n", label, text);
}

void print_machines(const std::vector<io::Summary::Machine>& machines) {
  for (std::size_t i = 0; i < std::min(machines.size(), kMostListed); ++i)
    line(i ? "" : "in bucket",
         fmt::format("{} m³ {}", number(machines[i].bucket_m3), machines[i].name));
  if (machines.size() > kMostListed)
    line("", fmt::format("... {} more in {}", machines.size() - kMostListed, kSummaryName));
  for (std::size_t i = 0; i < std::min(machines.size(), kMostListed); ++i)
    if (const auto& error = machines[i].lip_error_m)
      line("lip error", fmt::format("{:.3f} ± {:.3f} m {}, as told less the true", error->mean,
                                    error->sigma, machines[i].name));
}

/// The terms of the balance that aren't 0.
std::string mass_terms(const io::Summary::Moved& moved) {
  std::string text = fmt::format("ground {} kg", number(moved.ground_change_kg));
  for (const auto& [what, kg] :
       {std::pair("buckets", moved.buckets_kg), std::pair("hauled", moved.hauled_kg),
        std::pair("in flight", moved.pending_kg), std::pair("poured", moved.poured_kg),
        std::pair("surveyed", moved.surveyed_kg.value_or(0))})
    if (kg != 0) text += fmt::format(", {} {} kg", what, number(kg));
  return text;
}

std::string file_list(const std::vector<std::string>& files) {
  if (files.size() <= kMostListed) return fmt::format("{}", fmt::join(files, ", "));
  const auto last = files.end() - static_cast<std::ptrdiff_t>(kMostListed - 2);
  return fmt::format("{}, ... {} ({} files)", files.front(), fmt::join(last, files.end(), ", "),
                     files.size());
}

}  // namespace

void print_summary(const io::Summary& s, double motion_s, const RunFolder& folder) {
  const io::Durations& updates = s.updates;
  fmt::print("{}: {} of {}, {} s of motion, {} m voxels, {}\n\n", s.scenario,
             counted(updates.count(), "update"), counted(s.machines.size(), "machine"),
             time_text(motion_s), length_text(s.voxel_size_m), counted(s.threads, "thread"));
  const auto cubic_metres = [](std::string_view label, double m3) {
    line(label, fmt::format("{} m³", number(m3)));
  };
  const auto residual = [](double value) {
    return value == 0 ? "0" : fmt::format("{:.1e}", value);
  };
  // Volumes are whole samples, so that less than one is rounding.
  const double sample_m3 = std::pow(s.voxel_size_m, 3) / 64;
  const std::string residual_m3 =
      residual(std::abs(s.residual_m3) < sample_m3 / 2 ? 0 : s.residual_m3);
  line("net", fmt::format("{} m³{}", number(s.ground_change_m3),
                          s.net ? fmt::format(": cut {} m³, fill {} m³", number(s.net->cut_m3),
                                              number(s.net->fill_m3))
                                : ""));
  cubic_metres("dug", s.cut_m3);
  cubic_metres("  captured", s.captured_m3);
  cubic_metres("  displaced", s.displaced_m3);
  if (const auto& m = s.moved) {
    cubic_metres("put down", m->spilled_m3);
    cubic_metres("filled", m->fill_m3);
    cubic_metres("poured", m->poured_m3);
    cubic_metres("hauled", m->hauled_m3);
    cubic_metres("slid", m->slid_m3);
  } else {
    cubic_metres("dumped", s.dumped_m3);
  }
  if (s.surveyed)
    line("surveyed", fmt::format("removed {} m³, added {} m³", number(s.surveyed->removed_m3),
                                 number(s.surveyed->added_m3)));
  print_machines(s.machines);
  line("balance", s.moved ? fmt::format("{} m³, {} kg: {}", residual_m3,
                                        residual(s.moved->residual_kg), mass_terms(*s.moved))
                          : fmt::format("{} m³", residual_m3));
  line("ground", fmt::format("{} m² resident, {} chunks, {} voxels", number(s.resident_m2),
                             s.leaves, s.active_voxels));
  line("update",
       fmt::format("p50 {} µs, p99 {} µs, max {} µs; {} updates/s",
                   number(updates.quantile_us(0.5)), number(updates.quantile_us(0.99)),
                   number(updates.max_us()), short_count(1e6 / std::max(updates.mean_us(), 1e-3))));
  line("memory", fmt::format("soil {}, peak {}", bytes(static_cast<double>(s.soil_bytes)),
                             bytes(static_cast<double>(s.peak_rss_bytes))));
  // Sums of the machines' times; machines that are apart update in parallel.
  const bool beside = s.machines.size() > 1 && s.threads > 1;
  line("time", fmt::format("in all {}: opening {}, updates {}{}", short_duration(s.total_s),
                           short_duration(s.open_s), short_duration(updates.sum_us() * 1e-6),
                           beside ? ", one by one: several may run at once" : ""));
  line("files", fmt::format("in {}: {}", folder.path().string(), file_list(folder.files())));
}

}  // namespace soilvdb::tools
