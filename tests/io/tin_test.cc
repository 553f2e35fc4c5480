// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Surfaces of design programs: heights of triangles known in closed form, units, CRSs, refusals.
#include "io/terrain/tin.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "io/terrain/crs.h"
#include "soilvdb/io/checksum.h"
#include "tests/io/landxml_fixture.h"
#include "tests/support/raster_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace tin_test {

using test::TempFolder;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Heights are floats, and places on a face are known to 1e-6 m.
constexpr double kRoundingOfFloat = 6e-8;

std::string surface_of(const Tin& tin, const std::string& name = "pit", double unit_m = 1) {
  std::string text = fmt::format("<Surface name='{}'><Definition surfType='TIN'><Pnts>\n", name);
  for (std::size_t i = 0; i < tin.points.size(); ++i) {
    const Vec3 p = tin.points[i] / unit_m;
    text += fmt::format("<P id='{}'>{} {} {}</P>\n", 7 * i + 3, p.y(), p.x(), p.z());
  }
  text += "</Pnts><Faces>\n";
  for (const auto& [a, b, c] : tin.faces)
    text += fmt::format("<F>{} {} {}</F>\n", 7 * a + 3, 7 * b + 3, 7 * c + 3);
  return text + "</Faces></Definition></Surface>\n";
}

std::string landxml(const std::string& surfaces, const std::string& head = test::kMetric) {
  return test::landxml("<Surfaces>\n" + surfaces + "</Surfaces>", head);
}

/// A square of 20 m with a peak or pit in its middle: four faces.
Tin pyramid(const Vec2& corner = {500000, 5400000}, double top_m = 10, double depth_m = 5) {
  Tin tin;
  for (const Vec3& p : {Vec3(0, 0, top_m), Vec3(20, 0, top_m), Vec3(20, 20, top_m),
                        Vec3(0, 20, top_m), Vec3(10, 10, top_m - depth_m)})
    tin.points.emplace_back(p + Vec3(corner.x(), corner.y(), 0));
  tin.faces = {{0, 1, 4}, {2, 1, 4}, {2, 3, 4}, {0, 3, 4}};  // in both turns
  return tin;
}

/// A random TIN over a rectangle: a grid whose inner points are moved, with heights by a function,
/// its points and faces in random order.
Tin random_tin(unsigned seed, const std::function<double(const Vec2&)>& height) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(0, 1);
  const int nx = 5 + int(random() % 20), ny = 5 + int(random() % 20);
  const Vec2 corner(1e6 * any(random), 6e6 * any(random)),
      cell(0.3 + any(random), 0.3 + any(random));
  std::vector<Vec3> points;
  for (int j = 0; j < ny; ++j) {
    for (int i = 0; i < nx; ++i) {
      Vec2 move(0, 0);  // of less than half: faces keep their turn
      if (i > 0 && i < nx - 1) move.x() = 0.45 * (any(random) - 0.5);
      if (j > 0 && j < ny - 1) move.y() = 0.45 * (any(random) - 0.5);
      const Vec2 at = corner + cell.cwiseProduct(Vec2(i, j) + move);
      points.emplace_back(at.x(), at.y(), height(at - corner));
    }
  }
  std::vector<std::uint32_t> order(points.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  std::shuffle(order.begin(), order.end(), random);
  Tin tin;
  tin.points.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) tin.points[order[i]] = points[i];
  for (int j = 0; j + 1 < ny; ++j) {
    for (int i = 0; i + 1 < nx; ++i) {
      const auto at = [&](int x, int y) {
        return order[std::size_t(j + y) * std::size_t(nx) + std::size_t(i + x)];
      };
      if (random() % 2 == 0) {
        tin.faces.push_back({at(0, 0), at(1, 0), at(1, 1)});
        tin.faces.push_back({at(0, 1), at(0, 0), at(1, 1)});
      } else {
        tin.faces.push_back({at(0, 0), at(0, 1), at(1, 0)});
        tin.faces.push_back({at(1, 1), at(1, 0), at(0, 1)});
      }
    }
  }
  std::shuffle(tin.faces.begin(), tin.faces.end(), random);
  return tin;
}

template <typename F>
void for_posts(const RasterInput& surface, const F& f) {
  const std::vector<float> heights = all_of(surface);
  const HeightGrid& grid = surface.grid;
  for (int j = 0; j < grid.ny; ++j)
    for (int i = 0; i < grid.nx; ++i)
      f(Vec2(grid.first + grid.spacing.cwiseProduct(Vec2(i, j))),
        heights[std::size_t(j) * std::size_t(grid.nx) + std::size_t(i)]);
}

TEST(Tin, PostsOfARandomTinOfAPlaneAreThePlane) {
  const TempFolder folder;
  for (unsigned seed = 0; seed < 10; ++seed) {
    const Vec2 slope(0.1 * seed - 0.4, 0.3 - 0.07 * seed);
    const auto plane = [&](const Vec2& p) { return 250 + slope.dot(p); };
    const Tin tin = random_tin(seed, plane);
    const RasterInput surface = open_raster(folder.write("a.xml", landxml(surface_of(tin))));
    EXPECT_THAT(surface.warnings, IsEmpty());
    Vec2 corner = tin.points[0].head<2>();
    for (const Vec3& p : tin.points) corner = corner.cwiseMin(p.head<2>());
    EXPECT_LT((surface.grid.first - corner).norm(), 1e-9);
    // To the last post the rectangle is covered.
    for_posts(surface, [&](const Vec2& at, float z) {
      ASSERT_NEAR(z, plane(at - corner), 260 * kRoundingOfFloat + 1e-6) << seed;
    });
  }
}

