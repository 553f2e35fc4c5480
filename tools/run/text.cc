// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <variant>

#include "io/terrain/crs.h"
#include "soilvdb/io/error.h"

namespace soilvdb::tools {
namespace {

std::string without_trailing_zeros(std::string text) {
  if (text.find('.') == std::string::npos) return text;
  while (text.back() == '0') text.pop_back();
  if (text.back() == '.') text.pop_back();
  return text == "-0" ? "0" : text;
}

}  // namespace

void say(std::string line) {
  std::fputs(("soilvdb: " + io::one_line(std::move(line), ' ') + "\n").c_str(), stderr);
}

std::string number(double value) {
  constexpr double kNothing = 1e-9;
  if (std::abs(value) < kNothing) return "0";
  const int digits = static_cast<int>(std::floor(std::log10(std::abs(value))));
  return without_trailing_zeros(fmt::format("{:.{}f}", value, std::clamp(3 - digits, 1, 9)));
}

std::string length_text(double length_m) {
  return fmt::format("{:.10g}", length_m);  // hides rounding errors of computed lengths
}

std::string bytes(double count) {
  for (const char* unit : {"bytes", "kB", "MB", "GB"}) {
    if (count < 999.5) return fmt::format("{:.3g} {}", count, unit);
    count /= 1000;
  }
  return fmt::format("{:.3g} TB", count);
}

std::string extent_text(const Eigen::AlignedBox2d& box) {
  return fmt::format("from {:.0f}, {:.0f} to {:.0f}, {:.0f}", box.min().x(), box.min().y(),
                     box.max().x(), box.max().y());
}

std::string time_text(double seconds) {
  return without_trailing_zeros(fmt::format("{:.6f}", seconds));
}

std::string counted(std::uint64_t count, const std::string& noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

std::string crs_text(const std::string& wkt) {
  const std::string label = io::crs_label(wkt);
  return label.empty() ? "not known, taken as metres" : label;
}

std::string terrain_text(const io::Terrain& terrain) {
  if (const auto* plane = std::get_if<io::PlaneTerrain>(&terrain))
    return fmt::format("plane z = {} m at x = y = 0, slope {} {}", length_text(plane->height_m),
                       plane->slope.x(), plane->slope.y());
  if (const auto* raster = std::get_if<io::RasterTerrain>(&terrain))
    return fmt::format("raster {}", raster->file.string());
  const auto& level_set = std::get<io::LevelSetTerrain>(terrain);
  return fmt::format("level set {}{}", level_set.file.string(),
                     level_set.grid.empty() ? "" : ", grid " + io::one_line(level_set.grid));
}

std::string beneath_text(const Ground& ground) {
  const Ground* beneath = ground.terrain().ground();
  if (beneath == nullptr) return "";
  const double h = beneath->voxel_size_m();
  return fmt::format("the surface of a snapshot with voxels of {} m, true to {} m where it was dug",
                     length_text(h), length_text(h / 2));
}

}  // namespace soilvdb::tools
