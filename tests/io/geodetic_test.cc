// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Positions by latitude and longitude, against a series and published figures.
#include "io/terrain/geodetic.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <complex>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <functional>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "io/terrain/crs.h"
#include "soilvdb/gnss.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace geodetic_test {

using testing::HasSubstr;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kAxis_m = 6378137, kFlattening = 1 / 298.257223563;  // WGS 84
constexpr double kScale = 0.9996;                                     // of UTM
const Eigen::AlignedBox2d kAnywhere;

/// UTM by Krüger's series to the fourth power of the third flattening (Karney 2011, eq. 35), which
/// leaves out some 1e-7 m. @param from_middle longitude from the zone's middle, degrees
Vec2 utm(double latitude, double from_middle) {
  const double n = kFlattening / (2 - kFlattening), n2 = n * n, n3 = n2 * n, n4 = n2 * n2;
  const std::array alpha = {n / 2 - 2 * n2 / 3 + 5 * n3 / 16 + 41 * n4 / 180,
                            13 * n2 / 48 - 3 * n3 / 5 + 557 * n4 / 1440,
                            61 * n3 / 240 - 103 * n4 / 140, 49561 * n4 / 161280};
  const double radius_m = kAxis_m / (1 + n) * (1 + n2 / 4 + n4 / 64);
  const double e = std::sqrt(kFlattening * (2 - kFlattening)), sine = std::sin(latitude * kDegree);
  const double t = std::sinh(std::atanh(sine) - e * std::atanh(e * sine));
  const double l = from_middle * kDegree;
  const std::complex<double> sphere(std::atan2(t, std::cos(l)),
                                    std::asinh(std::sin(l) / std::hypot(t, std::cos(l))));
  std::complex<double> map = sphere;
  for (std::size_t j = 0; j < alpha.size(); ++j)
    map += alpha[j] * std::sin(2.0 * static_cast<double>(j + 1) * sphere);
  return {5e5 + kScale * radius_m * map.imag(), kScale * radius_m * map.real()};
}

/// Of a place in UTM, by Newton's method on utm(): latitude, longitude from the middle.
Vec2 inverse_utm(const Vec2& place) {
  Vec2 at(place.y() / 111000, 0);
  for (int i = 0; i < 20; ++i) {
    constexpr double kStep = 1e-5;
    Eigen::Matrix2d slope;
    for (int j = 0; j < 2; ++j) {
      const Vec2 step = kStep * Vec2::Unit(j), ahead = at + step, behind = at - step;
      slope.col(j) = (utm(ahead.x(), ahead.y()) - utm(behind.x(), behind.y())) / (2 * kStep);
    }
    at -= slope.inverse() * (utm(at.x(), at.y()) - place);
  }
  return at;
}

Gnss gnss_of(std::string site_crs, std::optional<double> undulation_m = 0.0) {
  Gnss gnss;
  gnss.site_crs = std::move(site_crs);
  gnss.undulation_m = undulation_m;
  return gnss;
}

TEST(Geodetic, UtmIsThatOfASeries) {
  const Geodetic geodetic(gnss_of("EPSG:32632"), "", kAnywhere);
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> latitude(0, 80), from_middle(-3.5, 3.5),
      height(-100, 5000);
  for (int i = 0; i < 500; ++i) {
    const GeodeticPlace place{latitude(random), 9 + from_middle(random), height(random)};
    const Vec3 found = geodetic.in_site(place);
    EXPECT_LT((found.head<2>() - utm(place.latitude, place.longitude - 9)).norm(), 1e-5);
    EXPECT_EQ(found.z(), place.height_m);
  }
}

/// IOGP, guidance note 7-2, 3.5.3.1: the example of Transverse Mercator.
TEST(Geodetic, ThePublishedExampleOfTheBritishGridIsMet) {
  Gnss gnss = gnss_of("EPSG:27700");
  gnss.crs = "EPSG:4277";
  const Vec3 found = Geodetic(gnss, "", kAnywhere).in_site({50.5, 0.5, 12});
  EXPECT_LT((found - Vec3(577274.99, 69740.50, 12)).norm(), 0.01);
}

TEST(Geodetic, LongitudesMayCountEastwardsOnly) {
  const Geodetic geodetic(gnss_of("EPSG:32618"), "", kAnywhere);
  EXPECT_EQ(geodetic.in_site({40, 285.5, 3}), geodetic.in_site({40, -74.5, 3}));
}

