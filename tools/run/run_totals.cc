// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run_totals.h"

#include <sys/resource.h>

#include <cmath>

#include "soilvdb/capacity.h"
#include "soilvdb/io/picture.h"

namespace soilvdb::tools {
namespace {

std::uint64_t peak_rss_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

/// Adds the totals of moving soil, from exact integers (samples and mass units).
void put_moved(const RunTotals& totals, io::Summary& summary) {
  const MassBalance& balance = totals.balance;
  const MassUnits units(*totals.properties);
  const double sample_m3 = totals.ground.sample_m3();
  const auto loose_m3 = [&](std::int64_t mass) { return units.loose_samples(mass) * sample_m3; };
  const auto kg = [&](std::int64_t mass) { return units.kg(mass, sample_m3, *totals.properties); };
  const std::int64_t ground = balance.ground - totals.mass_before;
  const std::int64_t residual = ground + totals.total.load + balance.pending + balance.hauled -
                                balance.poured - balance.surveyed;
  const Surveyed surveyed = totals.surveyed.value_or(Surveyed());
  const std::int64_t expected = balance.fill_samples - balance.failed_samples - totals.total.cut() +
                                surveyed.added - surveyed.removed;
  const std::int64_t samples = std::llround(summary.ground_change_m3 / sample_m3);
  summary.residual_m3 = static_cast<double>(samples - expected) * sample_m3;
  io::Summary::Moved& moved = summary.moved.emplace(io::Summary::Moved{});
  moved.spilled_m3 = loose_m3(totals.total.spilled);
  moved.poured_m3 = loose_m3(balance.poured);
  moved.hauled_m3 = loose_m3(balance.hauled);
  moved.slid_m3 = loose_m3(balance.slid);
  moved.fill_m3 = static_cast<double>(balance.fill_samples) * sample_m3;
  moved.ground_change_kg = kg(ground);
  moved.buckets_kg = kg(totals.total.load);
  moved.hauled_kg = kg(balance.hauled);
  moved.poured_kg = kg(balance.poured);
  moved.pending_kg = kg(balance.pending);
  if (totals.surveyed) moved.surveyed_kg = kg(balance.surveyed);
  moved.residual_kg = kg(residual);
  for (std::size_t i = 0; i < totals.machines.size(); ++i) {
    summary.machines[i].bucket_kg = kg(totals.machines[i].ledger.load);
    summary.machines[i].capacity = Capacity::of(totals.machines[i].bucket);
  }
}

}  // namespace

void put_totals(const RunTotals& totals, io::Summary& summary) {
  const Ground& ground = totals.ground;
  summary.voxel_size_m = ground.voxel_size_m();
  summary.cut_m3 = totals.total.cut_m3();
  summary.captured_m3 = totals.total.captured_m3();
  summary.displaced_m3 = totals.total.displaced_m3();
  summary.dumped_m3 = totals.total.dumped_m3();
  summary.ground_change_m3 = ground.change_m3() - totals.change_before_m3;
  summary.residual_m3 = summary.ground_change_m3 + summary.cut_m3;
  if (const auto& surveyed = totals.surveyed) {
    summary.surveyed = {static_cast<double>(surveyed->removed) * ground.sample_m3(),
                        static_cast<double>(surveyed->added) * ground.sample_m3()};
    summary.residual_m3 += summary.surveyed->removed_m3 - summary.surveyed->added_m3;
  }
  summary.net.reset();
  if (totals.change_before_m3 == 0) {
    const io::CutAndFill net = io::cut_and_fill(ground);
    summary.net = {net.cut_m3, net.fill_m3};
  }
  summary.machines.clear();
  for (const RunTotals::Machine& machine : totals.machines)
    summary.machines.push_back(
        {machine.name, machine.ledger.bucket_m3(), machine.ledger.cut_m3(), machine.bad_rows});
  for (std::size_t i = 0; i < totals.machines.size(); ++i)
    summary.machines[i].lip_error_m = totals.machines[i].lip_error_m;
  if (totals.properties) put_moved(totals, summary);
  summary.leaves = ground.chunks().size();
  summary.active_voxels = ground.active_voxels();
  summary.resident_m2 = ground.resident_m2();
  summary.soil_bytes = ground.memory_bytes();
  summary.state_hash = ground.state_hash();
  summary.peak_rss_bytes = peak_rss_bytes();
}

}  // namespace soilvdb::tools