/// The height of a face by its plane's equation, if the place is in it by the areas of three parts.
void raise(const Vec3& a, const Vec3& b, const Vec3& c, const Vec2& at, double& highest) {
  const auto area = [](const Vec2& p, const Vec2& q, const Vec2& r) {
    return std::abs((q.x() - p.x()) * (r.y() - p.y()) - (q.y() - p.y()) * (r.x() - p.x()));
  };
  const Vec2 p = a.head<2>(), q = b.head<2>(), r = c.head<2>();
  if (area(p, q, at) + area(q, r, at) + area(r, p, at) > area(p, q, r) * (1 + 1e-6)) return;
  const Vec3 normal = (b - a).cross(c - a);
  const double z = a.z() - normal.head<2>().dot(at - p) / normal.z();
  if (!(highest >= z)) highest = z;
}

TEST(Tin, PostsOfARandomSurfaceAreThoseOfItsFaces) {
  const TempFolder folder;
  for (unsigned seed = 20; seed < 23; ++seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> any(0, 0.5);
    const Tin tin = random_tin(seed, [&](const Vec2&) { return any(random); });
    const RasterInput surface = open_raster(folder.write("a.xml", landxml(surface_of(tin))));
    EXPECT_THAT(surface.warnings, IsEmpty());
    std::size_t n = 0;
    for_posts(surface, [&](const Vec2& at, float z) {
      if (++n % 997 != 0) return;
      double truth = std::nan("");
      for (const auto& [a, b, c] : tin.faces)
        raise(tin.points[a], tin.points[b], tin.points[c], at, truth);
      ASSERT_NEAR(z, truth, 1e-5);
    });
  }
}

TEST(Tin, APitHasItsHeightsAndVolume) {
  const TempFolder folder;
  const RasterInput pit = open_raster(folder.write("a.xml", landxml(surface_of(pyramid()))));
  EXPECT_EQ(pit.driver, "LandXML");
  EXPECT_EQ(pit.grid.nx, 641) << "posts 1/32 m apart";
  double volume_m3 = 0;
  for_posts(pit, [&](const Vec2& at, float z) {
    const Vec2 from = (at - Vec2(500010, 5400010)).cwiseAbs();
    ASSERT_NEAR(z, 10 - 5 * (1 - from.maxCoeff() / 10), 1e-6);
    volume_m3 += (10 - z) * pit.grid.spacing.prod();
  });
  // By the trapezium rule, as between bilinear posts; at folds the error is a sixth of the spacing
  // squared times the change of slope, 4 of 14 m.
  EXPECT_NEAR(volume_m3, 20.0 * 20 * 5 / 3, 4 * 14.2 / 32 / 32);
}

TEST(Tin, WindowsAreThePartsOfTheWhole) {
  const TempFolder folder;
  std::mt19937 random(5);
  std::normal_distribution<double> any(0, 0.5);
  Tin tin = random_tin(6, [&](const Vec2&) { return any(random); });
  tin.faces.resize(tin.faces.size() / 2);  // and holes between
  const RasterInput surface = open_raster(folder.write("a.xml", landxml(surface_of(tin))));
  const std::vector<float> whole = all_of(surface);
  const auto below = [&](int n) { return static_cast<int>(random() % unsigned(n)); };
  for (int n = 0; n < 5000; ++n) {
    const int x0 = below(surface.grid.nx), nx = 1 + below(std::min(4, surface.grid.nx - x0));
    const int y0 = below(surface.grid.ny), ny = 1 + below(std::min(9, surface.grid.ny - y0));
    std::vector<float> window(std::size_t(nx) * std::size_t(ny)), wanted;
    surface.source->read(x0, y0, nx, ny, window.data());
    for (int j = y0; j < y0 + ny; ++j)
      for (int i = x0; i < x0 + nx; ++i)
        wanted.push_back(whole[std::size_t(j) * std::size_t(surface.grid.nx) + std::size_t(i)]);
    ASSERT_THAT(window, ::testing::Pointwise(::testing::NanSensitiveFloatEq(), wanted));
  }
}

TEST(Tin, UnitsAreTheirLengths) {
  const TempFolder folder;
  const auto row = [&](const std::string& linear, double unit_m, const std::string& heights,
                       double height_unit_m) {
    Tin tin = pyramid({0, 0});
    for (Vec3& p : tin.points) p.z() *= unit_m / height_unit_m;
    const RasterInput surface = open_raster(folder.write(
        "a.xml", landxml(surface_of(tin, "pit", unit_m),
                         fmt::format("<Units><Metric linearUnit='{}'{}/></Units>", linear,
                                     heights.empty() ? "" : " elevationUnit='" + heights + "'"))));
    EXPECT_NEAR(surface.grid.spacing.x(), 1.0 / 32, 1e-9) << linear;
    std::vector<float> out(std::size_t(surface.grid.nx));
    surface.source->read(0, 200, surface.grid.nx, 1, out.data());
    return out;
  };
  const std::vector<float> metres = row("meter", 1, "", 1);
  constexpr double kSurveyFoot_m = 1200.0 / 3937;
  for (const auto& [name, unit_m] :
       {std::pair("millimeter", 0.001), std::pair("centimeter", 0.01), std::pair("kilometer", 1e3),
        std::pair("foot", 0.3048), std::pair("USSurveyFoot", kSurveyFoot_m),
        std::pair("inch", 0.0254), std::pair("mile", 1609.344)}) {
    const auto near = ::testing::Pointwise(::testing::FloatNear(2e-6F), metres);
    EXPECT_THAT(row(name, unit_m, "", unit_m), near) << name;
    EXPECT_THAT(row("meter", 1, name, unit_m), near) << name;
    const bool survey = unit_m == kSurveyFoot_m;
    EXPECT_THAT(row(name, unit_m, "feet", survey ? kSurveyFoot_m : 0.3048), near) << name;
    EXPECT_THAT(row(name, unit_m, "miles", 1609.344), near) << name;
  }
}

