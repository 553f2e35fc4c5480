// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ray-traced light on a level set: sun with shadows, sky with ambient occlusion.
#pragma once

#include <openvdb/openvdb.h>

#include <cstdint>
#include <functional>
#include <vector>

#include "io/draw/canvas.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// A pinhole camera; pixel (x, y) looks along forward + (u0 + x s) right + (v0 - y s) up.
struct Camera {
  Vec3 eye, forward, right, up;
  double u0 = 0, v0 = 0, s = 1;

  Vec3 ray(double x, double y) const {
    return (forward + (u0 + x * s) * right + (v0 - y * s) * up).normalized();
  }
  Vec2 tangent(const Vec3& p) const {
    const Vec3 d = p - eye;
    return Vec2(d.dot(right), d.dot(up)) / d.dot(forward);
  }
  Vec2 project(const Vec3& p) const {
    const Vec2 t = tangent(p);
    return {(t.x() - u0) / s, (v0 - t.y()) / s};
  }
};

/// All coordinates are those of the grid's transform.
struct Scene {
  openvdb::FloatGrid::ConstPtr ground;
  Vec3 low, high;  ///< corners of the block that is cut out of it
  Vec3 to_sun;     ///< unit
  /// Colour of the ground where a ray hit it; must be thread-safe.
  std::function<Rgb(const Vec3& point, const Vec3& normal)> color;
};

/// Sum of `wanted` over the rays that hit ground, as a share of all rays of a w x h picture. Values
/// of `wanted` that are not more than 0 count as 0.
double seen(const Scene& scene, const Camera& camera, int w, int h,
            const std::function<double(const Vec3& point)>& wanted);

/// Renders w x h opaque pixels on a light background, four rays each. The pixels do not depend on
/// the number of threads.
std::vector<std::uint32_t> render(const Scene& scene, const Camera& camera, int w, int h);

}  // namespace soilvdb::inline v0::io
