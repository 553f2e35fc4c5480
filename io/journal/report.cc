// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/journal/report.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <nlohmann/json.hpp>

#include "io/file/atomic_file.h"
#include "io/file/json.h"

namespace soilvdb::inline v0::io {
namespace {

namespace fs = std::filesystem;

std::FILE* open_for_writing(const fs::path& file) {
  std::FILE* stream = std::fopen(file.c_str(), "wbe");
  if (!stream) fail_to_write(file, errno);
  return stream;
}

}  // namespace

void Durations::add(double us) {
  const double octave = std::log2(std::max(us * 1e3, 1.0));
  const auto bin = static_cast<std::size_t>(octave * kPerOctave);
  ++bins_[std::min(bin, bins_.size() - 1)];
  ++count_;
  sum_us_ += us;
  max_us_ = std::max(max_us_, us);
}

double Durations::mean_us() const { return count_ ? sum_us_ / static_cast<double>(count_) : 0; }

double Durations::quantile_us(double q) const {
  if (!count_) return 0;
  const auto rank = std::max<std::int64_t>(
      1, static_cast<std::int64_t>(std::ceil(q * static_cast<double>(count_))));
  std::int64_t seen = 0;
  for (std::size_t bin = 0; bin < bins_.size(); ++bin) {
    seen += bins_[bin];
    if (seen < rank) continue;
    const double middle = std::exp2((static_cast<double>(bin) + 0.5) / kPerOctave) * 1e-3;
    return std::min(middle, max_us_);
  }
  return max_us_;
}

std::string to_json(const Summary& s) {
  using Json = nlohmann::ordered_json;
  Json machines = Json::array();
  for (const Summary::Machine& m : s.machines) {
    machines.push_back({{"name", m.name},
                        {"bucket_m3", m.bucket_m3},
                        {"cut_m3", m.cut_m3},
                        {"bad_rows", m.bad_rows}});
    if (m.lip_error_m)
      machines.back()["lip_error_m"] = {{"mean", m.lip_error_m->mean},
                                        {"sigma", m.lip_error_m->sigma}};
    if (!s.moved) continue;
    machines.back()["bucket_kg"] = m.bucket_kg;
    if (m.capacity)
      machines.back()["capacity_m3"] = {{"struck", m.capacity->struck_m3()},
                                        {"heaped", m.capacity->heaped_m3()}};
  }
  Json volumes = {
      {"cut", s.cut_m3},       {"captured", s.captured_m3},           {"displaced", s.displaced_m3},
      {"dumped", s.dumped_m3}, {"ground_change", s.ground_change_m3}, {"residual", s.residual_m3}};
  if (s.net) volumes.update({{"net_cut", s.net->cut_m3}, {"net_fill", s.net->fill_m3}});
  if (s.surveyed)
    volumes.update(
        {{"surveyed_removed", s.surveyed->removed_m3}, {"surveyed_added", s.surveyed->added_m3}});
  Json masses;
  if (const auto& m = s.moved) {
    volumes.update({{"spilled", m->spilled_m3},
                    {"poured", m->poured_m3},
                    {"hauled", m->hauled_m3},
                    {"slid", m->slid_m3},
                    {"fill", m->fill_m3}});
    masses = {{"ground_change", m->ground_change_kg},
              {"buckets", m->buckets_kg},
              {"hauled", m->hauled_kg},
              {"poured", m->poured_kg},
              {"in_flight", m->pending_kg},
              {"residual", m->residual_kg}};
    if (m->surveyed_kg) masses["surveyed"] = *m->surveyed_kg;
  }
  Json json = {
      {"soilvdb", 1},
      {"scenario", s.scenario},
      {"voxel_size_m", s.voxel_size_m},
      {"threads", s.threads},
      {"updates", s.updates.count()},
      {"acknowledged", {{"updates", s.acknowledged_updates}, {"time_s", s.acknowledged_s}}},
      {"volume_m3", volumes},
      {"machines", machines},
      {"update_us",
       {{"mean", s.updates.mean_us()},
        {"p50", s.updates.quantile_us(0.5)},
        {"p99", s.updates.quantile_us(0.99)},
        {"max", s.updates.max_us()}}},
      {"wall_s",
       {{"open", s.open_s}, {"updates", s.updates.sum_us() * 1e-6}, {"total", s.total_s}}},
      {"memory_bytes", {{"soil", s.soil_bytes}, {"peak_rss", s.peak_rss_bytes}}},
      {"soil",
       {{"leaves", s.leaves}, {"active_voxels", s.active_voxels}, {"resident_m2", s.resident_m2}}},
      {"state_hash", fmt::format("{:016x}", s.state_hash)},
      {"files", s.files},
  };
  if (s.moved) json["mass_kg"] = masses;
  // Names come from the user's files and may be invalid UTF-8.
  return to_text(json, 2) + '\n';
}

UpdatesCsv::UpdatesCsv(fs::path file, bool soil_moves, bool has_force)
    : file_(std::move(file)), part_(file_), has_force_(has_force) {
  part_ += ".part";
  stream_.reset(open_for_writing(part_));
  std::string head = "time,machine,cut_m3,bucket_m3,update_us";
  if (soil_moves) head += ",bucket_kg,spilled_m3,slid_m3";
  if (has_force) head += ",force_x_n,force_y_n,force_z_n,moment_y_nm";
  if (std::fputs((head + '\n').c_str(), stream_.get()) < 0) fail_to_write(file_, errno);
}

UpdatesCsv::~UpdatesCsv() {
  if (!stream_) return;
  stream_.reset();
  std::remove(part_.c_str());
}

void UpdatesCsv::add(double time_s, std::string_view machine, double cut_m3, double bucket_m3,
                     double update_us, const std::optional<Moved>& moved,
                     const std::optional<std::array<double, 6>>& force) {
  std::string row =
      fmt::format("{},{},{},{},{:.3f}", time_s, csv_field(machine), cut_m3, bucket_m3, update_us);
  if (moved) row += fmt::format(",{},{},{}", moved->bucket_kg, moved->spilled_m3, moved->slid_m3);
  if (force)
    row += fmt::format(",{:.6g},{:.6g},{:.6g},{:.6g}", (*force)[0], (*force)[1], (*force)[2],
                       (*force)[4]);
  if (has_force_ && !force) row += ",,,,";
  row += '\n';
  if (std::fwrite(row.data(), 1, row.size(), stream_.get()) != row.size())
    fail_to_write(file_, errno);
}

void UpdatesCsv::close() {
  if (std::fflush(stream_.get()) != 0 || fsync(fileno(stream_.get())) != 0)
    fail_to_write(file_, errno);
  if (std::fclose(stream_.release()) != 0 || std::rename(part_.c_str(), file_.c_str()) != 0) {
    const int error = errno;
    std::remove(part_.c_str());
    fail_to_write(file_, error);
  }
  sync_folder(file_);
}

}  // namespace soilvdb::inline v0::io