TEST(Tin, PostsAreAsNearAsMemoryLetsThem) {
  const TempFolder folder;
  constexpr double kMost = 1 << 24;
  for (const Vec2& size : {Vec2(100, 20), Vec2(20, 2000), Vec2(3000, 3000), Vec2(1e8, 0.5)}) {
    Tin tin;
    tin.points = {{0, 0, 1}, {size.x(), 0, 1}, {size.x(), size.y(), 1}};
    tin.faces = {{0, 1, 2}};
    const RasterInput surface = open_raster(folder.write("a.xml", landxml(surface_of(tin))));
    const double posts = double(surface.grid.nx) * surface.grid.ny;
    const double apart_m = surface.grid.spacing.maxCoeff();
    EXPECT_LE(posts, kMost);
    EXPECT_TRUE(posts > kMost / 5 || apart_m <= 1.0 / 32 + 1e-9) << size.transpose();
    EXPECT_EQ(surface.warnings.size(), apart_m > 1) << size.transpose();
  }
}

TEST(Tin, FeetAreMetres) {
  const TempFolder folder;
  const RasterInput metres = open_raster(folder.write("m.xml", landxml(surface_of(pyramid()))));
  const std::vector<float> wanted = all_of(metres);
  for (const auto& [name, unit_m] :
       {std::pair{"USSurveyFoot", 1200.0 / 3937}, std::pair{"foot", 0.3048}}) {
    const RasterInput feet = open_raster(folder.write(
        "f.xml",
        landxml(
            surface_of(pyramid(), "pit", unit_m),
            fmt::format("<Units><Imperial linearUnit='{}' elevationUnit='feet'/></Units>", name))));
    EXPECT_LT((feet.grid.first - metres.grid.first).norm(), 1e-8) << name;
    EXPECT_THAT(all_of(feet), ::testing::Pointwise(::testing::FloatNear(2e-6F), wanted)) << name;
  }
}

TEST(Tin, ACrsInFeetIsThatOfItsMetres) {
  const TempFolder folder;
  const auto crs_of = [&](const std::string& unit, const std::string& crs, double unit_m,
                          const Vec2& corner = {2000000, 650000}) {
    const auto file = folder.write(
        "a.xml", landxml(surface_of(pyramid(corner), "pit", unit_m),
                         "<Units><Imperial linearUnit='" + unit + "'/></Units>" + crs));
    return open_raster(file).crs_wkt;
  };
  const std::string feet =
      crs_of("USSurveyFoot", "<CoordinateSystem epsgCode='2227'/>", 1200.0 / 3937);
  const std::string metres = crs_of("meter", "<CoordinateSystem epsgCode='EPSG:26943'/>", 1);
  EXPECT_EQ(crs_label(metres), "EPSG:26943");
  EXPECT_THAT(crs_differences("a", feet, "b", metres), IsEmpty());
  EXPECT_EQ(crs_label(feet), "NAD83 / California zone 3 (ftUS), in metres");
  const auto both = [&](const std::string& unit, const std::string& codes, double unit_m) {
    return crs_of(unit, "<CoordinateSystem epsgCode='" + codes + "'/>", unit_m);
  };
  const std::string high = both("USSurveyFoot", "2227+5703", 1200.0 / 3937);
  EXPECT_EQ(crs_label(high), "NAD83 / California zone 3 (ftUS), in metres + NAVD88 height");
  EXPECT_THAT(crs_differences("a", high, "b", both("meter", " EPSG:26943 + 5703\n", 1)), IsEmpty());
  EXPECT_THAT(crs_differences("a", high, "b", metres), ElementsAre(HasSubstr("heights of a")));
  EXPECT_EQ(crs_label(crs_of("meter", fmt::format("<CoordinateSystem ogcWktCode='{}'/>", kUtm17), 1,
                             {500000, 5400000})),
            "EPSG:32617");
  const auto refused = [&](const std::string& unit, const std::string& crs) {
    return test::message_of(folder, [&] { crs_of(unit, crs, 1); });
  };
  EXPECT_THAT(refused("foot", "<CoordinateSystem epsgCode='2227'/>"),
              AllOf(HasSubstr("in 'foot', but the unit of its CRS EPSG:2227 is 'US survey foot'"),
                    HasSubstr("export")));
  EXPECT_THAT(refused("meter", "<CoordinateSystem epsgCode='4326'/>"), HasSubstr("no map's CRS"));
  EXPECT_THAT(refused("meter", "<CoordinateSystem epsgCode='3857'/>"), HasSubstr("true to scale"));
  EXPECT_THAT(refused("furlong", ""), HasSubstr("the unit 'furlong' is not known"));
}

