// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Grounds to pour on, and the pile that must come of it: closed forms, or distances in closed form
// with the level that holds the volume found on a finer grid. No code of the engine's makes them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/pour_fixture.h"

namespace soilvdb::test {

/// Most that heights may be off, columns' sides.
struct Goal {
  double rms, p99;
};

struct Scene {
  std::string name;
  Surface shape;   ///< the ground, anywhere
  Columns ground;  ///< the same as columns; walls are rigid
  Vec2 source;
  double volume_m3;
  Surface truth = nullptr;
  Goal goal{0.4, 1};
  bool steps = false;  ///< the ground has some, at borders of columns
};

/// Radius in columns of that side; the source is shifted by so many of them from the middle.
Scene flat_scene(double radius, double side_m, const Vec2& shift);
/// @param share of repose that the ground slopes by
Scene incline_scene(double share);
/// A wall at so many metres from the source.
Scene wall_scene(double distance_m);
/// Beside a heap, or with a line as its top a ridge, as steep as soil lies.
Scene beside_scene(bool ridge, double volume_m3);
/// Ground that is 1 m lower from 0.5 m off the source on: a trench so wide, or a step.
Scene drop_scene(double width_m, double volume_m3, double along_m = 0.013);

/// Waves at random that are nowhere steeper than 0.9 of repose.
Scene gentle_scene(std::uint64_t seed, double volume_m3);

/// What the scene's columns must come to.
Columns truth_of(const Scene& scene);
/// All of them, in several sizes.
std::vector<Scene> scenes();

/// Where a function that grows with its argument is `value`.
double solve(double low, double high, double value, const std::function<double(double)>& holds);

}  // namespace soilvdb::test