/// Heights of the geoid at the places that NIMA published with EGM96's spherical harmonics, m. Its
/// program interpolates by splines, PROJ linearly between posts of a quarter of a degree.
TEST(Geodetic, Egm96IsAsPublished) {
  constexpr double kInterpolation_m = 0.07;
  struct Published {
    double latitude, longitude, height_m;
  };
  for (const auto& [latitude, longitude, height_m] :
       {Published{38.6281550, 269.7791550, -31.628}, Published{-14.6212170, 305.0211140, -2.969},
        Published{46.8743190, 102.4487290, -43.575}, Published{-23.6174460, 133.8747120, 15.871},
        Published{38.6254730, 359.9995000, 50.066}, Published{-0.4667440, 0.0023000, 17.329}}) {
    const std::string map = fmt::format("EPSG:{}", utm_epsg(longitude, latitude));
    Gnss by_grid = gnss_of(map, std::nullopt);
    by_grid.geoid = "egm96_15.gtx";
    const Gnss by_crs = gnss_of(map + "+5773", std::nullopt);
    const Vec3 found = Geodetic(by_grid, "", kAnywhere).in_site({latitude, longitude, 100});
    EXPECT_NEAR(100 - found.z(), height_m, kInterpolation_m);
    EXPECT_LT((Geodetic(by_crs, "", kAnywhere).in_site({latitude, longitude, 100}) - found).norm(),
              1e-6);
    const Vec3 constant =
        Geodetic(gnss_of(map, height_m), "", kAnywhere).in_site({latitude, longitude, 100});
    EXPECT_NEAR(constant.z(), 100 - height_m, 1e-9);
  }
}

/// A grid in the form of NOAA's .gtx: corner, steps, size and heights, the largest byte first.
std::string gtx(double south, double west, double step, int rows, int columns,
                const std::function<double(double, double)>& height_m) {
  std::string bytes;
  const auto add = [&](auto value) {
    std::array<char, sizeof value> raw;
    std::memcpy(raw.data(), &value, sizeof value);
    if constexpr (std::endian::native == std::endian::little) std::reverse(raw.begin(), raw.end());
    bytes.append(raw.begin(), raw.end());
  };
  for (const double number : {south, west, step, step}) add(number);
  for (const int number : {rows, columns}) add(std::int32_t{number});
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j)
      add(static_cast<float>(height_m(south + i * step, west + j * step)));
  return bytes;
}

TEST(Geodetic, AGeoidMayBeAFileAndHoldsWhereItIs) {
  const test::TempFolder folder;
  const auto plane = [](double latitude, double longitude) {
    return 40 + 2 * (latitude - 48) - 3 * (longitude - 9);
  };
  Gnss gnss = gnss_of("EPSG:32632", std::nullopt);
  gnss.geoid = folder.write("our geoid.gtx", gtx(47, 8, 0.25, 9, 9, plane)).string();
  const Geodetic geodetic(gnss, "", kAnywhere);
  for (const auto& [latitude, longitude] :
       {std::pair(48.0, 9.0), std::pair(47.13, 8.37), std::pair(48.9, 9.6)})
    EXPECT_NEAR(geodetic.in_site({latitude, longitude, 500}).z(), 500 - plane(latitude, longitude),
                1e-5);
  EXPECT_THROW(geodetic.in_site({46.5, 9, 500}), std::invalid_argument);
  const Vec2 there = utm(48, 0), elsewhere = utm(46.5, 0);
  const auto around = [](const Vec2& place) {
    return Eigen::AlignedBox2d(place - Vec2(20, 20), place + Vec2(20, 20));
  };
  EXPECT_NO_THROW(Geodetic(gnss, "", around(there)));
  EXPECT_THROW(Geodetic(gnss, "", around(elsewhere)), std::invalid_argument) << "at the start";
}

/// The old observatory of Bern is 2600000, 1200000 in LV95, whose ellipsoid lies tens of metres
/// from that of the receiver. What was stated of the geoid counts from the latter.
TEST(Geodetic, AStatedGeoidCountsFromTheReceiversEllipsoid) {
  const double latitude = 46 + (57 + 8.66 / 60) / 60., longitude = 7 + (26 + 22.50 / 60) / 60.;
  Gnss gnss = gnss_of("EPSG:2056", 49.6);
  gnss.crs = "EPSG:4937";
  const Vec3 at = Geodetic(gnss, "", kAnywhere).in_site({latitude, longitude, 500});
  EXPECT_EQ(at.z(), 500 - 49.6);
  // These degrees are CH1903's; ETRS89's differ by some hundred metres.
  EXPECT_LT((at.head<2>() - Vec2(2600000, 1200000)).norm(), 400);
  gnss.undulation_m.reset();
  gnss.geoid = "egm96_15.gtx";
  const double z = Geodetic(gnss, "", kAnywhere).in_site({latitude, longitude, 500}).z();
  EXPECT_NEAR(z, 500 - 48.8, 1.5);
}

