// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Alignments of LandXML: points on arcs and clothoids known in closed form, profiles, refusals.
#include "io/terrain/alignments.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "io/terrain/crs.h"
#include "io/terrain/design_lines.h"
#include "io/terrain/gdal.h"
#include "soilvdb/io/error.h"
#include "tests/io/landxml_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace alignments_test {

using test::kMetric;
using test::landxml;
using test::TempFolder;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kRounding_m = 1e-6;  // of places of the world, and of numbers in the file

std::string alignment(const std::string& geometry, const std::string& more = "",
                      const std::string& attributes = "name='axis' length='0' staStart='0'") {
  return "<Alignments>\n<Alignment " + attributes + ">\n<CoordGeom>\n" + geometry +
         "</CoordGeom>\n" + more + "</Alignment></Alignments>\n";
}
std::string point(const char* tag, const Vec2& p) {
  return fmt::format("<{0}>{1:.9f} {2:.9f}</{0}>", tag, p.y(), p.x());
}
std::string straight(const Vec2& from, const Vec2& to) {
  return "<Line>" + point("Start", from) + point("End", to) + "</Line>\n";
}
std::string arc(const Vec2& from, const Vec2& centre, const Vec2& to, bool left) {
  return fmt::format("<Curve rot='{}' crvType='arc'>", left ? "ccw" : "cw") + point("Start", from) +
         point("Center", centre) + point("End", to) + "</Curve>\n";
}

Alignments read(const std::string& text) {
  const TempFolder folder;
  return read_alignments(folder.write("road.xml", text));
}
std::string refusal(const std::string& text) {
  const TempFolder folder;
  try {
    read_alignments(folder.write("road.xml", text));
  } catch (const InputError& e) {
    const std::string why = e.what();
    EXPECT_EQ(why.find('\n'), why.npos);
    return why;
  }
  return "accepted";
}

std::string wkt(const char* name) {
  const OwnSrs srs(gdal().OSRNewSpatialReference(nullptr));
  gdal().OSRSetFromUserInput(srs.get(), name);
  return wkt_of(srs.get());
}

Vec2 direction(double angle) { return {std::cos(angle), std::sin(angle)}; }
Vec2 turned(const Vec2& v, double angle) {
  return {v.x() * std::cos(angle) - v.y() * std::sin(angle),
          v.x() * std::sin(angle) + v.y() * std::cos(angle)};
}

/// Where the clothoid of a parameter is after a way from its inflection, which it leaves along x,
/// turning left: the power series of Fresnel's integrals.
Vec2 fresnel(double parameter, double way) {
  const double angle = way * way / (2 * parameter * parameter);
  Vec2 sum(0, 0);
  double term = way;  // way * angle^n / n!
  for (int n = 0; n < 60; ++n) {
    const double part = term / (2 * n + 1);
    (n % 2 == 0 ? sum.x() : sum.y()) += n % 4 < 2 ? part : -part;
    term *= angle / (n + 1);
  }
  return sum;
}

