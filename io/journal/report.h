// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A run's report for other programs: summary.json, and updates.csv with one row per update.
#pragma once

#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/capacity.h"
#include "soilvdb/survey.h"

namespace soilvdb::inline v0::io {

/// Durations of updates in constant memory: exact mean and maximum, quantiles within 1 %.
class Durations {
 public:
  void add(double us);
  std::int64_t count() const { return count_; }
  double sum_us() const { return sum_us_; }
  double mean_us() const;
  double max_us() const { return max_us_; }
  /// The duration that a share `q` in [0, 1] of all does not exceed; 0 without durations.
  double quantile_us(double q) const;

 private:
  static constexpr int kPerOctave = 64;
  static constexpr int kOctaves = 50;                       ///< from 1 ns to 13 days
  std::array<std::int64_t, kPerOctave * kOctaves> bins_{};  ///< by logarithm of the duration
  std::int64_t count_ = 0;
  double sum_us_ = 0, max_us_ = 0;
};

/// The content of summary.json, with its names.
struct Summary {
  struct Machine {
    std::string name;
    double bucket_m3 = 0, cut_m3 = 0;
    std::int64_t bad_rows = 0;  ///< in its motion
    double bucket_kg = 0;       ///< with moving soil only, as the next ones
    std::optional<Capacity> capacity = {};
    std::optional<Estimate> lip_error_m = {};  ///< with scans only
  };
  /// With moving soil.
  struct Moved {
    double spilled_m3 = 0, poured_m3 = 0, hauled_m3 = 0, slid_m3 = 0, fill_m3 = 0;
    double ground_change_kg = 0, buckets_kg = 0, hauled_kg = 0, poured_kg = 0, pending_kg = 0,
           residual_kg = 0;
    std::optional<double> surveyed_kg = {};  ///< with scans only
  };
  /// Volumes that scans corrected, in place.
  struct SurveyedVolumes {
    double removed_m3 = 0, added_m3 = 0;
  };
  std::string scenario;
  double voxel_size_m = 0;
  int threads = 0;
  double cut_m3 = 0, captured_m3 = 0, displaced_m3 = 0, dumped_m3 = 0;
  double ground_change_m3 = 0, residual_m3 = 0;
  /// Volume of lower and of higher columns against the ground before digging; only if this run was
  /// the first to dig.
  struct Net {
    double cut_m3 = 0, fill_m3 = 0;
  };
  std::optional<Net> net = {};
  std::optional<Moved> moved;
  std::optional<SurveyedVolumes> surveyed = {};
  std::vector<Machine> machines;
  double acknowledged_s = 0;               ///< the recording is safe on disk up to this time
  std::uint64_t acknowledged_updates = 0;  ///< and this number of updates
  Durations updates;
  double open_s = 0, total_s = 0;
  std::uint64_t soil_bytes = 0, peak_rss_bytes = 0;
  std::uint64_t leaves = 0, active_voxels = 0;
  double resident_m2 = 0;
  std::uint64_t state_hash = 0;
  std::vector<std::string> files;  ///< relative to the run's folder
};

/// The text of summary.json.
std::string to_json(const Summary& summary);

/// Writes updates.csv row by row into FILE.part, which close() renames to FILE. Without close()
/// FILE.part is removed, and an older FILE stays.
class UpdatesCsv {
 public:
  /// More columns of a row, with moving soil.
  struct Moved {
    double bucket_kg = 0, spilled_m3 = 0, slid_m3 = 0;
  };

  /// @throw std::runtime_error naming the file and the cause, as the other members do.
  /// @param has_force are there columns of the force on the bucket?
  explicit UpdatesCsv(std::filesystem::path file, bool soil_moves = false, bool has_force = false);
  ~UpdatesCsv();
  UpdatesCsv(const UpdatesCsv&) = delete;
  UpdatesCsv& operator=(const UpdatesCsv&) = delete;

  void add(double time_s, std::string_view machine, double cut_m3, double bucket_m3,
           double update_us, const std::optional<Moved>& moved = {},
           const std::optional<std::array<double, 6>>& force = {});
  void close();

 private:
  struct Closer {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  std::filesystem::path file_, part_;
  bool has_force_;
  std::unique_ptr<std::FILE, Closer> stream_;
};

}  // namespace soilvdb::inline v0::io