TEST(Geodetic, AWayThatIsKnownBadlyIsDoubted) {
  EXPECT_EQ(Geodetic(gnss_of("EPSG:32632"), "", kAnywhere).doubt(), "");
  EXPECT_EQ(Geodetic(gnss_of("EPSG:25832"), "", kAnywhere).doubt(),
            "the way from EPSG:4979 to EPSG:25832 is known to 1 m; 'crs' should be that of the "
            "receiver's corrections");
  Gnss same = gnss_of("EPSG:25832");
  same.crs = "EPSG:4937";
  EXPECT_EQ(Geodetic(same, "", kAnywhere).doubt(), "");
  EXPECT_EQ(Geodetic(gnss_of("EPSG:32632+5773"), "", kAnywhere).doubt(),
            "heights are by 'geoid', not by the vertical part of EPSG:32632+5773");
  const std::string bound =
      R"(PROJCS["own",GEOGCS["own",DATUM["own",SPHEROID["WGS 84",6378137,298.257223563],)"
      R"(TOWGS84[10,20,30,0,0,0,0]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],)"
      R"(PROJECTION["Transverse_Mercator"],PARAMETER["central_meridian",9],)"
      R"(PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],UNIT["metre",1]])";
  EXPECT_THAT(Geodetic(gnss_of(""), bound, kAnywhere).doubt(),
              HasSubstr("the terrain's CRS has its own transformation"));
}

/// EPSG's transformations from Arc 1950 are good to 7 m in Botswana, and to 44 m for all countries.
TEST(Geodetic, TheWayIsThatOfTheSitesPlace) {
  Gnss gnss = gnss_of("EPSG:32735");
  gnss.crs = "EPSG:4209";
  const Vec2 mirrored = utm(23, 23 - 27), place(mirrored.x(), 1e7 - mirrored.y());
  const Eigen::AlignedBox2d bounds(place - Vec2(20, 20), place + Vec2(20, 20));
  EXPECT_THAT(Geodetic(gnss, "", bounds).doubt(), HasSubstr("is known to 7 m"));
  EXPECT_THAT(Geodetic(gnss, "", kAnywhere).doubt(), HasSubstr("is known to 44 m"));
}

Pose any_pose(std::mt19937_64& random, const Vec3& middle) {
  std::uniform_real_distribution<double> metres(-500, 500), tilt(-0.4, 0.4), turn(-3.1, 3.1);
  return {middle + Vec3(metres(random), metres(random), metres(random) / 20),
          from_rpy(tilt(random), tilt(random), turn(random))};
}

/// A map's plane is bent by 1e-7 within the lever arms; the rest is the inverse's rounding.
TEST(Geodetic, PosesComeBackFromTheirAntennas) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> metres(-3, 3);
  const Vec2 middle = utm(48, 3);
  Gnss gnss = gnss_of("EPSG:32632", 47.1);
  gnss.antennas_m.resize(2);
  const Geodetic geodetic(gnss, "", kAnywhere);
  for (int i = 0; i < 200; ++i) {
    const Pose pose = any_pose(random, {middle.x(), middle.y(), 430});
    do
      for (Vec3& antenna : gnss.antennas_m)
        antenna = {metres(random), metres(random), 3 + metres(random) / 10};
    while ((gnss.antennas_m[1] - gnss.antennas_m[0]).head<2>().norm() < 1);
    std::vector<Vec3> places_m;
    for (const Vec3& antenna : gnss.antennas_m) {
      const Vec3 place = pose * antenna;
      const Vec2 at = inverse_utm(place.head<2>());
      places_m.push_back(geodetic.in_site({at.x(), 9 + at.y(), place.z() + 47.1}));
    }
    // An inclinometer's roll and pitch tell what points up.
    const Vec3 up = pose.rotation.conjugate() * Vec3::UnitZ();
    const Pose found = pose_of_antennas(gnss.antennas_m, places_m, up);
    EXPECT_LT((found.position - pose.position).norm(), 1e-4);
    EXPECT_LT(found.rotation.angularDistance(pose.rotation), 1e-5);
  }
}

