// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/motion_angles.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

bool has_stops(const Joint& joint) { return joint.lower != joint.upper && !may_wrap(joint); }

}  // namespace

bool may_wrap(const Joint& joint) {
  if (joint.type == Joint::Type::kContinuous) return true;
  const double range = joint.upper - joint.lower;
  return joint.type == Joint::Type::kRevolute && (range == 0 || range > 0.9 * kTurn);
}

std::string angle_text(double angle_rad, AngleUnit unit) {
  if (unit == AngleUnit::kRadians) return fmt::format("{:.4g}", angle_rad);
  return fmt::format("{:.5g}", angle_rad / kDegree);
}

const char* unit_name(AngleUnit unit) { return unit == AngleUnit::kRadians ? "rad" : "degrees"; }

Angles::Angles(const std::vector<std::string>& names, const std::optional<Chain>& chain,
               AngleUnit unit)
    : unit_(unit), joints_(chain.has_value()) {
  const std::string prefix = chain ? "base_" : "";
  for (std::size_t i = 1 + (chain ? chain->movable_count() : 0); i < names.size(); ++i)
    for (const char* name : {"roll", "pitch", "yaw"})
      if (names[i] == prefix + name) angles_.push_back({i, names[i], names[i].ends_with("yaw")});
  if (!chain) return;
  std::size_t at = 0;
  for (const Joint& joint : chain->joints) {
    if (!joint.moves_itself()) continue;
    ++at;
    if (joint.type != Joint::Type::kPrismatic)
      angles_.push_back({at, joint.name, !has_stops(joint), true});
  }
}

void Angles::row(std::vector<double>& v, long line) {
  ++rows_;
  const Angle *beyond = nullptr, *impossible = nullptr;
  for (const Angle& angle : angles_) {
    if (unit_ == AngleUnit::kDegrees) v[angle.at] *= kDegree;
    if (std::abs(v[angle.at]) <= kTurn) continue;
    if (beyond == nullptr && !angle.of_joint) beyond = &angle;
    if (impossible == nullptr && !angle.goes_round) impossible = &angle;
  }
  const auto count = [&](Count& rows, const Angle* angle) {
    if (angle == nullptr || rows.rows++ > 0) return;
    rows.first = line;
    rows.name = angle->name;
    rows.angle_rad = v[angle->at];
  };
  count(beyond_, beyond);
  count(impossible_, impossible);
}

void Angles::check(const std::filesystem::path& file) const {
  const auto& [rows, first, name, angle_rad] = impossible_;
  if (unit_ == AngleUnit::kDegrees || rows == 0 || 2 * rows < rows_) return;
  throw InputError(
      file, first,
      fmt::format("{} is {:g} rad, more than a whole turn, and {} of {} rows have such angles: "
                  "they look like degrees; make them radians, or say 'angles: degrees' beside "
                  "the machine's 'motion:'{}",
                  printable(name), angle_rad, rows, rows_,
                  joints_ ? "" : "; keep roll, pitch and yaw within a turn"));
}

void Angles::warn(const RowPlace& place, std::vector<std::string>& warnings) const {
  const std::string file = place.file().string();
  if (beyond_.rows == 0) return;
  const std::string rows = fmt::format("{} row{}, first at {} {}", beyond_.rows,
                                       beyond_.rows == 1 ? "" : "s", place.noun(), beyond_.first);
  warnings.push_back(
      unit_ == AngleUnit::kDegrees
          ? fmt::format("{}: roll, pitch or yaw is beyond 360 degrees in {}", file, rows)
          : fmt::format("{}: roll, pitch or yaw is beyond a turn in {}; they must be in radians, "
                        "not degrees, unless 'angles: degrees' is beside the machine's 'motion:'",
                        file, rows));
}

}  // namespace soilvdb::inline v0::io