std::string change(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, text.npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(Tin, HolesAndInvisibleFacesHaveNoHeight) {
  const TempFolder folder;
  const std::string text = landxml(surface_of(pyramid()));
  for (const std::string& open : {change(text, "<F>3 10 31</F>", "<F i='1'>3 10 31</F>"),
                                  change(text, "<F>3 10 31</F>", "")}) {
    const RasterInput pit = open_raster(folder.write("a.xml", open));
    EXPECT_THAT(pit.warnings, IsEmpty());
    for_posts(pit, [&](const Vec2& at, float z) {
      const Vec2 from = at - Vec2(500010, 5400010);
      const double inside_m = -from.y() - std::abs(from.x());
      if (std::abs(inside_m) < 1e-5) return;
      ASSERT_EQ(std::isnan(z), inside_m > 0) << from.transpose();
    });
  }
}

TEST(Tin, DoubtfulFacesAreTold) {
  const TempFolder folder;
  const auto told = [&](Tin tin) {
    return open_raster(folder.write("a.xml", landxml(surface_of(tin)))).warnings;
  };
  Tin twice = pyramid();
  twice.faces.push_back({1, 4, 0});
  EXPECT_THAT(told(twice), IsEmpty()) << "the same face again";
  Tin walled = pyramid();
  walled.points.emplace_back(walled.points[0] + Vec3(0, 0, 3));
  walled.faces.push_back({0, 1, 5});
  EXPECT_THAT(told(walled), ElementsAre(HasSubstr("a.xml: a face is vertical")));
  Tin folded = pyramid();  // a face without any area in space, along an edge
  folded.points.emplace_back((folded.points[0] + folded.points[4]) / 2);
  folded.faces.push_back({0, 4, 5});
  EXPECT_THAT(told(folded), IsEmpty());
  for (const auto& [width_m, count] : {std::pair(0.0005, 0U), std::pair(0.005, 1U)}) {
    Tin splinter = pyramid();
    for (const Vec3& p : {Vec3(0, 0, 1), Vec3(2, 0, 1), Vec3(1, width_m, 1)})
      splinter.points.emplace_back(splinter.points[4] + p);
    splinter.faces.push_back({5, 6, 7});
    EXPECT_EQ(told(splinter).size(), count) << width_m;
  }
  Tin heap = pyramid();
  heap.points.emplace_back(heap.points[4] + Vec3(0, 0, 2));
  heap.faces.push_back({0, 1, 5});
  EXPECT_THAT(told(heap), ElementsAre(AllOf(
                              HasSubstr("lie over one another"), HasSubstr("500010.00, 5400010.00"),
                              HasSubstr("heights 5.000 and 7.000 m; the highest is taken"))));
  for_posts(open_raster(folder / "a.xml"), [&](const Vec2& at, float z) {
    const Vec2 from = at - Vec2(500010, 5400010);
    if (-from.y() < std::abs(from.x()) + 1e-5) return;
    ASSERT_NEAR(z, 10 - 3 * (1 + from.y() / 10), 1e-6);
  });
  EXPECT_THAT(open_raster(folder.write("a.xml", landxml(surface_of(pyramid()), ""))).warnings,
              ElementsAre(HasSubstr("gives no Units; its coordinates are taken as metres")));
}

TEST(Tin, LongFacesSideBySideAreASurface) {
  const TempFolder folder;
  constexpr int kFaces = 3000;  // of a round tank's floor
  Tin floor;
  floor.points.emplace_back(0, 0, 2);
  for (int i = 0; i < kFaces; ++i) {
    const double angle = 2 * std::numbers::pi * i / kFaces;
    floor.points.emplace_back(5 * std::cos(angle), 5 * std::sin(angle), 1);
    floor.faces.push_back({0, std::uint32_t(i + 1), std::uint32_t((i + 1) % kFaces + 1)});
  }
  const RasterInput surface = open_raster(folder.write("a.xml", landxml(surface_of(floor))));
  EXPECT_THAT(surface.warnings, IsEmpty());
  for_posts(surface, [](const Vec2& at, float z) {
    if (at.norm() > 4.999) return;
    ASSERT_NEAR(z, 2 - at.norm() / 5, 1e-5);
  });
}

TEST(Tin, AFaceThatIsNearlyVerticalReachesNoFartherThanItsCorners) {
  const TempFolder folder;
  Tin tin;
  tin.points = {{0, 0, 5},        {10, 0, 5},        {10, 10, 5},         {0, 10, 5},
                {5 + 5e-7, 0, 5}, {5 + 5e-7, 10, 5}, {5 + 3.5e-6, 5, -95}};
  tin.faces = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}};
  for_posts(open_raster(folder.write("a.xml", landxml(surface_of(tin)))),
            [](const Vec2& at, float z) { ASSERT_NEAR(z, 5, 1e-5) << at.transpose(); });
}

TEST(Tin, PostsInAGapOfRoundingHaveHeights) {
  const TempFolder folder;
  Tin tin;
  tin.points = {{0, 0, 5},        {5 - 5e-7, 0, 5}, {5 - 5e-7, 10, 5}, {0, 10, 5},
                {5 + 5e-7, 0, 5}, {10, 0, 5},       {10, 10, 5},       {5 + 5e-7, 10, 5}};
  tin.faces = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
  for_posts(open_raster(folder.write("a.xml", landxml(surface_of(tin)))),
            [](const Vec2& at, float z) { ASSERT_EQ(z, 5) << at.transpose(); });
}

