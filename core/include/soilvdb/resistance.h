// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The force of the soil on a bucket.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/earthmoving.h"
#include "soilvdb/height_map.h"

namespace soilvdb::inline v0 {

/// What soil resists a tool with.
struct SoilStrength {
  double density_kg_m3 = 1800;   ///< of bank soil, > 0
  double cohesion_pa = 0;        ///< of bank soil, >= 0
  double friction_rad = 0;       ///< of bank soil, in [0, pi / 2)
  double tool_friction_rad = 0;  ///< soil on steel, in [0, pi / 2)
  double adhesion_pa = 0;        ///< soil on steel, >= 0

  /// Of a site's soil: friction of bank soil, else its angle of repose; no cohesion if none is
  /// given; tool friction of two thirds of friction.
  /// @throw std::invalid_argument with one line for invalid properties, or neither of both angles
  static SoilStrength of(const SoilProperties& soil);
};

/// A force, N, and its moment about the middle of the lip, N m.
struct Wrench {
  Vec3 force = Vec3::Zero(), moment = Vec3::Zero();

  Wrench operator+(const Wrench& o) const { return {force + o.force, moment + o.moment}; }
};

/// What the soil does to the bucket, in the bucket's frame, at the middle of the lip.
struct Resistance {
  Wrench cut;   ///< of the soil that fails ahead of the blade
  Wrench edge;  ///< of the lip's and the side plates' blunt edges
  Wrench load;  ///< weight of the load, without what the wedge counts above the blade
  Wrench heel;  ///< of faces of the body that press on the ground
  /// Derivatives of total().force by density (per kg/m3), cohesion and adhesion (per Pa), friction
  /// and tool friction (per rad), in the order of SoilStrength.
  Eigen::Matrix<double, 3, 5> by_strength = Eigen::Matrix<double, 3, 5>::Zero();
  double angle_rad = 0;  ///< of the failure planes with the way ahead, mean by force
  double depth_m = 0;    ///< of the lip below the ground just ahead, mean over its width
  bool steep = false;    ///< soil rides before a steep blade: a rough estimate
  bool pressed = false;  ///< a heel presses: a rough estimate
  bool open = false;     ///< the wedge ends where no more ground was looked at, or is known
  bool stuck = false;  ///< the soil can't fail, at least before some of the blade: that is left out
  bool lifts = false;  ///< the way rises more steeply than the failure planes: too high
  bool buried = false;  ///< the blade ends below the ground, and what is above that is left out
  bool rolled = false;  ///< the lip stands too steep for slices across it: only the load counts

  Wrench total() const { return cut + edge + load + heel; }
  /// Why the force is a rough estimate or too low, in words; empty if it is neither.
  std::string limited() const;
};

/// The same in another frame that moves with the bucket. @param rotation frame_from_bucket
Wrench turned(const Wrench& wrench, const Eigen::Quaterniond& rotation);

/// Ground, blade and load at one place of a bucket: all that its resistance depends on besides the
/// strength of the soil. Takes one look at the ground; resistance() may then be asked for many
/// soils.
///
/// The blade is the body's first face behind the lip with those that bend by less than 20 degrees
/// from it; without a profile it is the mouth. Ground that the bucket has dug is continued from
/// ahead of it with the shape of the initial terrain.
class CutGeometry {
 public:
  /// Of no place: nothing resists.
  CutGeometry() = default;
  CutGeometry(HeightMap& map, const Ground& ground, const Bucket& bucket,
              const Pose& world_from_bucket, const Vec3& way, double load_m3, double swell = 0) {
    read(map, ground, bucket, world_from_bucket, way, load_m3, swell);
  }

  /// Takes another look. Allocates only where it needs more room than all looks before, and where
  /// the map reads columns for the first time.
  /// @param map of the ground. @param way direction of the lip's motion, world; zero: ahead
  /// @param load_m3 in the bucket, as bank soil @param swell its loose volume over that, less 1:
  /// the load's centre is that of the loose volume, filled level
  /// @throw std::invalid_argument for a closed tool shape, and then it stays as it was; as
  ///        HeightMap::lines(), and then it has no meaning
  void read(HeightMap& map, const Ground& ground, const Bucket& bucket,
            const Pose& world_from_bucket, const Vec3& way, double load_m3, double swell = 0);

  /// The passive force of soil that fails ahead of the blade, strip by strip (wedge.h in core/force
  /// names the sources), and the other parts. Zero where the bucket leaves the soil: where
  /// it moves off the ground ahead of its blade, back, or straight up; but for the load. Not
  /// modelled: rate, water, rock, teeth, that loose soil is lighter and weaker than bank soil, and
  /// that friction on a blade which rises more steeply than the failure plane is reversed.
  /// @param crescents soil beside a blade without side plates moves with it (McKyes and Ali 1977);
  ///        its part of the force acts at the blade's corner on that side
  Resistance resistance(const SoilStrength& soil, bool crescents = true) const noexcept;

  const Pose& world_from_bucket() const { return pose_; }

  /// Serialization: resistance() of what load() gives has the same bits. @throw
  /// std::invalid_argument if the bytes are not from save()
  std::string save() const;
  static CutGeometry load(std::string_view bytes);

 private:
  struct Strip {
    Vec3 lip = Vec3::Zero();  // world, from the middle of the lip
    double first_x = 0;
    std::size_t first = 0, count = 0;  // in heights_
  };
  struct Heel {
    Vec3 at = Vec3::Zero();   // from the middle of the lip
    Vec3 out = Vec3::Zero();  // from the bucket, unit
    double area = 0;          // m2
    double depth = 0;         // below the ground as it was, m
    double length = 0;        // of the face in the ground, m
  };

  struct Contact {
    Vec3 at;
    double area;               // m2
    std::size_t heel, height;  // in heels_, heights_
  };
  struct Look;

  /// Calls each(value) for all numbers but those of strips, heights and heels.
  template <typename Geometry, typename Each>
  static void each_number(Geometry& of, const Each& each);

  Pose pose_;
  Vec3 way_ = Vec3::Zero(), ahead_ = Vec3::Zero();
  double strip_m_ = 0, step_m_ = 0, width_m_ = 0;
  double rake_rad_ = 0, face_m_ = 0;
  bool cuts_ = false;
  double lip_share_ = 0, plates_share_ = 0;  // of the pressure on edges, by their way
  double open_left_ = 0, open_right_ = 0;    // how much of the soil beside moves along
  bool rolled_ = false;
  double edge_m_ = 0, plate_m_ = 0, plates_m2_ = 0;
  Vec3 plates_at_ = Vec3::Zero();
  double load_m3_ = 0;
  Vec3 load_at_ = Vec3::Zero();
  std::vector<Strip> strips_;
  std::vector<double> heights_;
  std::vector<Heel> heels_;
  std::vector<Contact> contacts_;  // while it reads
};

}  // namespace soilvdb::inline v0
