// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/alignments.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <unordered_map>
#include <utility>

#include "io/file/text.h"
#include "io/terrain/design_lines.h"
#include "io/terrain/landxml_stream.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
/// How far rounding may take points from each other that should be one, m.
constexpr double kSame_m = 0.05, kNear_m = 1e-6;
constexpr std::size_t kMostText_bytes = 16 << 20;

/// A number of parts of a length of which each chord is near its arc.
double parts_of(double length, double curvature) {
  return std::max(1.0, std::ceil(length * std::sqrt(std::abs(curvature) / (8 * kMostSagitta_m))));
}

/// Where a clothoid leads from (0, 0): its direction begins at `angle`, its curvature changes
/// evenly.
Vec2 clothoid(double angle, double begin_curvature, double change_per_m, double to) {
  // Five points of Gauss and Legendre in parts that turn little: to 1e-12 of the length.
  constexpr double kPlaces[] = {0, 0.5384693101056831, 0.9061798459386640};
  constexpr double kWeights[] = {0.5688888888888889, 0.4786286704993665, 0.2369268850561891};
  constexpr double kMostTurn = 0.5, kMostParts = 1e6;
  const double turn =
      to * std::max(std::abs(begin_curvature), std::abs(begin_curvature + change_per_m * to));
  const double parts = std::clamp(std::ceil(turn / kMostTurn), 1.0, kMostParts);
  const double half = to / parts / 2;
  Vec2 sum(0, 0);
  for (double part = 0; part < parts; ++part) {
    for (int n = -2; n <= 2; ++n) {
      const double s = (2 * part + 1) * half + (n < 0 ? -1 : 1) * kPlaces[std::abs(n)] * half;
      const double at = angle + s * (begin_curvature + change_per_m * s / 2);
      sum += half * kWeights[std::abs(n)] * Vec2(std::cos(at), std::sin(at));
    }
  }
  return sum;
}

/// A straight, an arc or a clothoid in plan.
struct RoadPiece {
  Vec3 from, to;                     ///< z NaN: not given
  double length = 0;                 ///< m
  Vec2 centre = {0, 0};              ///< of an arc
  double angle = 0, sweep = 0;       ///< of an arc, from its centre; clothoid: direction at `from`
  double curvature = 0, change = 0;  ///< of a clothoid: at `from`, 1/m; per m
  Vec2 gap = {0, 0};                 ///< from where a clothoid leads to `to`: rounding

  bool is_arc() const { return sweep != 0; }
  bool is_clothoid() const { return change != 0; }
  double most_curvature() const {
    if (is_arc()) return sweep / length;
    return std::max(std::abs(curvature), std::abs(curvature + change * length));
  }
  Vec3 at(double s) const {
    const double share = length > 0 ? s / length : 0;
    Vec3 p = from + share * (to - from);
    if (is_arc()) {
      const double radius =
          (1 - share) * (from.head<2>() - centre).norm() + share * (to.head<2>() - centre).norm();
      const double turned = angle + share * sweep;
      p.head<2>() = centre + radius * Vec2(std::cos(turned), std::sin(turned));
    } else if (is_clothoid()) {
      p.head<2>() = from.head<2>() + clothoid(angle, curvature, change, s) + share * gap;
    }
    return p;
  }
};

/// A point of vertical intersection, with its curve.
struct Pvi {
  double station, height;
  double in = 0, out = 0;        ///< lengths of a parabola before and after it, of an arc as found
  double radius = 0;             ///< of an arc; 0: a parabola
  long line = 0;                 ///< of the file
  double before = 0, after = 0;  ///< grades

