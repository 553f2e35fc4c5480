// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A CutGeometry as bytes and back.
#include <cmath>
#include <cstdint>
#include <numbers>
#include <stdexcept>

#include "core/lattice/bytes.h"
#include "soilvdb/resistance.h"

namespace soilvdb::inline v0 {
namespace {

constexpr std::uint8_t kGeometryFormat = 2;
constexpr double kMostGeometry = 1e15;  // of any number: m, m2, m3
constexpr double kMostFaceSteps = 1e6;  // steps of the heights along the blade, which cost time

void require_geometry(bool good) {
  if (!good) throw std::invalid_argument("these bytes are not the geometry of a cut");
}

void take_geometry_number(std::string_view& in, double& value) {
  take(in, value);
  require_geometry(std::abs(value) <= kMostGeometry);
}
void take_geometry_vector(std::string_view& in, Vec3& vector) {
  for (double& v : vector) take_geometry_number(in, v);
}

/// A number of items, each of so many bytes or more.
std::size_t take_geometry_count(std::string_view& in, std::size_t item_bytes) {
  std::uint64_t count = 0;
  take(in, count);
  require_geometry(count <= in.size() / item_bytes);
  return static_cast<std::size_t>(count);
}

}  // namespace

template <typename Geometry, typename Each>
void CutGeometry::each_number(Geometry& of, const Each& each) {
  for (auto& v : of.pose_.position) each(v);
  for (auto& v : of.pose_.rotation.coeffs()) each(v);
  for (auto* vector : {&of.way_, &of.ahead_, &of.plates_at_, &of.load_at_})
    for (auto& v : *vector) each(v);
  for (auto* v : {&of.strip_m_, &of.step_m_, &of.width_m_, &of.rake_rad_, &of.face_m_,
                  &of.lip_share_, &of.plates_share_, &of.open_left_, &of.open_right_, &of.edge_m_,
                  &of.plate_m_, &of.plates_m2_, &of.load_m3_})
    each(*v);
}

std::string CutGeometry::save() const {
  std::string out;
  put(out, kGeometryFormat);
  each_number(*this, [&](const double& v) { put(out, v); });
  put(out, cuts_, rolled_, std::uint64_t{heights_.size()});
  for (const double z : heights_) put(out, z);
  put(out, std::uint64_t{strips_.size()});
  for (const Strip& strip : strips_)
    put(out, strip.lip, strip.first_x, std::uint64_t{strip.first}, std::uint64_t{strip.count});
  put(out, std::uint64_t{heels_.size()});
  for (const Heel& heel : heels_) put(out, heel.at, heel.out, heel.area, heel.depth, heel.length);
  return out;
}

CutGeometry CutGeometry::load(std::string_view bytes) {
  std::uint8_t format = 0;
  require_geometry(try_take(bytes, format) && format == kGeometryFormat);
  CutGeometry made;
  each_number(made, [&](double& v) { take_geometry_number(bytes, v); });
  require_geometry(std::abs(made.rake_rad_) <= std::numbers::pi && made.width_m_ > 0 &&
                   made.step_m_ > 0 && made.face_m_ < kMostFaceSteps * made.step_m_);
  take(bytes, made.cuts_, made.rolled_);
  made.heights_.resize(take_geometry_count(bytes, sizeof(double)));
  for (double& z : made.heights_) take(bytes, z);  // NaN beyond a strip's end
  made.strips_.resize(take_geometry_count(bytes, 6 * sizeof(double)));
  for (Strip& strip : made.strips_) {
    take_geometry_vector(bytes, strip.lip);
    take_geometry_number(bytes, strip.first_x);
    std::uint64_t first = 0, count = 0;
    take(bytes, first, count);
    require_geometry(first <= made.heights_.size() && count <= made.heights_.size() - first);
    strip.first = static_cast<std::size_t>(first);
    strip.count = static_cast<std::size_t>(count);
    for (std::size_t i = 0; i < strip.count; ++i)
      require_geometry(std::abs(made.heights_[strip.first + i]) <= kMostGeometry);
  }
  require_geometry(!made.cuts_ || !made.strips_.empty());
  made.heels_.resize(take_geometry_count(bytes, 9 * sizeof(double)));
  for (Heel& heel : made.heels_) {
    take_geometry_vector(bytes, heel.at);
    take_geometry_vector(bytes, heel.out);
    for (double* v : {&heel.area, &heel.depth, &heel.length}) take_geometry_number(bytes, *v);
  }
  require_geometry(bytes.empty());
  return made;
}

}  // namespace soilvdb::inline v0
