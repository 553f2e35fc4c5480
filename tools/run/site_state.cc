// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/site_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "core/lattice/bytes.h"
#include "soilvdb/pour_parts.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

std::vector<SessionMachine> machines_of(const io::Scenario& scenario) {
  std::vector<SessionMachine> machines;
  for (const io::MachineInput& machine : scenario.machines)
    machines.push_back({machine.name, machine.bucket, machine.chain});
  return machines;
}

/// Joints at a time between two rows, or those of the last row.
std::vector<double> joints_at(const io::MotionRows& rows, double time_s) {
  const auto after = std::upper_bound(rows.times_s.begin(), rows.times_s.end(), time_s);
  const auto to = static_cast<std::size_t>(
      std::min(after - rows.times_s.begin(), std::ptrdiff_t(rows.times_s.size()) - 1));
  const std::size_t from = to > 0 ? to - 1 : 0;
  const double begin_s = rows.times_s[from], end_s = rows.times_s[to];
  const double share =
      end_s > begin_s ? std::clamp((time_s - begin_s) / (end_s - begin_s), 0.0, 1.0) : 1;
  std::vector<double> joints;
  for (std::size_t k = 0; k < rows.columns; ++k) {
    const double a = rows.values[from * rows.columns + k], b = rows.values[to * rows.columns + k];
    joints.push_back(share == 1 ? b : a + share * (b - a));
  }
  return joints;
}

}  // namespace

std::runtime_error differs(const std::filesystem::path& journal, std::uint64_t update,
                           double time_s, const UpdateDiffers& why) {
  const std::string at = std::isnan(time_s) ? "" : fmt::format(", at {} s", time_text(time_s));
  return std::runtime_error(fmt::format(
      "{}: update {}{}, {}; another version of soilvdb or another machine made it, or the "
      "site isn't as it was",
      journal.string(), update, at, why.what()));
}

SiteState::SiteState(std::vector<SessionMachine> machines_, Earthmoving earthmoving_,
                     io::Site site_)
    : machines(std::move(machines_)),
      earthmoving(std::move(earthmoving_)),
      site(std::move(site_)),
      fed(machines.size()) {
  std::set<std::string> names;
  std::vector<Bucket> buckets;
  for (const SessionMachine& machine : machines) {
    if (!names.insert(machine.name).second)
      throw std::invalid_argument(
          fmt::format("machine '{}' is there twice; names must differ", machine.name));
    buckets.push_back(machine.bucket);
  }
  tracker = std::make_unique<Tracker>(*site.soil, std::move(buckets), earthmoving);
  if (earthmoving.soil) units = MassUnits(*earthmoving.soil);
}

SiteState::SiteState(const io::Scenario& scenario, io::Site site_)
    : SiteState(machines_of(scenario), {scenario.soil, scenario.pours, scenario.hoppers},
                std::move(site_)) {}

SiteState::SiteState(const SiteState& other)
    : machines(other.machines),
      earthmoving(other.earthmoving),
      site{other.site.soil->clone(), other.site.reference, other.site.crs_wkt, other.site.bounds,
           other.site.beneath},
      tracker(std::make_unique<Tracker>(*site.soil, *other.tracker)),
      units(other.units),
      fed(other.fed),
      at_rest(other.at_rest),
      poured_s(other.poured_s),
      next_pour_s_(other.next_pour_s_) {}

std::string SiteState::name(std::size_t machine) const {
  return fmt::format("machine '{}'", machines[machine].name);
}

double SiteState::last_s() const {
  double last_s = std::numeric_limits<double>::quiet_NaN();
  for (const Fed& machine : fed) last_s = std::fmax(last_s, machine.time_s);
  return last_s;
}

std::int64_t SiteState::samples(double m3) const {
  return std::llround(m3 / site.soil->sample_m3());
}

std::int64_t SiteState::mass(double loose_m3) const {
  return std::llround(loose_m3 / site.soil->sample_m3() * static_cast<double>(units.loose));
}

double SiteState::volume_m3(std::int64_t samples) const {
  return static_cast<double>(samples) * site.soil->sample_m3();
}

double SiteState::loose_m3(std::int64_t mass) const {
  return units.loose_samples(mass) * site.soil->sample_m3();
}