  double bend() const { return after - before; }
  /// Height at `to` beyond it, where its curve is.
  double on_curve(double to) const {
    const double tangent = height + to * (to < 0 ? before : after);
    if (radius == 0) {
      const double middle = in * out / (2 * (in + out)) * bend();
      const double share = to < 0 ? (to + in) / in : (out - to) / out;
      return tangent + middle * share * share;
    }
    const double side = bend() < 0 ? -1 : 1, slope = std::hypot(1, before);
    const Vec2 begin(-in, height - in * before);
    const Vec2 centre = begin + side * radius / slope * Vec2(-before, 1);
    const double x = to - centre.x();
    return centre.y() - side * std::sqrt(std::max(0.0, radius * radius - x * x));
  }
  double curvature() const {
    return radius > 0 ? std::pow(1 + std::max(before * before, after * after), 1.5) / radius
                      : std::abs(bend()) / (in + out) * std::max(in / out, out / in);
  }
};

/// Heights along an alignment, by station.
class Profile {
 public:
  std::string name = {};
  std::vector<Pvi> pvis = {};

  /// @param fail called with the line of the file and why it is none
  template <typename Fail>
  void complete(const Fail& fail) {
    for (std::size_t i = 0; i < pvis.size(); ++i) {
      Pvi& pvi = pvis[i];
      const auto grade = [&](std::size_t n) {
        return (pvis[n + 1].height - pvis[n].height) / (pvis[n + 1].station - pvis[n].station);
      };
      if (i + 1 < pvis.size() && !(pvis[i + 1].station > pvi.station))
        fail(pvis[i + 1].line, "a profile's stations must increase");
      if (i == 0 || i + 1 == pvis.size()) {
        pvi.in = pvi.out = 0;
        continue;
      }
      pvi.before = grade(i - 1);
      pvi.after = grade(i);
      if (pvi.radius > 0) {
        const double turn = std::atan(pvi.after) - std::atan(pvi.before);
        const double tangent = pvi.radius * std::tan(std::abs(turn) / 2);
        pvi.in = tangent / std::hypot(1, pvi.before);
        pvi.out = tangent / std::hypot(1, pvi.after);
      }
      if (pvi.in + pvis[i - 1].out > pvi.station - pvis[i - 1].station + kSame_m ||
          pvi.station + pvi.out > pvis[i + 1].station + kSame_m)
        fail(pvi.line, "a vertical curve reaches over the next one, or beyond the profile's end");
    }
  }

  double height(double station) const {
    const auto next = std::upper_bound(pvis.begin(), pvis.end(), station,
                                       [](double at, const Pvi& pvi) { return at < pvi.station; });
    const auto last = next == pvis.begin() ? next : next - 1;
    for (const auto pvi : {last, next})
      if (pvi != pvis.end()) {
        const double to = station - pvi->station;
        if (to > -pvi->in && to < pvi->out) return pvi->on_curve(to);
      }
    if (pvis.empty() || station < pvis.front().station - kSame_m ||
        station > pvis.back().station + kSame_m)
      return kNoNumber;
    if (next == pvis.begin()) return pvis.front().height;
    if (next == pvis.end()) return pvis.back().height;
    return last->height + (station - last->station) / (next->station - last->station) *
                              (next->height - last->height);
  }

  /// Adds stations between which it is about straight.
  void add_stations(std::vector<double>& stations) const {
    for (const Pvi& pvi : pvis) {
      if (stations.size() > kMostLinePoints) return;
      stations.push_back(pvi.station);
      const double length = pvi.in + pvi.out;
      if (!(length > 0)) continue;
      const double parts = std::min<double>(parts_of(length, pvi.curvature()), kMostLinePoints);
      for (double i = 0; i <= parts; ++i)
        stations.push_back(pvi.station - pvi.in + i / parts * length);
    }
  }
};

/// A point of the geometry: numbers, or the name of another (CgPoint).
struct Place {
  std::optional<Vec3> at = {};
  std::string name = {};
};

/// An element of the geometry as the file has it.
struct Element {
  std::string kind;
  long line = 0;
  Place from = {}, to = {}, centre = {}, pi = {};
  bool is_left = false;  ///< counterclockwise
  double length = kNoNumber, radius_from = kNoNumber, radius_to = kNoNumber;
  std::vector<Vec3> points = {};
};