TEST(Tin, CornersWithoutAHeightAndFacesFarAwayAreTold) {
  const TempFolder folder;
  const std::string good = landxml(surface_of(pyramid()));
  for (const char* none : {"-9999", "-99999.0", "-32768"}) {
    const RasterInput pit = open_raster(folder.write(
        "a.xml", change(good, "5400000 500020 10<", std::string("5400000 500020 ") + none + "<")));
    EXPECT_THAT(pit.warnings, ElementsAre(HasSubstr("2 faces with a corner at -9999")));
  }
  Tin stray = pyramid();
  for (const Vec3& p : {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0)}) stray.points.push_back(p);
  stray.faces.push_back({5, 6, 7});
  EXPECT_THAT(
      open_raster(folder.write("a.xml", landxml(surface_of(stray)))).warnings,
      ElementsAre(AllOf(HasSubstr("faces span 500020 m x 5400020 m"), HasSubstr("m apart"))));
}

TEST(Tin, PointsMayHaveTagsWithin) {
  const TempFolder folder;
  const std::string good = landxml(surface_of(pyramid()));
  const auto heights_of = [&](const std::string& text) {
    return all_of(open_raster(folder.write("a.xml", text)));
  };
  const std::string point = "5400010 500010 5";
  EXPECT_EQ(heights_of(change(good, point, point + "<Feature code='x'/>")), heights_of(good));
  EXPECT_EQ(heights_of(change(good, point, "5400010 <Feature>7</Feature>500010 5")),
            heights_of(good));
}

TEST(Tin, OtherPartsOfAFileAreNotOfItsSurface) {
  const TempFolder folder;
  const std::string good = landxml(surface_of(pyramid()));
  const std::vector<float> wanted = all_of(open_raster(folder.write("a.xml", good)));
  const std::string crs = "<CoordinateSystem epsgCode='25832'/>";
  for (const std::string& text :
       {change(good, "<Pnts>", "<Watersheds><P id='3'>1 2 3</P></Watersheds><Pnts>"),
        change(good, "<Surfaces>", "<Monuments>" + crs + "</Monuments><Surfaces>"),
        change(good, "<F>3 10 31</F>", "<F>\n 3\t10\r\n31\n</F>"),
        change(change(good, "<LandXML xmlns=", "<a:LandXML xmlns:a="), "</LandXML",
               "</a:LandXML")}) {
    const RasterInput surface = open_raster(folder.write("a.xml", text));
    EXPECT_THAT(surface.warnings, IsEmpty());
    EXPECT_EQ(surface.crs_wkt, "");
    EXPECT_EQ(all_of(surface), wanted);
  }
}

TEST(Tin, OneOfSeveralSurfacesIsNamed) {
  const TempFolder folder;
  const auto file = folder.write("a.xml", landxml(surface_of(pyramid(), "as built") +
                                                  surface_of(pyramid({0, 0}, 3), "Sub#1")));
  EXPECT_THAT(refusal(folder, file),
              HasSubstr("has 2 surfaces, 'as built' and 'Sub#1'; name one, as in a.xml#as built"));
  EXPECT_THAT(refusal(folder, file.string() + "#sub"),
              HasSubstr("has no surface 'sub', but 'as built' and 'Sub#1'; name one"));
  EXPECT_EQ(open_raster(file.string() + "#Sub#1").grid.first, Vec2(0, 0));
  EXPECT_EQ(open_raster(file.string() + "#as built").grid.first, Vec2(500000, 5400000));
  EXPECT_NE(file_fingerprint(file.string() + "#Sub#1"),
            file_fingerprint(file.string() + "#as built"))
      << "they are different terrain";
  EXPECT_THAT(refusal(folder, folder / "b.xml#a"), HasSubstr("b.xml: no such file"));
  EXPECT_THAT(refusal(folder, file.string() + "#2"), HasSubstr("has no surface '2'"))
      << "it may be the name in a former file";
  std::string many;
  for (const auto& [name, x] : {std::pair{"road", 1}, {"", 2}, {"pit", 3}, {"road", 4}, {"2", 5}})
    many += surface_of(pyramid({double(x), 0}), name);
  const auto twice = folder.write("c.xml", landxml(many));
  for (const auto& [part, x] : {std::pair{"pit", 3}, {"1", 1}, {"4", 4}, {"2", 5}})
    EXPECT_EQ(open_raster(twice.string() + "#" + part).grid.first.x(), x) << part;
  EXPECT_THAT(refusal(folder, twice),
              HasSubstr("has 5 surfaces, 'road', '', 'pit', 'road' and '2'; name one, or give the "
                        "number of one without a name of its own, as in c.xml#1"));
  EXPECT_THAT(refusal(folder, twice.string() + "#road"), HasSubstr("has several surfaces 'road'"));
  for (const char* part : {"#3", "#0", "#6"})
    EXPECT_THAT(refusal(folder, twice.string() + part), HasSubstr("has no surface"));
  folder.write("a.xml#a.xml", landxml(surface_of(pyramid({5, 6}))));
  EXPECT_EQ(open_raster(folder / "a.xml#a.xml").grid.first, Vec2(5, 6)) << "a file's own name";
}