TEST(Geodetic, WithoutAnInclinometerItStandsAsUprightAsItsAntennasLetIt) {
  std::mt19937_64 random(3);
  const std::vector<Vec3> mounted_m = {{-1, 0.9, 3}, {-1, -0.9, 3}};
  for (int i = 0; i < 100; ++i) {
    const Pose pose = any_pose(random, {0, 0, 0});
    const std::vector<Vec3> places_m = {pose * mounted_m[0], pose * mounted_m[1]};
    const Pose found = pose_of_antennas(mounted_m, places_m, Vec3::UnitZ());
    const auto upright = [](const Eigen::Quaterniond& rotation) {
      return (rotation * Vec3::UnitZ()).z();
    };
    for (std::size_t k = 0; k < 2; ++k)
      EXPECT_LT((found * mounted_m[k] - places_m[k]).norm(), 1e-9);
    const Vec3 line = (places_m[1] - places_m[0]).normalized();
    for (const double turn : {-0.5, -1e-3, 1e-3, 0.5})
      EXPECT_LT(upright(Eigen::AngleAxisd(turn, line) * found.rotation), upright(found.rotation));
  }
}

Vec3 on_earth(double latitude, double longitude, double height_m) {
  const double e2 = kFlattening * (2 - kFlattening), sine = std::sin(latitude * kDegree);
  const double normal_m = kAxis_m / std::sqrt(1 - e2 * sine * sine);
  const double cosine = std::cos(latitude * kDegree);
  return {(normal_m + height_m) * cosine * std::cos(longitude * kDegree),
          (normal_m + height_m) * cosine * std::sin(longitude * kDegree),
          (normal_m * (1 - e2) + height_m) * sine};
}

/// A machine in space, heading east by the stars: on the map it heads as far from east as grid
/// north is from true north, 2.2 degrees here.
TEST(Geodetic, HeadingsAreFromGridNorth) {
  constexpr double kLatitude = 48, kFromMiddle = 3, kHeight_m = 500;
  const double phi = kLatitude * kDegree, lambda = (9 + kFromMiddle) * kDegree;
  Eigen::Matrix3d earth_from_local;  // east, north, up
  earth_from_local << -std::sin(lambda), -std::sin(phi) * std::cos(lambda),
      std::cos(phi) * std::cos(lambda), std::cos(lambda), -std::sin(phi) * std::sin(lambda),
      std::cos(phi) * std::sin(lambda), 0, std::cos(phi), std::sin(phi);
  const Vec3 root = on_earth(kLatitude, 9 + kFromMiddle, kHeight_m);
  Gnss gnss = gnss_of("EPSG:32632");
  gnss.antennas_m = {{1.0, 0.9, 0}, {1.0, -0.9, 0}};
  const Geodetic geodetic(gnss, "", kAnywhere);
  std::vector<Vec3> places_m;
  for (const Vec3& antenna : gnss.antennas_m) {
    const Vec3 place = root + earth_from_local * antenna;
    Vec3 at(kLatitude, 9 + kFromMiddle, kHeight_m);  // by Newton's method
    for (int i = 0; i < 10; ++i) {
      constexpr double kStep = 1e-4;
      Eigen::Matrix3d slope;
      for (int j = 0; j < 3; ++j) {
        const Vec3 ahead = at + kStep * Vec3::Unit(j), behind = at - kStep * Vec3::Unit(j);
        slope.col(j) =
            (on_earth(ahead[0], ahead[1], ahead[2]) - on_earth(behind[0], behind[1], behind[2])) /
            (2 * kStep);
      }
      at -= slope.inverse() * (on_earth(at[0], at[1], at[2]) - place);
    }
    places_m.push_back(geodetic.in_site({at[0], at[1], at[2]}));
  }
  const Pose found = pose_of_antennas(gnss.antennas_m, places_m, Vec3::UnitZ());
  const Vec2 north = utm(kLatitude + 1e-4, kFromMiddle) - utm(kLatitude - 1e-4, kFromMiddle);
  const double convergence = std::atan2(north.x(), north.y());
  EXPECT_NEAR(std::abs(convergence), std::atan(std::tan(3 * kDegree) * std::sin(phi)), 1e-4);
  const Vec3 ahead = found.rotation * Vec3::UnitX();
  EXPECT_NEAR(std::atan2(ahead.y(), ahead.x()), -convergence, 1e-6);
  // The lever arm is as long as on the machine, and the map's scale here 1.0009 of that.
  const Vec2 place = utm(kLatitude, kFromMiddle);
  EXPECT_LT((found.position - Vec3(place.x(), place.y(), kHeight_m)).norm(), 1e-3);
}