/// What one line is made of.
struct Road {
  std::string name;
  double begin = 0;  ///< station
  std::vector<Element> elements = {};
  std::vector<Profile> profiles = {};
};

class AlignmentReader final : LandXmlStream {
 public:
  explicit AlignmentReader(const std::filesystem::path& file) : LandXmlStream(file) {}

  Alignments read() {
    parse();
    if (roads_.empty())
      throw InputError(file_, "has no lines (Alignments, PlanFeatures); surfaces are for --design");
    for (Road& road : roads_) draw(road);
    if (input_.unit.empty()) doubt("gives no Units; its coordinates are taken as metres");
    made_.epsg = input_.epsg;
    made_.wkt = input_.wkt;
    made_.unit_m = input_.unit_m;
    made_.unit = input_.unit;
    return std::move(made_);
  }

 private:
  static std::string text_of(const char* text) { return text != nullptr ? text : ""; }
  [[noreturn]] void fail_at(long line, const std::string& what) const {
    throw InputError(file_, line, what);
  }
  void doubt(const std::string& what) { made_.doubts.push_back(what); }

  /// A number of an attribute; NaN if it is not there.
  double number(const char** attributes, const char* name) const {
    const char* const text = attribute(attributes, name);
    if (text == nullptr) return kNoNumber;
    const std::optional<double> value = parse_number(text);
    if (!value || !(std::abs(*value) <= kMaxNumber))
      fail(fmt::format("{} is '{}'; it must be a number", name, printable(text)));
    return *value;
  }
  /// Curvature by a radius, which may be "INF": 0.
  double radius(const char** attributes, const char* name) const {
    const std::string text = text_of(attribute(attributes, name));
    return lower_case(text) == "inf" ? std::numeric_limits<double>::infinity()
                                     : number(attributes, name);
  }

  bool is_in(std::string_view name) const { return !open_.empty() && open_.back() == name; }

  void begin(std::string_view name, const char** attributes) override {
    if (ignored_ > 0 || name == "Feature" || name == "Surfaces" || name == "ProfSurf") {
      ++ignored_;
      return;
    }
    if (name == "Alignment" || name == "PlanFeature" || name == "Parcel") {
      for (const char* part : {"CoordGeom", "ProfAlign"})
        if (std::find(open_.begin(), open_.end(), part) != open_.end())
          fail(fmt::format("the tag {} is within a {}", name, part));
      const double begin = name == "Alignment" ? number(attributes, "staStart") : 0;
      roads_.push_back({text_of(attribute(attributes, "name")), std::isnan(begin) ? 0 : begin});
    } else if (name == "StaEquation") {
      fail("station equations are not supported; export the alignment with stations that go on");
    } else if (is_in("CoordGeom")) {
      begin_element(name, attributes);
    } else if (name == "ProfAlign") {
      if (roads_.empty()) fail("there is a profile that belongs to no alignment");
      if (std::find(open_.begin(), open_.end(), name) != open_.end())
        fail("there is a profile (ProfAlign) in a profile");
      roads_.back().profiles.push_back({text_of(attribute(attributes, "name")), {}});
    } else if (is_in("ProfAlign")) {
      begin_pvi(name, attributes);
    } else if (name == "CgPoint") {
      name_ = text_of(attribute(attributes, "name"));
    }
    ref_ = text_of(attribute(attributes, "pntRef"));
    open_.emplace_back(name);
    text_.clear();
  }

