// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A session as a snapshot, as bytes and as another session.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <stdexcept>
#include <utility>

#include "core/lattice/bytes.h"
#include "io/snapshot/snapshot_samples.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/session_state.h"

namespace soilvdb::inline v0 {
namespace {

constexpr std::string_view kMagic = "soilvdb state";
constexpr std::uint32_t kVersion = 1;

void put_text(std::string& out, std::string_view text) {
  put(out, std::uint64_t{text.size()});
  out.append(text);
}

std::string_view take_text(std::string_view& in) {
  std::uint64_t size = 0;
  take(in, size);
  if (size > in.size()) throw std::invalid_argument("the state ends too early");
  const std::string_view text = in.substr(0, size);
  in.remove_prefix(size);
  return text;
}

/// What must be the same of the site that a state is of: else it would be another ground.
std::string identity(const Soil& soil, const io::BaseReference& base) {
  std::string out;
  put(out, soil.voxel_size_m());
  for (const double v : soil.origin()) put(out, v);
  put_text(out, base.checksum);
  if (const auto* plane = std::get_if<io::PlaneTerrain>(&base.terrain)) {
    put(out, plane->height_m);
    for (const double v : plane->slope) put(out, v);
  }
  return out;
}

}  // namespace

void Session::write(const std::filesystem::path& file) const {
  const State& s = *state_;
  const Ledger total = s.tracker->total();
  io::SnapshotInfo info;
  if (const double last_s = s.last_s(); !std::isnan(last_s)) info.time_s = last_s;
  info.cut_m3 = total.cut_m3();
  info.captured_m3 = total.captured_m3();
  info.displaced_m3 = total.displaced_m3();
  info.dumped_m3 = total.dumped_m3();
  io::write_snapshot(file, s.site, info);
}

std::string Session::save() const {
  const State& s = *state_;
  if (!s.broken.empty()) throw std::runtime_error(s.broken);
  std::string rest;
  put_text(rest, identity(*s.site.soil, s.site.reference));
  put_text(rest, s.tracker->state());
  put(rest, std::uint64_t{s.fed.size()});
  for (const State::Fed& fed : s.fed) {
    put(rest, fed.time_s);
    put(rest, fed.pose);
    put(rest, std::uint64_t{fed.joints.size()});
    for (const double value : fed.joints) put(rest, value);
  }
  put_text(rest, io::samples_bytes(*s.site.soil, {}));
  std::string out(kMagic);
  put(out, kVersion);
  put(out, io::crc64(rest));
  return out + rest;
}

void Session::restore(std::string_view bytes) {
  State& s = *state_;
  if (bytes.substr(0, kMagic.size()) != kMagic)
    throw std::invalid_argument("these bytes are no state; one is what save() gives");
  bytes.remove_prefix(kMagic.size());
  std::uint32_t version = 0;
  take(bytes, version);
  if (version != kVersion)
    throw std::invalid_argument(
        fmt::format("the state has version {}; this program has {}", version, kVersion));
  std::uint64_t checksum = 0;
  take(bytes, checksum);
  if (checksum != io::crc64(bytes))
    throw std::invalid_argument("the state is damaged: it has another checksum");
  if (take_text(bytes) != identity(*s.site.soil, s.site.reference))
    throw std::invalid_argument(
        "the state is of another site; voxels, origin and terrain must be the same");
  const std::string_view tracker_state = take_text(bytes);
  std::uint64_t machines = 0;
  take(bytes, machines);
  if (machines != s.machines.size())
    throw std::invalid_argument(
        fmt::format("the state is of {} machines; this site has {}", machines, s.machines.size()));
  std::vector<State::Fed> fed(machines);
  for (std::size_t i = 0; i < machines; ++i) {
    take(bytes, fed[i].time_s);
    take(bytes, fed[i].pose);
    std::uint64_t joints = 0;
    take(bytes, joints);
    const std::optional<Chain>& chain = s.machines[i].chain;
    if (joints != 0 && (!chain || joints != chain->movable().size()))
      throw std::invalid_argument("the state is of a machine with other joints");
    fed[i].joints.resize(joints);
    for (double& value : fed[i].joints) take(bytes, value);
    if (std::isinf(fed[i].time_s) || !is_sane(fed[i].pose) ||
        !std::all_of(fed[i].joints.begin(), fed[i].joints.end(),
                     [](double value) { return std::isfinite(value); }))
      throw std::invalid_argument("the state has a machine that can't be");
  }
  State restored(s.machines, s.earthmoving, io::undug_site(s.site));
  try {
    io::restore_samples(take_text(bytes), *restored.site.soil);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {  // OpenVDB's own among them
    throw std::invalid_argument(e.what());
  }
  restored.tracker->restore(tracker_state);
  // Who looks sees all change: what is here now, and what comes.
  s.note_changes();
  for (const Chunk* chunk : s.site.soil->chunks()) restored.unmeshed.insert(chunk->origin);
  restored.unmeshed.merge(s.unmeshed);
  restored.fed = std::move(fed);
  *state_ = std::move(restored);
}

Session Session::clone() const {
  const State& s = *state_;
  if (!s.broken.empty()) throw std::runtime_error(s.broken);
  return Session(std::make_unique<State>(s));
}

}  // namespace soilvdb::inline v0