TEST(Tin, EncodingsOfLandXmlAreRead) {
  const TempFolder folder;
  const auto corner_of = [&](const std::string& encoding, const std::string& name) {
    const auto file = folder.write(
        "a.xml",
        change(landxml(surface_of(pyramid({7, 8}), name) + surface_of(pyramid({0, 0}), "a")),
               "version='1.0'", "version='1.0' encoding='" + encoding + "'"));
    return Vec2(open_raster(file.string() + "#B\u00f6schung \u0141").grid.first);
  };
  EXPECT_EQ(corner_of("UTF-8", "B\u00f6schung \u0141"), Vec2(7, 8));
  EXPECT_EQ(corner_of("windows-1250", "B\xf6schung \xa3"), Vec2(7, 8));
  EXPECT_THAT(
      refusal(folder, folder.write("a.xml", "<?xml version='1.0' encoding='no such'?><a/>")),
      HasSubstr("isn't well-formed XML"));
  EXPECT_THAT(
      refusal(folder, folder.write("a.xml", "<?xml version='1.0' encoding='no-such'?><a/>")),
      HasSubstr("isn't well-formed XML (unknown encoding)"));
}

TEST(Tin, WrongFilesAreRefusedInOneLine) {
  const TempFolder folder;
  const std::string good = landxml(surface_of(pyramid()));
  const auto said = [&](const std::string& text) {
    return refusal(folder, folder.write("a.xml", text));
  };
  EXPECT_EQ(said(good), "accepted");
  EXPECT_THAT(said(""), HasSubstr("isn't well-formed XML"));
  EXPECT_THAT(said(good.substr(0, good.size() / 2)), HasSubstr("isn't well-formed XML"));
  EXPECT_THAT(said("<kml/>"), HasSubstr("a.xml:1: is XML of a 'kml', not of LandXML"));
  EXPECT_THAT(said(landxml("")), HasSubstr("has no surface of triangles (TIN)"));
  EXPECT_THAT(said(change(good, "surfType='TIN'", "surfType='grid'")), HasSubstr("has no surface"));
  EXPECT_THAT(said(change(good, "<F>3 10 31</F>", "<F>3 10 32</F>")),
              HasSubstr("a.xml:11: there is no point '32' of this face"));
  EXPECT_THAT(said(change(good, "<F>3 10 31</F>", "<F>3 10</F>")), HasSubstr("2 points; 3 are"));
  EXPECT_THAT(said(change(good, "id='10'", "id='3'")), HasSubstr("there are two points '3'"));
  EXPECT_THAT(said(change(good, "5400000 500020 10", "5400000 500020")),
              HasSubstr("a.xml:6: point '10' is '5400000 500020'; it must be northing, easting"));
  EXPECT_THAT(said(change(good, "5400000 500020 10", "5400000 nan 10")), HasSubstr("it must be"));
  EXPECT_THAT(said(change(good, "5400010 500010 5", "5400010 500010 200000")),
              HasSubstr("has heights beyond +-100 km"));
  EXPECT_THAT(said(change(good, "5400010 500010 5", "5400010 500010 -200000")),
              HasSubstr("has heights beyond +-100 km"));
  EXPECT_THAT(said(change(good, "<?xml version='1.0'?>",
                          "<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'c'>]>")),
              HasSubstr("has a document type declaration"));
  EXPECT_THAT(said("<LandXML a='" + std::string(3 << 20, ' ') + "'/>"),
              HasSubstr("more than 1 MB"));
  std::string deep = "<LandXML>";
  for (int i = 0; i < 200; ++i) deep += "<a>";
  EXPECT_THAT(said(deep), HasSubstr("has more than 100 tags within each other"));
  Tin flat = pyramid();
  flat.faces.clear();
  EXPECT_THAT(said(landxml(surface_of(flat))), HasSubstr("has 5 points and no visible faces"));
  flat.faces.assign(200, {0, 1, 2});
  EXPECT_THAT(said(landxml(surface_of(flat))), HasSubstr("too many faces over one another"));
  flat.faces = {{0, 0, 1}};
  EXPECT_THAT(said(landxml(surface_of(flat))), HasSubstr("no face with an area seen from above"));
}

std::string groups(std::initializer_list<std::pair<int, std::string>> all) {
  std::string text;
  for (const auto& [code, value] : all) text += fmt::format("{}\n{}\n", code, value);
  return text;
}

std::string corner(int n, const Vec3& p) {
  std::string text;
  for (int axis = 0; axis < 3; ++axis)
    text += fmt::format("{}\n{}\n", 10 * (axis + 1) + n, p[axis]);
  return text;
}

std::string face(const std::string& layer, const std::vector<Vec3>& corners) {
  std::string text = groups({{0, "3DFACE"}, {8, layer}});
  for (int i = 0; i < 4; ++i)
    text += corner(i, corners[std::min<std::size_t>(std::size_t(i), corners.size() - 1)]);
  return text;
}

/// @param block entities of a block "part"
std::string dxf(const std::string& entities, const std::string& unit,
                const std::string& block = "") {
  return groups({{0, "SECTION"}, {2, "HEADER"}}) +
         (unit.empty() ? "" : groups({{9, "$INSUNITS"}, {70, unit}})) + groups({{0, "ENDSEC"}}) +
         (block.empty()
              ? ""
              : groups({{0, "SECTION"}, {2, "BLOCKS"}, {0, "BLOCK"}, {8, "0"}, {2, "part"}}) +
                    corner(0, Vec3::Zero()) + block + groups({{0, "ENDBLK"}, {0, "ENDSEC"}})) +
         groups({{0, "SECTION"}, {2, "ENTITIES"}}) + entities + groups({{0, "ENDSEC"}, {0, "EOF"}});
}