  void begin_element(std::string_view name, const char** attributes) {
    if (roads_.empty()) fail("there is geometry that belongs to no alignment");
    Element now{std::string(name), line()};
    if (name != "Line" && name != "IrregularLine" && name != "Curve" && name != "Spiral")
      fail(
          fmt::format("a '{}' of an alignment is not supported; lines, irregular lines, arcs "
                      "(Curve) and clothoids (Spiral) are",
                      printable(name)));
    if (name == "Curve" || name == "Spiral") {
      const std::string turn = text_of(attribute(attributes, "rot"));
      if (turn != "cw" && turn != "ccw")
        fail(fmt::format("rot of a {} is '{}'; it must be cw or ccw", name, printable(turn)));
      now.is_left = turn == "ccw";
    }
    if (name == "Spiral") {
      const std::string type = text_of(attribute(attributes, "spiType"));
      if (type != "clothoid")
        fail(fmt::format("a spiral of type '{}' is not supported, only clothoids are",
                         printable(type)));
      now.length = number(attributes, "length");
      now.radius_from = radius(attributes, "radiusStart");
      now.radius_to = radius(attributes, "radiusEnd");
      if (!(now.length > 0) || !(now.radius_from > 0) || !(now.radius_to > 0))
        fail("a spiral needs a length, radiusStart and radiusEnd above 0; a radius may be INF");
    }
    roads_.back().elements.push_back(std::move(now));
  }

  void begin_pvi(std::string_view name, const char** attributes) {
    Pvi now{kNoNumber, kNoNumber};
    now.line = line();
    if (name == "ParaCurve") {
      now.in = now.out = number(attributes, "length") / 2;
    } else if (name == "UnsymParaCurve") {
      now.in = number(attributes, "lengthIn");
      now.out = number(attributes, "lengthOut");
    } else if (name == "CircCurve") {
      now.radius = number(attributes, "radius");
      if (!(now.radius > 0)) fail("a CircCurve needs a radius above 0");
    } else if (name != "PVI") {
      fail(
          fmt::format("a '{}' of a profile is not supported; PVI, ParaCurve, UnsymParaCurve and "
                      "CircCurve are",
                      printable(name)));
    }
    if (!(now.in >= 0) || !(now.out >= 0) || (now.in > 0) != (now.out > 0))
      fail(fmt::format("a {} needs lengths above 0", name));
    roads_.back().profiles.back().pvis.push_back(now);
  }

  void add(std::string_view text) override {
    if (ignored_ > 0 || open_.empty()) return;
    if (text_.size() + text.size() > kMostText_bytes) fail("has a list of points of over 16 MB");
    text_ += text;
  }

  void end() override {
    if (ignored_ > 0) {
      --ignored_;
      return;
    }
    const std::string kind = std::move(open_.back());
    open_.pop_back();
    if (kind == "CgPoint") {
      if (ref_.empty() && !numbers().empty()) add_point(place(kind));
    } else if (is_in("ProfAlign")) {
      const std::vector<double> both = numbers();
      if (both.size() != 2)
        fail(fmt::format("a {} is '{}'; it must be station and elevation", kind, printable(text_)));
      Pvi& pvi = roads_.back().profiles.back().pvis.back();
      pvi.station = both[0];
      pvi.height = both[1];
    } else if (open_.size() >= 2 && open_[open_.size() - 2] == "CoordGeom") {
      Element& now = roads_.back().elements.back();
      if (kind == "Start") now.from = place(kind);
      if (kind == "End") now.to = place(kind);
      if (kind == "Center") now.centre = place(kind);
      if (kind == "PI") now.pi = place(kind);
      if (kind == "PntList2D" || kind == "PntList3D") add_list(now, kind == "PntList3D" ? 3 : 2);
    }
    text_.clear();
  }

  /// Numbers between tags.
  std::vector<double> numbers() const {
    constexpr std::string_view kWhite = " \t\r\n";
    std::vector<double> all;
    const std::string_view row = text_;
    for (std::size_t at = row.find_first_not_of(kWhite); at != row.npos;
         at = row.find_first_not_of(kWhite, at)) {
      const std::size_t end = std::min(row.find_first_of(kWhite, at), row.size());
      const std::optional<double> value = parse_number(row.substr(at, end - at));
      if (!value || !(std::abs(*value) <= kMaxNumber))
        fail(fmt::format("'{}' is no number", printable(row.substr(at, end - at))));
      all.push_back(*value);
      at = end;
    }
    return all;
  }