/// GDA2020 moves with its plate by the rates of its technical manual, ITRF2014 does not, and in
/// 2020 they agreed.
TEST(Geodetic, APlateHasMovedUntilNow) {
  constexpr double kLatitude = -25, kLongitude = 147, kMilliarcsecond = kDegree / 3600 / 1000;
  constexpr double kUnixSecondsOf2020 = 1577836800, kYear_s = 365.2425 * 86400;
  Gnss fixed = gnss_of("EPSG:7855"), moving = fixed;
  fixed.crs = "EPSG:7843";
  moving.crs = "EPSG:7912";
  const GeodeticPlace place{kLatitude, kLongitude, 100};
  const Vec3 moved = Geodetic(moving, "", kAnywhere).in_site(place) -
                     Geodetic(fixed, "", kAnywhere).in_site(place);
  const Vec3 rates = kMilliarcsecond * Vec3(1.50379, 1.18346, 1.20716);
  const Vec3 per_year = rates.cross(on_earth(kLatitude, kLongitude, 100));
  const double phi = kLatitude * kDegree, lambda = kLongitude * kDegree;
  const Vec3 east(-std::sin(lambda), std::cos(lambda), 0);
  const Vec3 north(-std::sin(phi) * std::cos(lambda), -std::sin(phi) * std::sin(lambda),
                   std::cos(phi));
  const double years = (static_cast<double>(std::time(nullptr)) - kUnixSecondsOf2020) / kYear_s;
  const Vec2 wanted = -years * Vec2(per_year.dot(east), per_year.dot(north));
  // In the middle of the zone, whose scale is 0.9996.
  EXPECT_LT((moved.head<2>() - wanted).norm(), 1e-3 * years) << moved.transpose();
}

