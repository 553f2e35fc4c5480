// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/drawn_lines.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "io/file/json.h"

namespace soilvdb::tools {
namespace {

/// Distance of the points of lines on the ground: the least, and how many there are at most.
constexpr double kLeastStep_m = 0.5, kMostLaid = 100'000;

double rounded(double metres) { return std::round(metres * 1000) / 1000; }

/// Lines that are made point by point.
class Pen {
 public:
  void draw(const Vec3& p) { now_.push_back({rounded(p.x()), rounded(p.y()), rounded(p.z())}); }
  void lift() {
    if (now_.size() > 1) lines_.push_back(std::move(now_));
    now_ = nlohmann::json::array();
  }
  nlohmann::json take() { return std::move(lines_); }

 private:
  nlohmann::json lines_ = nlohmann::json::array(), now_ = nlohmann::json::array();
};

}  // namespace

std::string drawn_lines(const io::DesignLines& lines, const io::Site& site) {
  double length_m = 0;
  for (const std::vector<Vec3>& line : lines.lines)
    for (std::size_t i = 1; i < line.size(); ++i)
      if (std::isnan(line[i].z())) length_m += (line[i] - line[i - 1]).head<2>().norm();
  const double step_m = std::max(kLeastStep_m, length_m / kMostLaid);
  const InitialTerrain& ground = site.ground->initial_terrain();
  Pen pen;
  const auto lay = [&](const Vec2& at) {
    if (const auto z = ground.height(at.x(), at.y()))
      pen.draw({at.x(), at.y(), *z});
    else
      pen.lift();
  };
  for (const std::vector<Vec3>& line : lines.lines) {
    for (std::size_t i = 0; i < line.size(); ++i) {
      if (!std::isnan(line[i].z())) {
        pen.draw(line[i]);
        continue;
      }
      const Vec2 to = line[i].head<2>(), from = i == 0 ? to : Vec2(line[i - 1].head<2>());
      const double steps = std::max(1.0, std::ceil((to - from).norm() / step_m));
      for (double k = i == 0 ? steps : 1; k <= steps; ++k) lay(from + k / steps * (to - from));
    }
    pen.lift();
  }
  const nlohmann::json all = {{"lines", pen.take()}};
  return io::to_text(all);
}

}  // namespace soilvdb::tools