  /// A point's numbers in the file's units.
  static Vec3 point_of(const double* northing, std::size_t count) {
    return {northing[1], northing[0], count > 2 ? northing[2] : kNoNumber};
  }
  Place place(const std::string& kind) const {
    if (!ref_.empty()) return {{}, ref_};
    const std::vector<double> all = numbers();
    if (all.size() != 2 && all.size() != 3)
      fail(fmt::format("{} is '{}'; it must be northing and easting, elevation, or pntRef", kind,
                       printable(text_)));
    return {point_of(all.data(), all.size()), ""};
  }
  void add_list(Element& now, std::size_t each) const {
    const std::vector<double> all = numbers();
    if (all.empty() || all.size() % each != 0)
      fail(fmt::format("a list of points has {} numbers; {} belong to a point", all.size(), each));
    for (std::size_t i = 0; i < all.size(); i += each)
      now.points.push_back(point_of(&all[i], each));
  }
  void add_point(const Place& place) {
    if (points_.size() == kMostTinPoints) fail("has more than 10 million points");
    const auto [known, is_new] = points_.emplace(name_, *place.at);
    if (!is_new && (known->second.head<2>() - place.at->head<2>()).norm() > 0)
      known->second.x() = kNoNumber;  // which one is meant?
  }

  /// A point in metres. @param what it is, in messages
  Vec3 found(const Place& place, const Element& of, const char* what) const {
    Vec3 p;
    if (place.at) {
      p = *place.at;
    } else {
      const auto point = points_.find(place.name);
      if (place.name.empty()) fail_at(of.line, fmt::format("a {} has no {}", of.kind, what));
      if (point == points_.end() || std::isnan(point->second.x()))
        fail_at(of.line, fmt::format("there {} point '{}' (CgPoint) of this {}",
                                     point == points_.end() ? "is no" : "is more than one",
                                     printable(place.name), of.kind));
      p = point->second;
    }
    return p.cwiseProduct(Vec3(input_.unit_m, input_.unit_m, input_.height_unit_m));
  }

  void add_pieces(const Element& of, std::vector<RoadPiece>& pieces) const {
    RoadPiece piece;
    piece.from = found(of.from, of, "Start");
    piece.to = found(of.to, of, "End");
    const Vec2 from = piece.from.head<2>(), to = piece.to.head<2>();
    piece.length = (to - from).norm();
    if (of.kind == "IrregularLine") {
      std::vector<Vec3> points;
      for (const Vec3& p : of.points) points.push_back(found({p, ""}, of, ""));
      const auto is_near = [](const Vec3& a, const Vec3& b) {
        return (a - b).head<2>().norm() <= kSame_m;
      };
      if (points.empty() || !is_near(points.front(), piece.from))
        points.insert(points.begin(), piece.from);
      if (!is_near(points.back(), piece.to)) points.push_back(piece.to);
      for (std::size_t i = 1; i < points.size(); ++i)
        pieces.push_back({points[i - 1], points[i], (points[i] - points[i - 1]).head<2>().norm()});
      return;
    }
    if (of.kind == "Curve") {
      piece.centre = found(of.centre, of, "Center").head<2>();
      const Vec2 begin = from - piece.centre, end = to - piece.centre;
      if (std::abs(begin.norm() - end.norm()) > kSame_m || begin.norm() < kSame_m)
        fail_at(of.line, fmt::format("a Curve begins {:.3f} m from its Center and ends {:.3f} m "
                                     "from it; both must be its radius",
                                     begin.norm(), end.norm()));
      piece.angle = std::atan2(begin.y(), begin.x());
      constexpr double kTurn = 2 * std::numbers::pi;
      double turn = std::fmod(std::atan2(end.y(), end.x()) - piece.angle, kTurn);
      if (!of.is_left) turn = -turn;
      if (turn <= 0) turn += kTurn;
      piece.sweep = of.is_left ? turn : -turn;
      piece.length = turn * (begin.norm() + end.norm()) / 2;
    }
    if (of.kind == "Spiral") {
      const Vec2 ahead = found(of.pi, of, "PI").head<2>() - from;
      const double side = of.is_left ? 1 : -1;
      piece.length = of.length * input_.unit_m;
      piece.angle = std::atan2(ahead.y(), ahead.x());
      piece.curvature = side / (of.radius_from * input_.unit_m);
      piece.change = (side / (of.radius_to * input_.unit_m) - piece.curvature) / piece.length;
      constexpr double kMostTurns = 10;
      if (!(piece.length * piece.most_curvature() <= 2 * std::numbers::pi * kMostTurns))
        fail_at(of.line, "a spiral turns more than ten times");
      if (piece.change == 0)
        fail_at(of.line, "a spiral has the same radius at both ends, so it is none");
      piece.gap = to - from - clothoid(piece.angle, piece.curvature, piece.change, piece.length);
      if (!(piece.gap.norm() <= kSame_m))
        fail_at(of.line, fmt::format("a clothoid of this length, radii and PI ends {:.2f} m from "
                                     "the spiral's End",
                                     piece.gap.norm()));
    }
    pieces.push_back(piece);
  }