std::string refusal(const Gnss& gnss, const std::string& wkt = "") {
  try {
    const Geodetic geodetic(gnss, wkt, kAnywhere);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "nothing thrown";
}

TEST(Geodetic, AWayThatIsNotKnownIsRefused) {
  EXPECT_EQ(refusal({}),
            "the terrain has no CRS, in which the positions would be; give 'site_crs', such as "
            "EPSG:25832+7837");
  const auto receiver = [](const char* crs) {
    Gnss gnss = gnss_of("EPSG:32632");
    gnss.crs = crs;
    return gnss;
  };
  for (const char* none : {"WGS84", "EPSG:0", "+proj=longlat", "/etc/passwd", ":"})
    EXPECT_THAT(refusal(receiver(none)), HasSubstr("no CRS that PROJ knows; it must be a code such "
                                                   "as EPSG:4979"))
        << none;
  for (const char* unfit : {"EPSG:32632", "EPSG:5773", "EPSG:4978", "EPSG:4807", "EPSG:4326+5773"})
    EXPECT_EQ(refusal(receiver(unfit)),
              fmt::format("'crs' is '{}'; it must be of latitude and longitude in degrees and the "
                          "height above the ellipsoid, such as EPSG:4979",
                          unfit));
  EXPECT_EQ(refusal(gnss_of("EPSG:none")),
            "'site_crs' is 'EPSG:none', no CRS that PROJ knows; it must be a code such as "
            "EPSG:25832+7837");
  for (const char* unfit :
       {"EPSG:4326", "EPSG:2263", "EPSG:5513", "EPSG:32618+6360", "EPSG:32618+5715"})
    EXPECT_EQ(refusal(gnss_of(unfit)),
              fmt::format("the site's CRS, {}, must be a map's with x east, y north and heights up "
                          "in metres",
                          unfit));
  EXPECT_EQ(refusal(gnss_of("EPSG:32632", std::nullopt)),
            "the site's CRS, EPSG:32632, doesn't tell what its heights are above; give 'geoid': a "
            "grid such as egm96_15.gtx, or the geoid's height above the ellipsoid in metres, 0 if "
            "heights are above the ellipsoid");
  EXPECT_EQ(refusal(gnss_of("EPSG:32632+5600", std::nullopt)),  // heights of Tahiti
            "PROJ doesn't know the way from EPSG:4979 to EPSG:32632+5600; give another 'crs' or "
            "'geoid'");
  for (const char* none :
       {"no_such.gtx", "@no_such.gtx", "null", "egm96_15.gtx,null", "a\" b", "world"}) {
    Gnss gnss = gnss_of("EPSG:32632", std::nullopt);
    gnss.geoid = none;
    EXPECT_EQ(refusal(gnss), fmt::format("'geoid' is '{}', no grid that PROJ can read; it must be "
                                         "metres, a file, or one of PROJ's, such as egm96_15.gtx",
                                         none));
  }
}

TEST(Geodetic, AMapWithHeightsAboveTheEllipsoidNeedsNoGeoid) {
  const std::string map =
      R"(PROJCRS["UTM 32 and heights",BASEGEOGCRS["WGS 84",DATUM["World Geodetic System 1984",)"
      R"(ELLIPSOID["WGS 84",6378137,298.257223563]]],CONVERSION["UTM 32",)"
      R"(METHOD["Transverse Mercator"],PARAMETER["Latitude of natural origin",0],)"
      R"(PARAMETER["Longitude of natural origin",9],)"
      R"(PARAMETER["Scale factor at natural origin",0.9996],PARAMETER["False easting",500000],)"
      R"(PARAMETER["False northing",0]],CS[Cartesian,3],AXIS["x",east],AXIS["y",north],)"
      R"(AXIS["h",up],LENGTHUNIT["metre",1]])";
  const Vec3 at = Geodetic(gnss_of("", std::nullopt), map, kAnywhere).in_site({48, 9.5, 500});
  EXPECT_LT((at.head<2>() - utm(48, 0.5)).norm(), 1e-5);
  EXPECT_NEAR(at.z(), 500, 1e-6);
  EXPECT_EQ(refusal(gnss_of("", 47.1), map),
            "heights in the site's CRS, UTM 32 and heights, are above the ellipsoid; remove "
            "'geoid'");
}

/// PROJ's own choice without these grids would leave out the height of the geoid, or two metres.
TEST(Geodetic, AGridThatIsNotInstalledIsNamed) {
  EXPECT_THAT(refusal(gnss_of("EPSG:32632+7837", std::nullopt)),
              testing::MatchesRegex("PROJ lacks the grid .*2016.* for the way from EPSG:4979 to "
                                    "EPSG:32632.7837; install it, or give another 'crs' or "
                                    "'geoid'"));
  EXPECT_THAT(refusal(gnss_of("EPSG:27700")), HasSubstr("PROJ lacks the grid uk_os_OSTN15"));
}

TEST(Geodetic, PlacesThatCantBeAreRefused) {
  const Geodetic geodetic(gnss_of("EPSG:32632"), "", kAnywhere);
  const auto said = [&](const GeodeticPlace& place) -> std::string {
    try {
      geodetic.in_site(place);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "nothing thrown";
  };
  EXPECT_EQ(said({90.5, 9, 0}), "'lat' is 90.5; it must be from -90 to 90 degrees");
  EXPECT_EQ(said({NAN, 9, 0}), "'lat' is nan; it must be from -90 to 90 degrees");
  EXPECT_EQ(said({48, 360, 0}), "'lon' is 360; it must be from -180 to below 360 degrees");
  EXPECT_EQ(said({48, -181, 0}), "'lon' is -181; it must be from -180 to below 360 degrees");
  EXPECT_EQ(said({48, 9, 1e7}), "'height' is 10000000; it must be within 10000 m");
  EXPECT_EQ(said({48, 9, 0}), "nothing thrown");
  EXPECT_EQ(said({0, 99, 0}),
            "PROJ can't transform latitude 0, longitude 99: Point outside of projection domain");
}

TEST(Geodetic, AGridOfOtherThingsIsNoGeoid) {
  const test::TempFolder folder;
  Gnss gnss = gnss_of("EPSG:32632", std::nullopt);
  gnss.geoid =
      folder.write("ground.gtx", gtx(47, 8, 0.25, 9, 9, [](double, double) { return 430.; }))
          .string();
  EXPECT_THROW(Geodetic(gnss, "", kAnywhere).in_site({48, 9, 500}), std::invalid_argument);
}

TEST(Geodetic, ALineThatIsUprightTellsNoHeading) {
  const std::vector<Vec3> mounted_m = {{0, 0.9, 3}, {0, -0.9, 3}},
                          upright_m = {{0, 0, 3}, {0, 0, 1.2}};
  EXPECT_THROW(pose_of_antennas(mounted_m, upright_m, Vec3::UnitZ()), std::invalid_argument);
  EXPECT_THROW(pose_of_antennas(mounted_m, mounted_m, Vec3::UnitY()), std::invalid_argument);
}

}  // namespace geodetic_test
}  // namespace soilvdb::io
