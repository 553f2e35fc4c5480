// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/books.h"

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

/// Of soil that moves; counts in samples and units of mass, which are exact.
void put_moved(const Books& books, io::Summary& summary) {
  const SiteLedger& site = books.site;
  const MassUnits units(*books.properties);
  const double sample_m3 = books.soil.sample_m3();
  const auto loose_m3 = [&](std::int64_t mass) { return units.loose_samples(mass) * sample_m3; };
  const auto kg = [&](std::int64_t mass) { return units.kg(mass, sample_m3, *books.properties); };
  const std::int64_t ground = site.ground - books.mass_before;
  const std::int64_t residual =
      ground + books.total.load + site.in_flight + site.hauled - site.poured;
  const std::int64_t expected = site.fill_samples - site.gone_samples - books.total.cut();
  const std::int64_t samples = std::llround(summary.ground_change_m3 / sample_m3);
  summary.residual_m3 = static_cast<double>(samples - expected) * sample_m3;
  io::Summary::Moved& moved = summary.moved.emplace(io::Summary::Moved{});
  moved.spilled_m3 = loose_m3(books.total.spilled);
  moved.poured_m3 = loose_m3(site.poured);
  moved.hauled_m3 = loose_m3(site.hauled);
  moved.slid_m3 = loose_m3(site.slid);
  moved.fill_m3 = static_cast<double>(site.fill_samples) * sample_m3;
  moved.ground_change_kg = kg(ground);
  moved.buckets_kg = kg(books.total.load);
  moved.hauled_kg = kg(site.hauled);
  moved.poured_kg = kg(site.poured);
  moved.in_flight_kg = kg(site.in_flight);
  moved.residual_kg = kg(residual);
  for (std::size_t i = 0; i < books.machines.size(); ++i) {
    summary.machines[i].bucket_kg = kg(books.machines[i].ledger.load);
    summary.machines[i].capacity = Capacity::of(books.machines[i].bucket);
  }
}

}  // namespace

void put_books(const Books& books, io::Summary& summary) {
  const Soil& soil = books.soil;
  summary.voxel_size_m = soil.voxel_size_m();
  summary.cut_m3 = books.total.cut_m3();
  summary.captured_m3 = books.total.captured_m3();
  summary.displaced_m3 = books.total.displaced_m3();
  summary.dumped_m3 = books.total.dumped_m3();
  summary.ground_change_m3 = soil.change_m3() - books.change_before_m3;
  summary.residual_m3 = summary.ground_change_m3 + summary.cut_m3;
  summary.net.reset();
  if (books.change_before_m3 == 0) {
    const io::CutAndFill net = io::cut_and_fill(soil);
    summary.net = {net.cut_m3, net.fill_m3};
  }
  summary.machines.clear();
  for (const Books::Machine& machine : books.machines)
    summary.machines.push_back(
        {machine.name, machine.ledger.bucket_m3(), machine.ledger.cut_m3(), machine.bad_rows});
  if (books.properties) put_moved(books, summary);
  summary.leaves = soil.chunks().size();
  summary.active_voxels = soil.active_voxels();
  summary.resident_m2 = soil.resident_m2();
  summary.soil_bytes = soil.memory_bytes();
  summary.state_hash = soil.state_hash();
  summary.peak_rss_bytes = peak_rss_bytes();
}

}  // namespace soilvdb::tools
