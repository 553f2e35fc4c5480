// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/site_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "soilvdb/io/point_cloud.h"
#include "tools/run/ros_messages.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

/// Way through soil after which a bucket without any is held the wrong way round.
constexpr double kBackwards_m = 2;

std::optional<double> time_of(const io::JournalUpdate& update) {
  return std::isnan(update.end_s) ? std::nullopt : std::optional(update.end_s);
}

}  // namespace

SiteModel model_of(const io::Scenario& scenario) {
  SiteModel model{{}, {scenario.soil, scenario.pours, scenario.hoppers}};
  for (const io::MachineInput& machine : scenario.machines)
    model.machines.push_back(
        {machine.name, machine.bucket, machine.chain, machine.lip_sigma_m, machine.gnss});
  return model;
}

std::string voxel_doubt(const std::string& machine, const Bucket& bucket, double voxel_size_m) {
  const auto [least_m, most_m] = std::minmax(bucket.width_m, bucket.height_m);
  if (voxel_size_m <= least_m / 2) return "";
  const bool hides = voxel_size_m > 2 * most_m;
  return fmt::format("voxels of {} m are {} the bucket of {}, {} m x {} m{} {} m or less",
                     length_text(voxel_size_m), hides ? "larger than" : "too large for", machine,
                     length_text(bucket.width_m), length_text(bucket.height_m),
                     hides ? ", and would show nothing of what it digs; the voxel size must be"
                           : "; volumes will be off by percents or more, use",
                     length_text(least_m / 5));
}

std::runtime_error differs(const std::filesystem::path& journal, std::uint64_t update,
                           double time_s, const UpdateDiffers& why) {
  const std::string at = std::isnan(time_s) ? "" : fmt::format(", at {} s", time_text(time_s));
  return std::runtime_error(fmt::format(
      "{}: update {}{}, {}; another version of soilvdb or another machine made it, or the "
      "site isn't as it was",
      journal.string(), update, at, why.what()));
}

SiteState::SiteState(SiteModel model, io::Site opened)
    : Site(opened.ground, std::move(model)),
      site(std::move(opened)),
      backwards(model_->machines.size()) {
  if (const auto& soil = model_->earthmoving.soil) units = MassUnits(*soil);
}

SiteState::SiteState(const SiteState& other)
    : Site(other),
      site{ground_, other.site.reference, other.site.crs_wkt, other.site.bounds,
           other.site.beneath},
      units(other.units),
      backwards(other.backwards) {}

std::int64_t SiteState::samples(double m3) const {
  return std::llround(m3 / site.ground->sample_m3());
}

std::int64_t SiteState::mass(double loose_m3) const {
  return std::llround(loose_m3 / site.ground->sample_m3() * static_cast<double>(units.loose));
}

double SiteState::volume_m3(std::int64_t samples) const {
  return static_cast<double>(samples) * site.ground->sample_m3();
}

double SiteState::loose_m3(std::int64_t mass) const {
  return units.loose_samples(mass) * site.ground->sample_m3();
}

double SiteState::kg(std::int64_t mass) const {
  return units.kg(mass, site.ground->sample_m3(), *model_->earthmoving.soil);
}

/// @throw std::invalid_argument for an impossible pose
Pose SiteState::row_pose(std::size_t machine, const io::MotionRows& rows, std::size_t row) const {
  const std::span<const double> v(rows.values.data() + row * rows.columns, rows.columns);
  if (!rows.joints) {
    if (v.size() != 7) throw std::invalid_argument("a pose has seven numbers");
    return pose_of(v.data());
  }
  const std::optional<Chain>& chain = model_->machines[machine].chain;
  if (!chain || !chain->takes(v.size()))
    throw std::invalid_argument(fmt::format("{} has no {} joints", name(machine), v.size()));
  return chain->world_from_bucket(v);
}

std::string SiteState::look_backwards(std::size_t machine, const Pose& from, const Pose& to,
                                      bool caught, bool displaced) {
  Backwards& so_far = backwards[machine];
  const SiteMachine& of = model_->machines[machine];
  if (so_far.warned || of.bucket.shape) return "";
  if (caught) so_far.way_m = 0;
  if (caught || !displaced) return "";
  so_far.way_m -= std::min(0.0, (to.position - from.position).dot(from.rotation * Vec3::UnitX()));
  if (so_far.way_m < kBackwards_m) return "";
  so_far.warned = true;
  return fmt::format(
      "machine '{}' moved backwards through soil for {} m and caught none: the x axis of its "
      "bucket must point out of the mouth, in the digging direction",
      of.name, kBackwards_m);
}