double SiteState::kg(std::int64_t mass) const {
  return units.kg(mass, site.soil->sample_m3(), *earthmoving.soil);
}

void SiteState::pour(double until_s) {
  if (until_s >= next_pour_s_) {
    std::vector<double> times_s;
    next_pour_s_ = kNever;
    for (const Pour& pour : earthmoving.pours) {
      const PourParts parts(pour, site.soil->voxel_size_m());
      for (std::int64_t part = 1; part <= parts.count(); ++part) {
        const double falls_s = parts.falls_s(part);
        if (falls_s > until_s) next_pour_s_ = std::min(next_pour_s_, falls_s);
        if (falls_s > poured_s && falls_s <= until_s) times_s.push_back(falls_s);
      }
    }
    std::sort(times_s.begin(), times_s.end());
    times_s.erase(std::unique(times_s.begin(), times_s.end()), times_s.end());
    for (const double time_s : times_s)
      for (std::size_t i = 0; i < earthmoving.pours.size(); ++i) tracker->pour(i, time_s);
  }
  poured_s = std::max(poured_s, until_s);
}

void SiteState::pour_before(double time_s) {
  if (!earthmoving.pours.empty() && !std::isnan(time_s)) pour(std::nextafter(time_s, -kNever));
}

/// @throw std::invalid_argument if it can't be
Pose SiteState::row_pose(std::size_t machine, const io::MotionRows& rows, std::size_t row) const {
  const std::span<const double> v(rows.values.data() + row * rows.columns, rows.columns);
  if (!rows.joints) {
    if (v.size() != 7) throw std::invalid_argument("a pose has seven numbers");
    return {{v[0], v[1], v[2]}, Eigen::Quaterniond(v[6], v[3], v[4], v[5])};
  }
  const std::optional<Chain>& chain = machines[machine].chain;
  if (!chain || chain->movable().size() != v.size())
    throw std::invalid_argument(fmt::format("{} has no {} joints", name(machine), v.size()));
  return chain->world_from_bucket(v);
}

void SiteState::follow(const io::JournalUpdate& update) {
  using Kind = io::JournalUpdate::Kind;
  if (update.kind == Kind::kClock) fed[update.machine].time_s = std::nan("");
  if (update.kind != Kind::kMove) return;
  const io::MotionRows& rows = update.rows;
  Fed& now = fed[update.machine];
  const std::size_t last = rows.times_s.size() - 1;
  const bool to_last = !(rows.times_s[last] > update.end_s);
  now.pose = to_last ? row_pose(update.machine, rows, last)
                     : io::motion_of(rows, machines[update.machine].chain.value_or(Chain()))
                           .pose(update.end_s);
  now.joints.clear();
  if (rows.joints) now.joints = joints_at(rows, to_last ? rows.times_s[last] : update.end_s);
  if (std::isfinite(update.end_s)) now.time_s = update.end_s;
}

/// @param motions keeps those that moves are along
Move SiteState::move_of(const io::JournalUpdate& update,
                        std::vector<std::unique_ptr<Motion>>& motions) const {
  const io::MotionRows& rows = update.rows;
  Move move;
  move.machine = update.machine;
  if (rows.times_s.front() <= update.begin_s) {
    motions.push_back(std::make_unique<Motion>(
        io::motion_of(rows, machines[update.machine].chain.value_or(Chain()))));
  } else {
    move.to = row_pose(update.machine, rows, rows.times_s.size() - 1);
    if (std::isnan(update.begin_s)) return move;
    const std::vector<Pose> ends = {fed[update.machine].pose, move.to};
    motions.push_back(
        std::make_unique<Motion>(std::vector<double>{update.begin_s, update.end_s}, ends));
  }
  move.motion = motions.back().get();
  move.begin_s = update.begin_s;
  move.end_s = update.end_s;
  return move;
}

void SiteState::require_mover(std::size_t i, const io::JournalUpdate& update) const {
  const bool pours = update.kind == io::JournalUpdate::Kind::kPour;
  const std::size_t first = pours ? machines.size() : 0;
  const std::size_t count = pours ? earthmoving.pours.size() : machines.size();
  if (update.machine < first || update.machine - first >= count)
    throw UpdateDiffers(i, "is of a machine or a pour that isn't there");
}