std::string faces_of(const Tin& tin, double unit_m = 1) {
  std::string text;
  for (const auto& [a, b, c] : tin.faces)
    text += face("top", {tin.points[a] / unit_m, tin.points[b] / unit_m, tin.points[c] / unit_m});
  return text;
}

TEST(Tin, FacesOfADxfAreASurface) {
  const TempFolder folder;
  const std::vector<float> wanted =
      all_of(open_raster(folder.write("a.xml", landxml(surface_of(pyramid())))));
  const auto near = ::testing::Pointwise(::testing::FloatNear(2e-6F), wanted);
  const RasterInput metres = open_raster(folder.write("a.dxf", dxf(faces_of(pyramid()), "6")));
  EXPECT_EQ(metres.driver, "DXF");
  EXPECT_THAT(metres.warnings, IsEmpty());
  EXPECT_THAT(all_of(metres), near);
  EXPECT_THAT(all_of(open_raster(folder.write("a.dxf", dxf(faces_of(pyramid(), 0.3048), "2")))),
              near);
  EXPECT_THAT(open_raster(folder.write("a.dxf", dxf(faces_of(pyramid()), ""))).warnings,
              ElementsAre(HasSubstr("gives no unit ($INSUNITS)")));
  EXPECT_THAT(refusal(folder, folder.write("a.dxf", dxf(faces_of(pyramid()), "20"))),
              HasSubstr("has the unit 20 of $INSUNITS"));
  EXPECT_THAT(refusal(folder, folder.write("a.dxf", dxf("", "6"))), HasSubstr("has no surface"));
  EXPECT_THAT(refusal(folder, folder.write("a.dxf", "rubbish")),
              HasSubstr("a.dxf: is not a readable DXF of text"));
}

TEST(Tin, FacesOfABlockAreWhereItIsInserted) {
  const TempFolder folder;
  const std::vector<float> wanted =
      all_of(open_raster(folder.write("a.xml", landxml(surface_of(pyramid())))));
  const std::string insert = groups({{0, "INSERT"}, {8, "top"}, {2, "part"}});
  Tin part = pyramid({0, 0}, 0), other = pyramid();
  part.faces.resize(2);
  other.faces.erase(other.faces.begin(), other.faces.begin() + 2);
  const RasterInput both = open_raster(folder.write(
      "a.dxf",
      dxf(faces_of(other) + insert + corner(0, {500000, 5400000, 10}), "6", faces_of(part))));
  EXPECT_THAT(both.warnings, IsEmpty());
  EXPECT_THAT(all_of(both), ::testing::Pointwise(::testing::FloatNear(2e-6F), wanted));
}

TEST(Tin, MeshesAndFoursidedFacesOfADxfAreFaces) {
  const TempFolder folder;
  const std::vector<Vec3> square{{0, 0, 1}, {8, 0, 1}, {8, 8, 3}, {0, 8, 3}};
  std::string mesh =
      groups({{0, "POLYLINE"}, {8, "mesh"}, {66, "1"}, {70, "64"}, {71, "4"}, {72, "1"}});
  for (const Vec3& p : square)
    mesh += groups({{0, "VERTEX"}, {8, "mesh"}}) + corner(0, p) + groups({{70, "192"}});
  mesh += groups({{0, "VERTEX"}, {8, "mesh"}}) + corner(0, Vec3::Zero()) +
          groups({{70, "128"}, {71, "1"}, {72, "2"}, {73, "3"}, {74, "4"}, {0, "SEQEND"}});
  const auto file = folder.write("a.dxf", dxf(mesh + face("top", square), "6"));
  EXPECT_THAT(refusal(folder, file), HasSubstr("has 2 surfaces, 'mesh' and 'top'; name one"));
  for (const char* layer : {"#mesh", "#top"}) {
    const RasterInput surface = open_raster(file.string() + layer);
    EXPECT_THAT(surface.warnings, IsEmpty());
    for_posts(surface, [](const Vec2& at, float z) { ASSERT_NEAR(z, 1 + at.y() / 4, 1e-6); });
  }
  std::vector<Vec3> warped = square;
  warped[3].z() = 5;
  EXPECT_THAT(open_raster(folder.write("a.dxf", dxf(face("top", warped), "6"))).warnings,
              ElementsAre(HasSubstr("a face of four corners is not flat; it is folded")));
}

/// A face with no more groups than given, the corners among them.
std::string bare(const std::string& kind, const std::string& layer,
                 const std::vector<Vec3>& corners, const std::string& more = "") {
  std::string text = groups({{0, kind}, {8, layer}}) + more;
  for (std::size_t i = 0; i < corners.size(); ++i) text += corner(int(i), corners[i]);
  return text;
}