  void draw(Road& road) {
    std::vector<RoadPiece> pieces;
    for (const Element& element : road.elements) add_pieces(element, pieces);
    const bool has_heights = !road.profiles.empty() && !road.profiles.front().pvis.empty();
    Profile profile = has_heights ? std::move(road.profiles.front()) : Profile();
    if (road.profiles.size() > 1)
      doubt(fmt::format(
          "the alignment '{}' has {} profiles; its heights are those of the first, '{}'",
          printable(road.name), road.profiles.size(), printable(profile.name)));
    for (Pvi& pvi : profile.pvis) {
      for (double* length : {&pvi.station, &pvi.in, &pvi.out, &pvi.radius})
        *length *= input_.unit_m;
      pvi.height *= input_.height_unit_m;
    }
    profile.complete([&](long line, const char* what) { fail_at(line, what); });
    std::vector<double> bends;  // stations
    profile.add_stations(bends);
    if (bends.size() > kMostLinePoints) too_many();
    std::sort(bends.begin(), bends.end());
    double begin = road.begin * input_.unit_m;
    std::vector<Vec3> line;
    for (const RoadPiece& piece : pieces) {
      if (!line.empty() && (line.back() - piece.from).head<2>().norm() > kSame_m) finish(line);
      const double end = begin + piece.length,
                   parts = parts_of(piece.length, piece.most_curvature());
      if (!(parts <= kMostLinePoints)) too_many();
      std::vector<double> stations;
      for (double i = line.empty() ? 0 : 1; i <= parts; ++i)
        stations.push_back(i == parts ? end : begin + i / parts * piece.length);
      for (auto bend = std::upper_bound(bends.begin(), bends.end(), begin + kNear_m);
           bend != bends.end() && *bend < end - kNear_m; ++bend)
        stations.push_back(*bend);
      std::sort(stations.begin(), stations.end());
      for (const double station : stations) {
        Vec3 p = piece.at(std::clamp(station - begin, 0.0, piece.length));
        if (has_heights) p.z() = profile.height(station);
        if (++count_ > kMostLinePoints) too_many();
        line.push_back(p);
      }
      begin = end;
    }
    finish(line);
  }
  [[noreturn]] void too_many() const {
    throw InputError(file_,
                     fmt::format("has lines of more than {} points; export fewer of its alignments",
                                 kMostLinePoints));
  }
  void finish(std::vector<Vec3>& line) {
    if (line.size() > 1) made_.lines.push_back(std::move(line));
    line.clear();
  }

  std::vector<std::string> open_;  ///< tags
  std::size_t ignored_ = 0;        ///< of them
  std::string text_, ref_, name_;
  std::unordered_map<std::string, Vec3> points_;
  std::vector<Road> roads_;
  std::size_t count_ = 0;  ///< of points
  Alignments made_;
};

}  // namespace

Alignments read_alignments(const std::filesystem::path& file) {
  return AlignmentReader(file).read();
}

}  // namespace soilvdb::inline v0::io