void SiteState::follow(const io::JournalUpdate& update) {
  using Kind = io::JournalUpdate::Kind;
  if (!update.has_rows() && update.kind != Kind::kClock) return;
  std::optional<Input>& input = inputs_[update.machine];
  if (update.kind == Kind::kClock) {
    if (input) input->time_s.reset();
    return;
  }
  const io::MotionRows& rows = update.rows;
  Input now{input ? input->time_s : std::nullopt};
  const std::size_t last = rows.times_s.size() - 1;
  const bool to_last = !(rows.times_s[last] > update.end_s);
  if (to_last) {
    now.pose = row_pose(update.machine, rows, last);
    if (rows.joints)
      now.configuration.assign(rows.values.end() - static_cast<std::ptrdiff_t>(rows.columns),
                               rows.values.end());
  } else {
    const Motion motion =
        io::motion_of(rows, model_->machines[update.machine].chain.value_or(Chain()));
    now.pose = motion.pose(update.end_s);
    now.configuration = motion.joint_values(update.end_s);
  }
  if (std::isfinite(update.end_s)) now.time_s = update.end_s;
  set_direction(now, update.kind == Kind::kMove ? input : std::nullopt);
  input = std::move(now);
}

/// @param motions keeps the motions of the moves alive
Move SiteState::move_of(const io::JournalUpdate& update,
                        std::vector<std::unique_ptr<Motion>>& motions) const {
  const io::MotionRows& rows = update.rows;
  Move move;
  move.machine = update.machine;
  if (rows.times_s.front() <= update.begin_s) {
    motions.push_back(std::make_unique<Motion>(
        io::motion_of(rows, model_->machines[update.machine].chain.value_or(Chain()))));
  } else {
    move.to = row_pose(update.machine, rows, rows.times_s.size() - 1);
    if (std::isnan(update.begin_s)) return move;
    if (!inputs_[update.machine]) throw std::invalid_argument("its machine has no earlier place");
    const std::vector<Pose> ends = {inputs_[update.machine]->pose, move.to};
    motions.push_back(
        std::make_unique<Motion>(std::vector<double>{update.begin_s, update.end_s}, ends));
  }
  move.motion = motions.back().get();
  move.begin_s = update.begin_s;
  move.end_s = update.end_s;
  return move;
}

std::vector<io::JournalUpdate> SiteState::advance(std::span<const Step> steps) {
  std::vector<io::JournalUpdate> made;
  std::vector<std::int64_t> loads;  // before each update, by machine
  for (std::size_t i = 0; i < model_->machines.size(); ++i)
    loads.push_back(tracker_->ledger(i).load);
  const auto record = [&](const Step& step, const Update& update) {
    made.push_back(
        {.machine = static_cast<std::uint32_t>(step.machine),
         .ends_update = step.ends_update,
         .begin_s = step.begin_s,
         .end_s = step.end_s,
         .cut_samples = samples(update.cut_m3),
         .bucket_samples = mass(update.bucket_m3),
         .ns = std::llround(1e3 * update.us),
         .rows = step.motion ? io::rows_between(*step.motion, step.begin_s, step.end_s)
                             : io::MotionRows(),
         .spilled = mass(update.spilled_m3),
         .slid = mass(update.slid_m3),
         .kind = step.motion ? io::JournalUpdate::Kind::kMove : io::JournalUpdate::Kind::kPour});
    const std::optional<Input> before = step.motion ? inputs_[step.machine] : std::nullopt;
    follow(made.back());
    if (before) {
      const std::int64_t load = std::exchange(loads[step.machine], made.back().bucket_samples);
      const bool caught = made.back().bucket_samples + made.back().spilled > load;
      const std::string warning =
          look_backwards(step.machine, before->pose, inputs_[step.machine]->pose, caught,
                         !caught && made.back().cut_samples > 0);
      if (!warning.empty())
        warnings.push_back(fmt::format("at {} s {}", time_text(step.end_s), warning));
    }
    if (!records_force || !step.motion || model_->machines[step.machine].bucket.shape) return;
    if (!heights_) heights_.emplace(*site.ground);
    cut_geometry(step.machine, *heights_, cut_);
    made.back().force =
        tools::wrench_numbers(cut_.resistance(SoilStrength::of(*model_->earthmoving.soil)).total());
  };
  const std::size_t first_scan = model_->machines.size() + model_->earthmoving.pours.size();
  for (std::size_t i = 0; i < steps.size();) {
    if (steps[i].machine >= first_scan) {
      made.push_back(take_scan(steps[i++]));
      continue;
    }
    if (!steps[i].motion) {
      record(steps[i], tracker_->pour(steps[i].machine - model_->machines.size(), steps[i].end_s));
      tell_survey();
      ++i;
      continue;
    }
    std::vector<Move> moves;  // up to the next pour; a force is that of its own ground
    const std::size_t end = records_force ? i + 1 : steps.size();
    for (std::size_t k = i; k < end && steps[k].machine < first_scan && steps[k].motion; ++k)
      moves.push_back(
          {steps[k].machine, {}, steps[k].motion.get(), steps[k].begin_s, steps[k].end_s});
    for (const Update& update : make(moves)) record(steps[i++], update);
  }
  return made;
}