void SiteState::require_same(std::size_t i, const io::JournalUpdate& update,
                             const Update& made) const {
  if (samples(made.cut_m3) != update.cut_samples)
    throw UpdateDiffers(
        i, fmt::format("cut {} m³ and now cuts {} m³", volume_m3(update.cut_samples), made.cut_m3));
  if (mass(made.bucket_m3) != update.bucket_samples)
    throw UpdateDiffers(i, fmt::format("left a load of {} m³ and now leaves {} m³",
                                       loose_m3(update.bucket_samples), made.bucket_m3));
  if (mass(made.spilled_m3) != update.spilled || mass(made.slid_m3) != update.slid)
    throw UpdateDiffers(i, "had soil come down otherwise");
}

void SiteState::redo(std::span<const io::JournalUpdate> updates) {
  using Kind = io::JournalUpdate::Kind;
  for (std::size_t i = 0; i < updates.size();) {
    const io::JournalUpdate& first = updates[i];
    if (first.kind != Kind::kPours && first.kind != Kind::kRest) require_mover(i, first);
    std::size_t end = i + 1;
    try {
      switch (first.kind) {
        case Kind::kMove: {
          std::vector<std::unique_ptr<Motion>> motions;
          std::vector<Move> moves;
          for (end = i; end < updates.size() && updates[end].kind == Kind::kMove &&
                        (end == i || earthmoving.pours.empty());
               ++end) {
            require_mover(end, updates[end]);
            moves.push_back(move_of(updates[end], motions));
            follow(updates[end]);
          }
          pour_before(first.end_s);
          const std::vector<Update> made = tracker->update(moves);
          for (std::size_t k = i; k < end; ++k) require_same(k, updates[k], made[k - i]);
          break;
        }
        case Kind::kPour:
          require_same(i, first, tracker->pour(first.machine - machines.size(), first.end_s));
          break;
        case Kind::kPours:
          pour(first.end_s);
          break;
        case Kind::kRest:
          tracker->come_to_rest(first.end_s);
          break;
        case Kind::kClock:
          follow(first);
      }
    } catch (const UpdateDiffers&) {
      throw;
    } catch (const std::exception& e) {
      throw UpdateDiffers(i, fmt::format("can't be made any more: {}", e.what()));
    }
    i = end;
  }
}

std::string SiteState::progress() const {
  std::string out;
  put_text(out, tracker->state());
  put(out, at_rest);
  put(out, std::uint64_t{fed.size()});
  for (const Fed& machine : fed) {
    put(out, machine.time_s);
    put(out, machine.pose);
    put(out, std::uint64_t{machine.joints.size()});
    for (const double value : machine.joints) put(out, value);
  }
  return out;
}

void SiteState::set_progress(std::string_view bytes) {
  const std::string_view tracker_state = take_text(bytes);
  bool rests = false;
  std::uint64_t count = 0;
  take(bytes, rests);
  take(bytes, count);
  if (count != machines.size())
    throw std::invalid_argument(
        fmt::format("the state is of {} machines; this site has {}", count, machines.size()));
  std::vector<Fed> all;
  for (const SessionMachine& machine : machines) {
    Fed& now = all.emplace_back();
    take(bytes, now.time_s);
    take(bytes, now.pose);
    std::uint64_t joints = 0;
    take(bytes, joints);
    if (joints != 0 && (!machine.chain || joints != machine.chain->movable().size()))
      throw std::invalid_argument("the state is of a machine with other joints");
    now.joints.resize(joints);
    for (double& value : now.joints) take(bytes, value);
    if (std::isinf(now.time_s) || !(now.pose.position.hasNaN() || is_sane(now.pose)) ||
        !std::all_of(now.joints.begin(), now.joints.end(),
                     [](double value) { return std::isfinite(value); }))
      throw std::invalid_argument("the state has a machine that can't be");
  }
  tracker->restore(tracker_state);
  fed = std::move(all);
  at_rest = rests;
}

io::SnapshotInfo SiteState::snapshot_info(double time_s) const {
  const Ledger total = tracker->total();
  io::SnapshotInfo info;
  info.time_s = time_s;
  info.cut_m3 = total.cut_m3();
  info.captured_m3 = total.captured_m3();
  info.displaced_m3 = total.displaced_m3();
  info.dumped_m3 = total.dumped_m3();
  info.tracker_state = progress();
  return info;
}

}  // namespace soilvdb::tools
