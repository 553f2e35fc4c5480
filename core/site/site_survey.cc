// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What scans and surveys correct of a site, and what they know of it.
#include <cmath>
#include <stdexcept>
#include <utility>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/site/guarded.h"
#include "soilvdb/site.h"

namespace soilvdb::inline v0 {
namespace {

template <typename Volumes>
void set_volumes(Volumes& volumes, const Surveyed& before, const Surveyed& now, double sample_m3) {
  volumes.removed_m3 = static_cast<double>(now.removed - before.removed) * sample_m3;
  volumes.added_m3 = static_cast<double>(now.added - before.added) * sample_m3;
}

}  // namespace

std::unique_ptr<GroundScans> Site::new_survey() const {
  std::vector<Bucket> buckets;
  std::vector<double> lip_sigmas_m;
  for (const SiteMachine& machine : model_->machines) {
    buckets.push_back(machine.bucket);
    lip_sigmas_m.push_back(machine.lip_sigma_m);
  }
  return std::make_unique<GroundScans>(*ground_, std::move(buckets), lip_sigmas_m, surveyed_);
}

GroundScans& Site::scans() {
  if (!survey_) survey_ = new_survey();
  return *survey_;
}

void Site::tell_survey(std::optional<std::size_t> machine, GroundScans::Work how) {
  if (survey_) survey_->worked(machine, how);
}

StepResult Site::scan(const Sensor& sensor, std::span<const Vec3> points_m) noexcept {
  return guarded<StepResult>([&](bool&) {
    std::vector<const Pose*> poses;
    std::vector<PlacedBoxes> links;
    for (std::size_t m = 0; m < inputs_.size(); ++m) {
      const std::optional<Input>& input = inputs_[m];
      poses.push_back(input ? &input->pose : nullptr);
      if (!input || input->configuration.empty()) continue;
      for (PlacedBoxes& body : chain(m).placed_bodies(input->configuration)) links.push_back(body);
    }
    auto begun = survey_ ? nullptr : new_survey();  // a scan that is refused begins none
    (begun ? *begun : *survey_).scan(sensor, points_m, poses, links);
    if (begun) survey_ = std::move(begun);
    return StepResult();
  });
}

StepResult Site::apply_scans(Survey& survey, std::string* record) noexcept {
  return guarded<StepResult>([&](bool& moving) {
    survey = {};
    if (!survey_) {
      survey.lip_errors_m = new_survey()->lip_errors_m();
      return StepResult();
    }
    const Surveyed before = tracker_->surveyed();
    const bool is_news = survey_->has_news();
    const std::vector<ScanChange> changes = survey_->solve();
    moving = true;
    tracker_->correct(changes);
    survey = survey_->applied();
    set_volumes(survey, before, tracker_->surveyed(), ground_->sample_m3());
    if (record != nullptr && is_news) {
      put(*record, /*of_scans=*/true, std::uint64_t{changes.size()});
      for (const ScanChange& change : changes)
        put(*record, change.cell, change.top, change.samples, change.slope);
      survey_->save_changes(*record);
    }
    return StepResult();
  });
}

StepResult Site::survey(const SurveyHeights& heights, SurveyVolumes& volumes,
                        std::string* record) noexcept {
  return guarded<StepResult>([&](bool& moving) {
    volumes = {};
    heights.validate();
    const Surveyed before = tracker_->surveyed();
    moving = true;
    volumes.changed = take_survey(heights);
    set_volumes(volumes, before, tracker_->surveyed(), ground_->sample_m3());
    if (record != nullptr) {
      put(*record, /*of_scans=*/false);
      heights.save(*record);
    }
    return StepResult();
  });
}

std::int64_t Site::take_survey(const SurveyHeights& heights) {
  const std::int64_t changed = tracker_->survey(heights);
  surveyed_->add(heights);
  tell_survey({}, GroundScans::Work::kSurvey);
  return changed;
}

bool Site::is_of_scans(std::string_view record) { return record.empty() || record.front() != 0; }

void Site::repeat_survey(std::string_view record) {
  if (record.empty()) return;  // of scans without a ray that counts
  bool of_scans = false;
  take(record, of_scans);
  if (!of_scans) {
    const auto heights = SurveyHeights::load(record);
    if (!record.empty())
      throw std::invalid_argument("the record of a survey has more than it says");
    take_survey(heights);
    return;
  }
  std::uint64_t count = 0;
  take(record, count);
  std::vector<ScanChange> changes;
  for (std::uint64_t i = 0; i < count; ++i) {
    ScanChange& change = changes.emplace_back();
    take(record, change.cell, change.top, change.samples, change.slope);
    if (!(change.cell.cast<double>().cwiseAbs().maxCoeff() < kMaxIndex &&
          std::abs(change.top) < kMaxIndex &&
          std::abs(change.top + static_cast<double>(change.samples) / 64) < kMaxIndex &&
          change.slope.allFinite()))
      throw std::invalid_argument("the record of scans has an impossible column");
  }
  tracker_->correct(changes);
  scans().load(record);
  if (!record.empty()) throw std::invalid_argument("the record of scans is of another site");
}

std::vector<Estimate> Site::lip_errors_m() const {
  return survey_ ? survey_->lip_errors_m() : std::vector<Estimate>();
}

// Looking must not begin a survey: what it then knows of who digs would depend on who looks.
void Site::sigmas(std::span<const Vec2> xy_m, std::span<double> sigmas_m, std::span<double> seen) {
  const auto none_yet = survey_ ? nullptr : new_survey();
  (survey_ ? *survey_ : *none_yet).sigmas(xy_m, sigmas_m, seen);
}

std::vector<Coord2> Site::seen_squares() const {
  return survey_ ? survey_->seen_squares() : new_survey()->seen_squares();
}

double Site::volume_sigma_m3(const std::vector<Vec2>& boundary) {
  const auto none_yet = survey_ ? nullptr : new_survey();
  return (survey_ ? *survey_ : *none_yet).volume_sigma_m3(boundary);
}

std::vector<Estimate> Site::cut_errors_m3(GroundScans& of) const {
  std::vector<double> cut_m3;
  if (model_->earthmoving.soil)
    for (std::size_t m = 0; m < model_->machines.size(); ++m)
      cut_m3.push_back(tracker_->ledger(m).cut_m3());
  return of.cut_errors_m3(tracker_->surveyed_samples(), cut_m3);
}

Estimate Site::cut_m3(std::size_t machine) {
  require(machine);
  const auto none_yet = survey_ ? nullptr : new_survey();
  const std::vector<Estimate> errors = cut_errors_m3(survey_ ? *survey_ : *none_yet);
  if (errors.back().sigma > 0)
    throw std::invalid_argument(
        "it is not known which machine dug what before the first scan; make an empty scan before "
        "several machines dig");
  const Estimate& error = errors[machine];
  return {tracker_->ledger(machine).cut_m3() + error.mean, error.sigma};
}

Heap Site::heap(const std::vector<Vec2>& boundary) {
  const std::optional<SoilProperties>& soil = model_->earthmoving.soil;
  if (!soil)
    throw std::invalid_argument("soil is rigid here and makes no heaps; give the site a soil");
  if (!survey_) throw std::invalid_argument("nothing was scanned yet; scan the heap first");
  // Soil of any machine may be in the heap: its volume errs as that of all cuts does.
  const MassBalance balance = tracker_->mass_balance_without_ground();
  double error_m3 = 0, moved_m3 = tracker_->total().cut_m3();
  moved_m3 += static_cast<double>(balance.poured) / static_cast<double>(balance.units.bank) *
              ground_->sample_m3();
  for (const Estimate& error : cut_errors_m3(*survey_))
    error_m3 += std::hypot(error.mean, error.sigma);
  return survey_->heap(boundary, tracker_->surveyed_samples(), soil->swell,
                       moved_m3 > 0 ? error_m3 / moved_m3 : 0);
}

}  // namespace soilvdb::inline v0
