// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A session as a snapshot, as bytes and as another session.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "core/lattice/bytes.h"
#include "io/file/json.h"
#include "io/snapshot/snapshot_samples.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/session_state.h"

namespace soilvdb::inline v0 {
namespace {

constexpr std::string_view kMagic = "soilvdb state";
constexpr std::uint32_t kVersion = 2;

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

}  // namespace

/// Of now, but for what it takes to go on.
io::SnapshotInfo Session::State::snapshot_info() const {
  const Ledger total = tracker->total();
  io::SnapshotInfo info;
  if (const double at_s = last_s(); !std::isnan(at_s)) info.time_s = at_s;
  info.cut_m3 = total.cut_m3();
  info.captured_m3 = total.captured_m3();
  info.displaced_m3 = total.displaced_m3();
  info.dumped_m3 = total.dumped_m3();
  return info;
}

std::string Session::State::progress() const {
  std::string out;
  put_text(out, tracker->state());
  put(out, std::uint64_t{fed.size()});
  for (const Fed& machine : fed) {
    put(out, machine.time_s);
    put(out, machine.pose);
    put(out, std::uint64_t{machine.joints.size()});
    for (const double value : machine.joints) put(out, value);
  }
  return out;
}

void Session::State::set_progress(std::string_view bytes) {
  const std::string_view tracker_state = take_text(bytes);
  std::uint64_t count = 0;
  take(bytes, count);
  if (count != machines.size())
    throw std::invalid_argument(
        fmt::format("the state is of {} machines; this site has {}", count, machines.size()));
  std::vector<Fed> all(count);
  for (std::size_t i = 0; i < count; ++i) {
    take(bytes, all[i].time_s);
    take(bytes, all[i].pose);
    std::uint64_t joints = 0;
    take(bytes, joints);
    const std::optional<Chain>& chain = machines[i].chain;
    if (joints != 0 && (!chain || joints != chain->movable().size()))
      throw std::invalid_argument("the state is of a machine with other joints");
    all[i].joints.resize(joints);
    for (double& value : all[i].joints) take(bytes, value);
    if (std::isinf(all[i].time_s) || !(all[i].pose.position.hasNaN() || is_sane(all[i].pose)) ||
        !std::all_of(all[i].joints.begin(), all[i].joints.end(),
                     [](double value) { return std::isfinite(value); }))
      throw std::invalid_argument("the state has a machine that can't be");
  }
  tracker->restore(tracker_state);
  fed = std::move(all);
}

void Session::write(const std::filesystem::path& file) const {
  if (file.extension() != ".vdb")
    throw std::invalid_argument(
        fmt::format("{}: a session writes a snapshot; its name must end with .vdb", file.string()));
  io::write_snapshot(file, state_->site, state_->snapshot_info());
}

std::string Session::save() const {
  const State& s = *state_;
  if (!s.broken.empty()) throw std::runtime_error(s.broken);
  std::string rest;
  put_text(rest, io::to_cbor(s.description(/*ground=*/false)));
  put_text(rest, s.progress());
  put_text(rest, io::samples_bytes(*s.site.soil, {}));
  std::string out(kMagic);
  put(out, kVersion);
  put(out, io::crc64(rest));
  return out + rest;
}

void Session::restore(std::string_view bytes) {
  State& s = *state_;
  if (s.recorder)
    throw std::invalid_argument("a session that is recorded isn't set back; clone it");
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
  const auto site = io::from_cbor(take_text(bytes));
  if (const std::string what = difference(site, s.description(/*ground=*/false)); !what.empty())
    throw std::invalid_argument(
        fmt::format("the state is of another site, {} isn't the same", what));
  const std::string_view progress = take_text(bytes);
  State restored(s.machines, s.earthmoving, io::undug_site(s.site));
  try {
    io::restore_samples(take_text(bytes), *restored.site.soil);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {  // OpenVDB's own among them
    throw std::invalid_argument(e.what());
  }
  restored.set_progress(progress);
  // Who looks sees all change: what is here now, and what comes.
  s.note_changes();
  for (const Chunk* chunk : s.site.soil->chunks()) restored.unmeshed.insert(chunk->origin);
  restored.unmeshed.merge(s.unmeshed);
  restored.fed_count = s.fed_count + 1;
  restored.recording = s.recording;
  restored.scenario = s.scenario;
  restored.memory_bytes = s.memory_bytes;
  restored.cold_folder = s.cold_folder;
  restored.limit_memory();
  *state_ = std::move(restored);
}

Session Session::clone() const {
  const State& s = *state_;
  if (!s.broken.empty()) throw std::runtime_error(s.broken);
  if (s.memory_bytes != 0)
    throw std::runtime_error("a session whose memory is limited can't be cloned");
  return Session(std::make_unique<State>(s));
}

}  // namespace soilvdb::inline v0