/// Corrects the ground by the scan of a step.
io::JournalUpdate SiteState::take_scan(const Step& step) {
  const auto begin = std::chrono::steady_clock::now();
  const std::size_t first = model_->machines.size() + model_->earthmoving.pours.size();
  const io::ScanInput& scan = scans[step.machine - first];
  const std::string where = fmt::format("{}: scan at {} s", scan.file.string(), step.end_s);
  const auto [sensor, points_m] = scan.read(step.motion.get());
  Survey survey;
  std::string record;
  StepResult made = Site::scan(sensor, points_m);
  if (made.ok()) made = apply_scans(survey, &record);
  if (!made.ok()) throw std::runtime_error(fmt::format("{}: {}", where, made.why));
  if (const std::string why = survey.rays.doubt(); !why.empty() && doubtful_scans++ == 0)
    doubt = fmt::format("{}: {}", where, why);
  return {.machine = static_cast<std::uint32_t>(step.machine),
          .begin_s = step.begin_s,
          .end_s = step.end_s,
          .ns = std::chrono::nanoseconds(std::chrono::steady_clock::now() - begin).count(),
          .kind = io::JournalUpdate::Kind::kSurvey,
          .survey = io::pack_survey(record)};
}

void SiteState::require_mover(std::size_t i, const io::JournalUpdate& update) const {
  const bool pours = update.kind == io::JournalUpdate::Kind::kPour;
  const std::size_t first = pours ? model_->machines.size() : 0;
  const std::size_t count = pours ? model_->earthmoving.pours.size() : model_->machines.size();
  if (update.machine < first || update.machine - first >= count)
    throw UpdateDiffers(i, "is of an unknown machine or pour");
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
    throw UpdateDiffers(i, "spilled or slid another volume");
}

std::vector<Update> SiteState::repeat(std::span<const io::JournalUpdate> updates, std::size_t i,
                                      std::size_t& end) {
  using Kind = io::JournalUpdate::Kind;
  const io::JournalUpdate& first = updates[i];
  std::vector<Update> made;
  end = i + 1;
  switch (first.kind) {
    case Kind::kMove: {
      std::vector<std::unique_ptr<Motion>> motions;
      std::vector<Move> moves;
      pour_before(time_of(first));
      for (end = i; end < updates.size() && updates[end].kind == Kind::kMove &&
                    (end == i || !pours_before(time_of(updates[end])));
           ++end) {
        require_mover(end, updates[end]);
        moves.push_back(move_of(updates[end], motions));
        follow(updates[end]);
      }
      made = make(moves);
      break;
    }
    case Kind::kPour:
      made = {tracker_->pour(first.machine - model_->machines.size(), first.end_s)};
      tell_survey();
      break;
    case Kind::kPours:
      pour_until(first.end_s);
      break;
    case Kind::kRest:
      tracker_->come_to_rest(time_of(first));
      tell_survey();
      break;
    case Kind::kPlace:
      pour_before(time_of(first));
      made = {
          tracker_->place(first.machine, row_pose(first.machine, first.rows, 0), time_of(first))};
      tell_survey();
      follow(first);
      break;
    case Kind::kClock:
      follow(first);
      break;
    case Kind::kSurvey:
      repeat_survey(io::unpack_survey(first.survey));
  }
  return made;
}

void SiteState::redo(std::span<const io::JournalUpdate> updates) {
  using Kind = io::JournalUpdate::Kind;
  for (std::size_t i = 0, end = 0; i < updates.size(); i = end) {
    const Kind kind = updates[i].kind;
    if (kind != Kind::kPours && kind != Kind::kRest && kind != Kind::kSurvey)
      require_mover(i, updates[i]);
    try {
      const std::vector<Update> made = repeat(updates, i, end);
      for (std::size_t k = 0; k < made.size(); ++k) require_same(i + k, updates[i + k], made[k]);
    } catch (const UpdateDiffers&) {
      throw;
    } catch (const std::exception& e) {
      throw UpdateDiffers(i, fmt::format("can't be made any more: {}", e.what()));
    }
  }
}

std::optional<io::JournalUpdate> SiteState::make_anew(io::JournalUpdate update) {
  if (update.kind == io::JournalUpdate::Kind::kPlace &&
      !tracker_->misplaced(update.machine, row_pose(update.machine, update.rows, 0)).empty())
    return {};
  const auto so_far = [&] { return tracker_->mass_balance_without_ground().hauled; };
  const std::int64_t before = so_far();
  std::size_t end = 0;
  const std::vector<Update> made = repeat(std::span(&update, 1), 0, end);
  if (made.empty()) return update;
  const std::int64_t hauled = so_far() - before;
  update.cut_samples = samples(made[0].cut_m3);
  update.bucket_samples = mass(made[0].bucket_m3);
  update.spilled = mass(made[0].spilled_m3);
  update.slid = mass(made[0].slid_m3);
  update.ns = std::llround(1e3 * made[0].us);
  update.hauled.reset();
  if (!model_->earthmoving.hoppers.empty() && (made[0].spilled_m3 != 0 || hauled != 0))
    update.hauled = hauled;
  return update;
}

void SiteState::rest_at_end(double time_s) {
  if (!model_->earthmoving.soil || at_rest_) return;
  tracker_->come_to_rest(time_s);
  tell_survey();
  at_rest_ = true;
}

io::SnapshotInfo SiteState::snapshot_info(double time_s) const {
  const Ledger total = tracker_->total();
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