TEST(Alignments, ArcsAreOfTheirCircleAndTurnAsToldAtAnyPlace) {
  const Vec2 centre(500'000, 5'400'000);
  for (const bool left : {false, true})
    for (const double radius : {3.0, 120.0, 4000.0})
      for (const double sweep : {0.3, 2.0, 4.5, 2 * std::numbers::pi}) {
        const double begin = 0.7, side = left ? 1 : -1;
        const auto on = [&](double angle) { return Vec2(centre + radius * direction(angle)); };
        const Alignments made =
            read(landxml(alignment(arc(on(begin), centre, on(begin + side * sweep), left))));
        ASSERT_THAT(made.lines, SizeIs(1));
        const std::vector<Vec3>& line = made.lines[0];
        const auto parts = static_cast<double>(line.size() - 1);
        for (std::size_t i = 0; i < line.size(); ++i) {
          const Vec2 wanted = on(begin + side * sweep * static_cast<double>(i) / parts);
          ASSERT_LT((line[i].head<2>() - wanted).norm(), kRounding_m) << radius << ' ' << sweep;
          EXPECT_TRUE(std::isnan(line[i].z()));
        }
        const double sagitta = radius * (1 - std::cos(sweep / parts / 2));
        EXPECT_LT(sagitta, 1.001 * kMostSagitta_m);
        if (parts > 10) {
          EXPECT_GT(sagitta, kMostSagitta_m / 2);  // no more than it takes
        }
      }
}

// From curvature 1/a to 1/b, either of which may be none; turning either way.
TEST(Alignments, SpiralsAreClothoids) {
  const Vec2 corner(500'000, 5'400'000);
  constexpr double kInf = std::numeric_limits<double>::infinity();
  for (const bool left : {false, true})
    for (const auto& [a, b] : std::vector<std::pair<double, double>>{
             {kInf, 200}, {200, kInf}, {600, 150}, {150, 600}, {kInf, 20}})
      for (const double length : {30.0, 90.0}) {
        // Along a clothoid from its inflection: from way s to way t, against it if s > t.
        const double change = std::abs(1 / b - 1 / a) / length, parameter = 1 / std::sqrt(change);
        const double s = 1 / (a * change), t = 1 / (b * change), along = t > s ? 1 : -1;
        const double side = left ? 1 : -1, heading = 0.9;
        const auto angle_at = [&](double way) { return way * way * change / 2; };
        // Seen backwards it turns to the other side.
        const auto at = [&](double way) {
          Vec2 p = fresnel(parameter, way) - fresnel(parameter, s);
          p = along * turned(p, -angle_at(s));  // its begin along x
          if (side * along < 0) p.y() = -p.y();
          return Vec2(corner + turned(p, heading));
        };
        const Vec2 from = at(s), to = at(t);
        const double turn = side * std::abs(angle_at(t) - angle_at(s));
        // Where the tangents meet: by the sines of the triangle's angles.
        const Vec2 chord = to - from;
        const double between = std::atan2(chord.y(), chord.x()) - heading;
        const double reach =
            chord.norm() * std::sin(turn - between) / std::sin(std::numbers::pi - turn);
        const Vec2 pi = from + reach * direction(heading);
        const bool in_feet = length > 50;
        const double unit = in_feet ? 0.3048 : 1;
        const std::string head = in_feet ? "<Units><Imperial linearUnit='foot'/></Units>" : kMetric;
        const auto radius = [&](double r) {
          return std::isinf(r) ? "INF" : fmt::format("{}", r / unit);
        };
        // Rounded by a centimetre in the file, from which it goes to the point that is told.
        const Vec2 told = to + Vec2(0.01, 0);
        const std::string text = fmt::format(
                                     "<Spiral length='{}' radiusStart='{}' radiusEnd='{}' rot='{}' "
                                     "spiType='clothoid'>",
                                     length / unit, radius(a), radius(b), left ? "ccw" : "cw") +
                                 point("Start", from / unit) + point("PI", pi / unit) +
                                 point("End", told / unit) + "</Spiral>\n";
        const Alignments made = read(landxml(alignment(text), head));
        ASSERT_THAT(made.lines, SizeIs(1));
        const std::vector<Vec3>& line = made.lines[0];
        ASSERT_GT(line.size(), 4u);
        for (std::size_t i = 0; i < line.size(); ++i) {
          const double share = static_cast<double>(i) / static_cast<double>(line.size() - 1);
          const Vec2 wanted = at(s + share * (t - s)) + share * (told - to);
          ASSERT_LT((line[i].head<2>() - wanted).norm(), kRounding_m)
              << a << ' ' << b << ' ' << length << ' ' << share;
        }
        // Of another length it leads elsewhere, and neither is believed.
        const std::string wrong =
            refusal(landxml(alignment(fmt::format("<Spiral length='{}'", (length + 2) / unit) +
                                      text.substr(text.find(" radiusS"))),
                            head));
        EXPECT_THAT(wrong, AllOf(HasSubstr("road.xml:6: a clothoid of this length"),
                                 HasSubstr("m from the spiral's End")));
      }
}

/// A straight from (0, 0) to the east, whose stations begin at 100 m.
std::string with_profile(const std::string& profile, double length = 400) {
  return landxml(alignment(
      straight({0, 0}, {length, 0}),
      "<Profile name='p'><ProfAlign name='design'>\n" + profile + "</ProfAlign></Profile>\n",
      "name='axis' staStart='100'"));
}
double height(const std::vector<Vec3>& line, double x) {
  for (std::size_t i = 1; i < line.size(); ++i)
    if (x >= line[i - 1].x() && x <= line[i].x())
      return line[i - 1].z() + (x - line[i - 1].x()) / (line[i].x() - line[i - 1].x()) *
                                   (line[i].z() - line[i - 1].z());
  return std::numeric_limits<double>::quiet_NaN();
}

// A parabola of grades g and k over the length l: z = g x + (k - g) x^2 / (2 l) from its begin on.
TEST(Alignments, ProfilesGiveHeightsOfTangentsAndParabolas) {
  const Alignments made = read(with_profile(
      "<PVI>100 10</PVI><ParaCurve length='100'>250 13</ParaCurve>"
      "<UnsymParaCurve lengthIn='40' lengthOut='80'>350 8</UnsymParaCurve><PVI>480 8</PVI>\n"));
  ASSERT_THAT(made.lines, SizeIs(1));
  EXPECT_THAT(made.doubts, IsEmpty());
  const std::vector<Vec3>& line = made.lines[0];
  const auto wanted = [](double station) {
    if (station < 200) return 10 + 0.02 * (station - 100);
    if (station < 300) {
      const double x = station - 200;
      return 12 + 0.02 * x - 0.07 * x * x / 200;
    }
    if (station < 310) return 13 - 0.05 * (station - 250);
    // Two parabolas that meet at the intersection, with a common tangent: that between the middles
    // of its tangents. From -5 % to 0 % over 120 m: there the grade is -5 % + 5 % * 80 / 120.
    const double middle = -0.05 + 0.05 * 80 / 120;
    if (station < 350) {
      const double x = station - 310;
      return 10 - 0.05 * x + (middle + 0.05) * x * x / 80;
    }
    const double x = 430 - station;
    return station < 430 ? 8 - middle * x * x / 160 : 8;
  };
  for (double x = 0; x <= 380; x += 0.37)
    ASSERT_NEAR(height(line, x), wanted(100 + x), 1.01 * kMostSagitta_m) << x;
  for (const Vec3& p : line)
    if (p.x() < 380) {
      ASSERT_NEAR(p.z(), wanted(100 + p.x()), kRounding_m) << p.x();
    }
  // Beyond the profile there is no height.
  EXPECT_TRUE(std::isnan(line.back().z()));
  EXPECT_EQ(line.back().x(), 400);
}

TEST(Alignments, VerticalArcsAreOfTheirCircle) {
  for (const double side : {1.0, -1.0}) {
    const double in = -0.04 * side, out = 0.06 * side, radius = 1500;
    const std::vector<Vec3> line =
        read(with_profile(fmt::format("<PVI>100 {}</PVI><CircCurve radius='{}' length='150'>300 20"
                                      "</CircCurve><PVI>500 {}</PVI>\n",
                                      20 - 200 * in, radius, 20 + 200 * out)))
            .lines.at(0);
    // Above or below both tangents by the radius.
    const auto away = [&](double grade) { return side * radius * std::hypot(1, grade); };
    const double x = (away(in) - away(out)) / (out - in);  // from the intersection
    const Vec2 centre(200 + x, 20 + in * x + away(in));
    int on_arc = 0;
    for (const Vec3& p : line) {
      const double to = p.x() - 200, tangent = 20 + to * (to < 0 ? in : out);
      if (std::abs(p.z() - tangent) < 1e-9) continue;
      ++on_arc;
      EXPECT_NEAR(std::hypot(p.x() - centre.x(), p.z() - centre.y()), radius, kRounding_m) << to;
    }
    EXPECT_GT(on_arc, 10);
    EXPECT_NEAR(height(line, centre.x()), centre.y() - side * radius, 1.01 * kMostSagitta_m);
  }
}

TEST(Alignments, HeightsFollowStationsAlongArcs) {
  // 100 m, then a quarter of a circle of 50 m, then back.
  const std::string geometry = straight({0, 0}, {100, 0}) +
                               arc({100, 0}, {100, 50}, {150, 50}, true) +
                               straight({150, 50}, {150, 80});
  const double quarter = 25 * std::numbers::pi;
  const std::vector<Vec3> line =
      read(landxml(alignment(geometry,
                             "<Profile><ProfSurf name='ground'><PntList2D>0 5 9 5"
                             "</PntList2D></ProfSurf><ProfAlign>"
                             "<PVI>0 0</PVI><PVI>1000 100</PVI></ProfAlign></Profile>")))
          .lines.at(0);
  for (const Vec3& p : line) {
    const double turn = std::atan2(p.x() - 100, 50 - p.y());
    const double station = p.y() == 0     ? p.x()
                           : p.x() == 150 ? 100 + quarter + p.y() - 50
                                          : 100 + 50 * turn;
    EXPECT_NEAR(p.z(), station / 10, kRounding_m);
  }
  EXPECT_GT(line.size(), 20u);
}

TEST(Alignments, PointsMayBeNamedAndUnitsBeFeet) {
  const std::string geometry =
      "<Line><Start pntRef='A'/><End pntRef='B'/></Line>\n"
      "<IrregularLine><Start pntRef='B'/><End>30 40 9</End><PntList3D>0 40 6 20 40 7</PntList3D>"
      "</IrregularLine>\n";
  const std::string points =
      "<CgPoints><CgPoint name='A'>0 0 3</CgPoint><CgPoints name='more'>"
      "<CgPoint name='B'>0 40 6</CgPoint><CgPoint name='C' pntRef='A'/></CgPoints></CgPoints>\n";
  const std::string feet = "<Units><Imperial linearUnit='foot' elevationUnit='feet'/></Units>";
  for (const bool before : {false, true}) {
    const std::string lines = alignment(geometry);
    const Alignments made = read(landxml(before ? points + lines : lines + points, feet));
    ASSERT_THAT(made.lines, SizeIs(1));
    const std::vector<Vec3> wanted = {{0, 0, 3}, {40, 0, 6}, {40, 20, 7}, {40, 30, 9}};
    ASSERT_EQ(made.lines[0].size(), wanted.size());
    for (std::size_t i = 0; i < wanted.size(); ++i)
      EXPECT_LT((made.lines[0][i] - 0.3048 * wanted[i]).norm(), 1e-9) << i;
  }
}

// A road of a straight, a clothoid and an arc, with a profile of each kind of curve.
TEST(Alignments, InFeetAreTheSameRoad) {
  const double length = 60, radius = 150, parameter = std::sqrt(length * radius), turn = 0.2;
  const Vec2 begin(20, 0), end = begin + fresnel(parameter, length);
  const double angle = length / (2 * radius);
  const Vec2 pi(end.x() - end.y() / std::tan(angle), 0);
  const Vec2 centre = end + radius * direction(angle + std::numbers::pi / 2);
  const Vec2 last = centre + radius * direction(angle + turn - std::numbers::pi / 2);
  const auto road = [&](double unit, const std::string& head) {
    const auto p = [&](const char* tag, const Vec2& at) { return point(tag, at / unit); };
    return landxml(
        alignment("<Line>" + p("Start", {0, 0}) + p("End", begin) + "</Line>" +
                      fmt::format("<Spiral length='{}' radiusStart='INF' radiusEnd='{}' rot='ccw' "
                                  "spiType='clothoid'>",
                                  length / unit, radius / unit) +
                      p("Start", begin) + p("PI", pi) + p("End", end) + "</Spiral>" +
                      "<Curve rot='ccw'>" + p("Start", end) + p("Center", centre) + p("End", last) +
                      "</Curve>\n",
                  fmt::format("<Profile><ProfAlign><PVI>{} {}</PVI><ParaCurve length='{}'>{} {}"
                              "</ParaCurve><CircCurve radius='{}'>{} {}</CircCurve><PVI>{} {}</PVI>"
                              "</ProfAlign></Profile>",
                              50 / unit, 5 / unit, 10 / unit, 70 / unit, 6 / unit, 300 / unit,
                              110 / unit, 5 / unit, 200 / unit, 9 / unit),
                  fmt::format("name='axis' staStart='{}'", 50 / unit)),
        head);
  };
  const std::vector<Vec3> metres = read(road(1, kMetric)).lines.at(0);
  const std::vector<Vec3> feet =
      read(road(1200.0 / 3937,
                "<Units><Imperial linearUnit='USSurveyFoot' elevationUnit='feet'/></Units>"))
          .lines.at(0);
  ASSERT_EQ(metres.size(), feet.size());
  for (std::size_t i = 0; i < metres.size(); ++i)
    EXPECT_LT((metres[i] - feet[i]).norm(), 2 * kRounding_m) << i;
  EXPECT_LT((metres.back().head<2>() - last).norm(), kRounding_m);
  EXPECT_NEAR(metres[0].z(), 5, kRounding_m);
}

TEST(Alignments, LinesEndWhereGeometryDoesNotGoOn) {
  const Alignments made =
      read(landxml("<PlanFeatures><PlanFeature name='kerb'><CoordGeom>" +
                   straight({0, 0}, {10, 0}) + straight({10, 0}, {20, 5}) +
                   straight({30, 5}, {40, 5}) + "</CoordGeom></PlanFeature></PlanFeatures>"));
  ASSERT_THAT(made.lines, SizeIs(2));
  EXPECT_THAT(made.lines[0], SizeIs(3));
  EXPECT_THAT(made.lines[1], SizeIs(2));
}

TEST(Alignments, AreBroughtToTheSite) {
  const TempFolder folder;
  // A thousand metres to the north of 48 N, 9 E, by the central meridian's scale of UTM.
  const std::string text = landxml(alignment(straight({500'000, 5'316'000}, {500'000, 5'317'000})),
                                   std::string(kMetric) + "<CoordinateSystem epsgCode='25832'/>");
  const auto file = folder.write("road.xml", text);
  const DesignLines same = read_lines(file, wkt("EPSG:25832"));
  ASSERT_THAT(same.lines, SizeIs(1));
  EXPECT_THAT(same.warnings, IsEmpty());
  EXPECT_LT((same.lines[0][1].head<2>() - Vec2(500'000, 5'317'000)).norm(), kRounding_m);
  const DesignLines other = read_lines(file, wkt("EPSG:25833"));
  const Vec2 way = (other.lines[0][1] - other.lines[0][0]).head<2>();
  EXPECT_NEAR(way.norm(), 1000, 5);  // another scale
  EXPECT_GT(std::abs(way.x()), 50);  // six degrees to the west of it the meridians converge
}

TEST(Alignments, WithoutUnitsOrWithMoreProfilesAreTold) {
  const std::string profile =
      "<Profile><ProfAlign name='a'><PVI>0 1</PVI><PVI>9 1</PVI></ProfAlign>"
      "<ProfAlign name='b'><PVI>0 2</PVI><PVI>9 2</PVI></ProfAlign></Profile>";
  const Alignments made = read(landxml(alignment(straight({0, 0}, {9, 0}), profile), ""));
  ASSERT_THAT(made.doubts, SizeIs(2));
  EXPECT_THAT(made.doubts[0], HasSubstr("has 2 profiles; its heights are those of the first, 'a'"));
  EXPECT_THAT(made.doubts[1], HasSubstr("gives no Units"));
  EXPECT_EQ(made.lines[0][0].z(), 1);
}

TEST(Alignments, ThatAreNotSupportedAreRefusedInALine) {
  const std::string spiral =
      "<Spiral length='30' radiusStart='INF' radiusEnd='200' rot='cw' spiType='{}'>"
      "<Start>0 0</Start><PI>0 20</PI><End>0 30</End></Spiral>\n";
  const auto with = [](const std::string& text, const std::string& from, const std::string& to) {
    std::string made = text;
    made.replace(made.find(from), from.size(), to);
    return made;
  };
  const auto of = [](const std::string& geometry) { return refusal(landxml(alignment(geometry))); };
  const auto profile = [](const std::string& rows) { return refusal(with_profile(rows)); };
  const std::string bow = arc({0, 0}, {0, 10}, {10, 10}, true),
                    clothoid = with(spiral, "{}", "clothoid");
  const std::vector<std::pair<std::string, std::string>> all = {
      {of(with(spiral, "{}", "bloss")), "road.xml:6: a spiral of type 'bloss' is not supported"},
      {of(with(clothoid, "'INF'", "'0'")), "road.xml:6: a spiral needs a length, radiusStart"},
      {of(with(clothoid, "'INF'", "'flat'")), "radiusStart is 'flat'; it must be a number"},
      {of(with(clothoid, "'INF'", "'200'")), "the same radius at both ends"},
      {of(with(clothoid, "<PI>0 20</PI>", "")), "road.xml:6: a Spiral has no PI"},
      {of("<Chain>1 2 3</Chain>"), "a 'Chain' of an alignment is not supported"},
      {of(with(bow, "ccw", "left")), "rot of a Curve is 'left'; it must be cw or ccw"},
      {of(arc({0, 0}, {0, 10}, {10, 12}, true)),
       "begins 10.000 m from its Center and ends 10.198 m"},
      {of(with(bow, "<Start>0.000000000 0.000000000", "<Start>0")),
       "Start is '0'; it must be northing"},
      {of("<Line><Start pntRef='A'/><End>0 0</End></Line>"), "there is no point 'A' (CgPoint)"},
      {of("<Line><Start>0 x</Start><End>0 0</End></Line>"), "'x' is no number"},
      {of("<IrregularLine><Start>0 0</Start><End>1 1</End><PntList3D>1 2</PntList3D>"
          "</IrregularLine>"),
       "a list of points has 2 numbers; 3 belong to a point"},
      {refusal(landxml(alignment("<Line><Start pntRef='A'/><End>0 0</End></Line>") +
                       "<CgPoints><CgPoint name='A'>0 1</CgPoint><CgPoint name='A'>5 1</CgPoint>"
                       "</CgPoints>")),
       "there is more than one point 'A'"},
      {refusal(landxml(
           alignment(straight({0, 0}, {9, 0}), "<StaEquation staAhead='0' staInternal='5'/>\n"))),
       "station equations are not supported"},
      {profile("<PVI>0 1</PVI><PVI>0 2</PVI>\n"), "a profile's stations must increase"},
      {profile("<PVI>0 1</PVI><Crest>5 2</Crest>\n"), "a 'Crest' of a profile is not supported"},
      {profile("<PVI>0</PVI>\n"), "a PVI is '0'; it must be station and elevation"},
      {profile("<PVI>0 1</PVI><ParaCurve>5 2</ParaCurve>\n"), "a ParaCurve needs lengths above 0"},
      {profile("<PVI>0 1</PVI><ParaCurve length='90'>30 2</ParaCurve><PVI>60 0</PVI>\n"),
       "reaches over the next one"},
      {refusal(landxml("<ProfAlign><PVI>0 1</PVI></ProfAlign>")), "belongs to no alignment"},
      {refusal(landxml("<CoordGeom><Line/></CoordGeom>")), "belongs to no alignment"},
      {of("<Line><Alignment/></Line>"), "the tag Alignment is within a CoordGeom"},
      {profile("<PVI><Parcel/></PVI>"), "the tag Parcel is within a ProfAlign"},
      {of(with(clothoid, "'200'", "'0.1'")), "a spiral turns more than ten times"},
      {refusal(landxml("<Surfaces/>")), "has no lines (Alignments, PlanFeatures)"},
      {refusal("<kml/>"), "is XML of a 'kml', not of LandXML"},
  };
  for (const auto& [why, said] : all) EXPECT_THAT(why, HasSubstr(said));
}

// A line of a huge arc, or of huge numbers, ends in a line of words.
TEST(Alignments, ProfilesInProfilesAreRefused) {
  for (const char* profile :
       {"<ProfAlign><ProfAlign>1 2</ProfAlign></ProfAlign>",
        "<ProfAlign><PVI>0 1</PVI><PVI><ProfAlign/>10 2</PVI></ProfAlign>",
        "<ProfAlign><PVI>0 1<ProfAlign><PVI>3 4</PVI></ProfAlign></PVI></ProfAlign>"})
    EXPECT_THAT(refusal(landxml(alignment(straight({0, 0}, {20, 0}),
                                          fmt::format("<Profile>{}</Profile>", profile)))),
                HasSubstr("a profile (ProfAlign) in a profile"))
        << profile;
}

TEST(Alignments, PiecesWithoutLengthChangeNothing) {
  const std::string profile =
      "<Profile><ProfAlign><PVI>0 1</PVI><PVI>10 3</PVI><PVI>20 2</PVI></ProfAlign></Profile>";
  const std::string first = straight({0, 0}, {10, 0}), last = straight({10, 0}, {20, 0});
  const Alignments plain = read(landxml(alignment(first + last, profile)));
  for (const double x : {10.0, 10.0000005, 10.000001}) {
    const Alignments made =
        read(landxml(alignment(first + straight({10, 0}, {x, 0}) + last, profile)));
    ASSERT_THAT(made.lines, SizeIs(1));
    for (const Vec3& p : made.lines[0])
      EXPECT_NEAR(p.z(), p.x() < 10 ? 1 + 0.2 * p.x() : 3 - 0.1 * (p.x() - 10), 1e-5);
    EXPECT_NEAR((made.lines[0].back() - plain.lines[0].back()).norm(), 0, 1e-5);
  }
}

TEST(Alignments, OfImpossibleSizesAreRefused) {
  const double far = 9e8;
  EXPECT_THAT(refusal(landxml(alignment(arc({far, 0}, {0, 0}, {-far, 0}, true)))),
              AnyOf(HasSubstr("more than 200000 points"), HasSubstr("must be its radius")));
  EXPECT_THAT(refusal(landxml(alignment("<Line><Start>1e10 0</Start><End>0 0</End></Line>"))),
              HasSubstr("is no number"));
}

}  // namespace alignments_test
}  // namespace soilvdb::io