TEST(Tin, OnlyVisibleFacesInSpaceOfADxfAreASurface) {
  const TempFolder folder;
  const Tin tin = pyramid();
  const std::vector<float> wanted =
      all_of(open_raster(folder.write("a.xml", landxml(surface_of(tin)))));
  std::string good, others;
  for (const auto& [a, b, c] : tin.faces)
    good += bare("3DFACE", "top", {tin.points[a], tin.points[b], tin.points[c]});
  const std::vector<Vec3> high{Vec3(500000, 5400000, 90), Vec3(500020, 5400000, 90),
                               Vec3(500000, 5400020, 90), Vec3(500020, 5400020, 90)};
  for (const char* kind : {"SOLID", "TRACE", "LEADER"}) others += bare(kind, "top", high);
  others += groups({{0, "POLYLINE"}, {8, "top"}, {60, "1"}, {70, "8"}}) +
            bare("VERTEX", "top", {high[0]}) + groups({{0, "SEQEND"}});
  others += bare("3DFACE", "top", high, groups({{67, "1"}}));
  const std::string hidden = bare("3DFACE", "top", high, groups({{60, "1"}}));
  const std::string insert =
      groups({{0, "INSERT"}, {8, "top"}, {2, "part"}}) + corner(0, Vec3::Zero());
  const auto read = [&](const std::string& text) {
    const RasterInput surface = open_raster(folder.write("a.dxf", text));
    EXPECT_THAT(all_of(surface), ::testing::Pointwise(::testing::FloatNear(2e-6F), wanted));
    return surface.warnings;
  };
  EXPECT_THAT(read(dxf(good + others, "6")), IsEmpty());
  EXPECT_THAT(read(dxf(insert, "6", good + others)), IsEmpty()) << "in a block";
  EXPECT_THAT(read(dxf(others + hidden + good, "6")),
              ElementsAre(HasSubstr("an invisible face, mesh or block (group 60) is left out")));
  EXPECT_THAT(read(dxf(insert + hidden, "6", hidden + good)),
              ElementsAre(HasSubstr("2 invisible faces, meshes or blocks")));
  EXPECT_THAT(refusal(folder, folder.write("a.dxf", dxf(hidden, "6"))),
              HasSubstr("has no visible face (group 60 hides them)"));
  EXPECT_THAT(refusal(folder, folder.write("a.dxf", dxf(others, "6"))),
              HasSubstr("has no surface of triangles"));
}

TEST(Tin, LayersOfADxfAreNamedInItsEncoding) {
  const TempFolder folder;
  const auto named = [&](const std::string& version, const std::string& layer) {
    const std::string two = face("a", {{0, 0, 1}, {8, 0, 1}, {0, 8, 1}}) +
                            face(layer, {{0, 0, 2}, {8, 0, 2}, {0, 8, 2}});
    const auto file = folder.write(
        "a.dxf",
        change(dxf(two, "6"), "HEADER\n", "HEADER\n" + groups({{9, "$ACADVER"}, {1, version}})));
    return all_of(open_raster(file.string() + "#B\u00f6schung"))[0];
  };
  EXPECT_EQ(named("AC1032", "B\u00f6schung"), 2);
  EXPECT_EQ(named("AC1015", "B\xf6schung"), 2);
}

TEST(Tin, WrittenSurfacesAreReadAgain) {
  const TempFolder folder;
  HeightGrid grid = grid_of(40, 30, {500000.25, 5400000.75}, {0.5, 0.25});
  std::mt19937 random(4);
  std::normal_distribution<float> any(300, 1);
  std::vector<float> heights(std::size_t(grid.nx) * std::size_t(grid.ny));
  for (float& z : heights) z = any(random);
  heights[617] = std::nanf("");
  write_landxml(folder / "a.xml", grid, heights, "a \"b\" <c> & d", kUtm17);
  const RasterInput surface = open_raster(folder / "a.xml");
  EXPECT_THAT(surface.warnings, IsEmpty());
  EXPECT_EQ(crs_label(surface.crs_wkt), "EPSG:32617");
  EXPECT_EQ(surface.grid.first, grid.first);
  const int fine_x = 16, fine_y = 8;  // posts 1/32 m apart
  ASSERT_EQ(surface.grid.nx, 1 + fine_x * (grid.nx - 1));
  ASSERT_EQ(surface.grid.ny, 1 + fine_y * (grid.ny - 1));
  const std::vector<float> all = all_of(surface);
  for (int j = 0; j < grid.ny; ++j) {
    for (int i = 0; i < grid.nx; ++i) {
      const float z = heights[std::size_t(j * grid.nx + i)];
      const float again = all[std::size_t(j * fine_y * surface.grid.nx + i * fine_x)];
      EXPECT_EQ(std::isnan(z), std::isnan(again));
      if (std::isnan(z)) continue;
      EXPECT_NEAR(z, again, 5e-5);
    }
  }
  const auto named = read_landxml({folder / "a.xml", "a \"b\" <c> & d"});
  EXPECT_EQ(named.tin.points.size(), heights.size() - 1);
  // One of the two faces is left of each square with a corner without a height.
  EXPECT_EQ(named.tin.faces.size(), 2 * 39 * 29 - 4);
  std::string no_code = kUtm17;
  no_code.replace(no_code.rfind(",AUTHORITY"), no_code.npos, "]");
  write_landxml(folder / "a.xml", grid, heights, "a", no_code);
  EXPECT_EQ(named.epsg, "32617");
  EXPECT_EQ(read_landxml({folder / "a.xml", ""}).epsg, "");
  const RasterInput again = open_raster(folder / "a.xml");
  EXPECT_THAT(again.warnings, IsEmpty());
  EXPECT_EQ(crs_label(again.crs_wkt), crs_label(no_code));
}

}  // namespace tin_test
}  // namespace soilvdb::io
