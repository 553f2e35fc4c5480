// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The inside of a bucket's mesh by sections that are filled from the mouth. No mesh of a real
// bucket can be trusted to be closed, so no step uses normals or the inside of the steel.
#include "soilvdb/io/bucket_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "io/file/text.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/mesh_file.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr int kSections = 33;
constexpr double kSectionedShare = 0.7;  // of the lip; the side plates are outside
constexpr int kCellsPerHeight = 400;
constexpr double kSimplifiedShare = 0.0015;  // of the height, off the outline
constexpr double kOnMeshShare = 0.02;        // of the lip, from an end of it to the mesh
constexpr double kBridgedShare = 0.05;       // of the height, from the lip's line to a curved lip
constexpr double kTaperShare = 0.25;         // of the lip, from its end to a side plate
constexpr double kShortestLipM = 0.02, kLongestLipM = 20;  // of models, and of mines
constexpr double kMostAbove = 1.3;    // heights, of the inside: then the mouth is another
constexpr double kLargestBucket = 3;  // heights, behind, below and above the mouth

struct Piece {
  Vec2 a, b;
};

/// Where the mesh crosses a plane y = const. Equal edges of triangles give equal bits.
std::vector<Piece> section_at(const std::vector<Vec3>& points, const Mesh& mesh, double y) {
  std::vector<Piece> pieces;
  for (const auto& t : mesh.triangles) {
    Vec2 ends[2];
    int count = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t low = std::min(t[k], t[(k + 1) % 3]);
      const std::uint32_t high = std::max(t[k], t[(k + 1) % 3]);
      const Vec3 &p = points[low], &q = points[high];
      if ((p.y() < y) == (q.y() < y)) continue;
      const Vec3 at = p + (y - p.y()) / (q.y() - p.y()) * (q - p);
      ends[count++] = Vec2(at.x(), at.z());
    }
    if (count == 2) pieces.push_back({ends[0], ends[1]});
  }
  return pieces;
}

Vec2 nearest_on(const Piece& piece, const Vec2& p) {
  const Vec2 along = piece.b - piece.a;
  const double length2 = along.squaredNorm();
  const double t = length2 > 0 ? std::clamp((p - piece.a).dot(along) / length2, 0.0, 1.0) : 0;
  return piece.a + t * along;
}

Vec2 nearest_on(const std::vector<Piece>& pieces, const Vec2& p) {
  Vec2 best = Vec2::Constant(std::numeric_limits<double>::infinity());
  for (const Piece& piece : pieces) {
    const Vec2 q = nearest_on(piece, p);
    if (!((q - p).squaredNorm() >= (best - p).squaredNorm())) best = q;
  }
  return best;
}

/// The nearest point of a triangle: its plane's, or one of an edge.
Vec3 nearest_on_triangle(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& p) {
  const Vec3 normal = (b - a).cross(c - a);
  const double area2 = normal.squaredNorm();
  const Vec3* corners[] = {&a, &b, &c};
  bool inside = area2 > 0;
  Vec3 best = a;
  for (int k = 0; k < 3; ++k) {
    const Vec3 &from = *corners[k], along = *corners[(k + 1) % 3] - from;
    if (along.cross(p - from).dot(normal) < 0) inside = false;
    const double length2 = along.squaredNorm();
    const double t = length2 > 0 ? std::clamp((p - from).dot(along) / length2, 0.0, 1.0) : 0;
    const Vec3 q = from + t * along;
    if ((q - p).squaredNorm() < (best - p).squaredNorm()) best = q;
  }
  return inside ? Vec3(p - (p - a).dot(normal) / area2 * normal) : best;
}

std::string words_of(const Vec3& p) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", p[0], p[1], p[2]);
}

/// The upper edge as the lip sees it: of what a section has at the outer end of its angles, the end
/// without steel between it and the lip.
std::optional<Vec2> upper_of(const std::vector<Piece>& pieces) {
  double most = 0;
  for (const Piece& piece : pieces) most = std::max({most, piece.a.norm(), piece.b.norm()});
  if (!(most > 0)) return std::nullopt;
  std::vector<Vec2> far, near;
  Vec2 middle(0, 0);
  for (const Piece& piece : pieces) {
    const int steps = 1 + static_cast<int>((piece.b - piece.a).norm() / (most / 200));
    for (int k = 0; k <= steps; ++k) {
      const Vec2 p = piece.a + (piece.b - piece.a) * (double(k) / steps);
      if (p.norm() > 0.3 * most) {
        far.push_back(p);
        middle += p.normalized() / steps * (piece.b - piece.a).norm();
      } else if (p.norm() > 0.1 * most) {
        near.push_back(p);
      }
    }
  }
  if (far.empty()) return std::nullopt;
  const auto angle = [&](const Vec2& p) {
    return std::atan2(middle.x() * p.y() - middle.y() * p.x(), middle.dot(p));
  };
  constexpr double kBehindLip = 1.9;  // rad: teeth are on the other side of the lip
  std::erase_if(far, [&](const Vec2& p) { return std::abs(angle(p)) > kBehindLip; });
  std::erase_if(near, [&](const Vec2& p) { return std::abs(angle(p)) > kBehindLip; });
  if (far.empty() || near.empty()) return std::nullopt;
  const auto [low, high] = std::minmax_element(
      far.begin(), far.end(), [&](const Vec2& a, const Vec2& b) { return angle(a) < angle(b); });
  double mean = 0;
  for (const Vec2& p : near) mean += angle(p) / double(near.size());
  return mean > (angle(*low) + angle(*high)) / 2 ? *low : *high;
}

/// Nodes of a section behind the mouth, spaced `cell`, and where edges between them meet the mesh.
/// Column 0 is before the mouth.
class FilledSection {
 public:
  FilledSection(double height_m, const Eigen::AlignedBox2d& box)
      : height_m_(height_m), cell_m_(height_m / kCellsPerHeight) {
    const double reach = kLargestBucket * height_m;
    const double low = std::max(box.min().y(), -reach) - 2.37 * cell_m_;
    const double high = std::min(box.max().y(), height_m + reach) + 3 * cell_m_;
    low_m_ = std::min(low, -3 * cell_m_);
    columns_ = 4 + static_cast<int>(std::max(0.0, -std::max(box.min().x(), -reach)) / cell_m_);
    rows_ = 4 + static_cast<int>((std::max(high, height_m) - low_m_) / cell_m_);
    inside_.assign(count(), 0);
    first_.assign(2 * count(), kNone);
    last_.assign(2 * count(), -kNone);
  }

  Vec2 node(int i, int j) const { return {(0.5 - i) * cell_m_, low_m_ + j * cell_m_}; }
  bool is_inside(int i, int j) const { return inside_[at(i, j)] != 0; }
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  double cell_m() const { return cell_m_; }

  void add(const Piece& piece) {
    Vec2 a = to_grid(piece.a), b = to_grid(piece.b);
    const double length = (b - a).norm();
    if (length > 0) {  // over cracks
      const Vec2 more = (b - a) / length;
      a -= more;
      b += more;
    }
    for (int axis = 0; axis < 2; ++axis) {  // rows cross edges along i, columns those along j
      const int along = axis, across = 1 - axis;
      const double from = std::min(a[across], b[across]), to = std::max(a[across], b[across]);
      const int lines = across == 0 ? columns_ : rows_;
      const int begin = static_cast<int>(std::ceil(std::clamp(from, 0.0, double(lines))));
      const int end = static_cast<int>(std::floor(std::clamp(to, -1.0, lines - 1.0))) + 1;
      for (int k = begin; k < end; ++k) {
        const double share = to > from ? (k - a[across]) / (b[across] - a[across]) : 0;
        const double place = a[along] + share * (b[along] - a[along]);
        if (!(place >= 0 && place < (along == 0 ? columns_ : rows_) - 1)) continue;
        const int low = static_cast<int>(place);
        mark(axis, low, k, place - low);
        if (place == low && low > 0) mark(axis, low - 1, k, 1);  // the node itself is steel
      }
    }
  }

  /// Fills the inside from the middle of the mouth. @return Is it closed?
  bool fill() {
    std::vector<std::array<int, 2>> open;
    const auto enter = [&](int i, int j) {
      if (inside_[at(i, j)] != 0) return;
      inside_[at(i, j)] = 1;
      open.push_back({i, j});
    };
    for (int j = 0; j < rows_; ++j) {
      const double z = node(1, j).y();
      if (z > 0.2 * height_m_ && z < 0.8 * height_m_) enter(1, j);
    }
    while (!open.empty()) {
      const auto [i, j] = open.back();
      open.pop_back();
      if (i == columns_ - 1 || j == 0 || j == rows_ - 1) return false;
      if (i > 1 && !blocked(0, i - 1, j)) enter(i - 1, j);
      if (!blocked(0, i, j)) enter(i + 1, j);
      if (!blocked(1, i, j - 1)) enter(i, j - 1);
      if (!blocked(1, i, j)) enter(i, j + 1);
    }
    return true;
  }

  /// The border of the inside, from the lip round the body to the upper edge.
  std::vector<Vec2> outline() const {
    std::vector<int> next(2 * count(), -1);
    for (int j = 0; j + 1 < rows_; ++j) {
      for (int i = 0; i + 1 < columns_; ++i) {
        const bool in[] = {is_inside(i, j), is_inside(i + 1, j), is_inside(i + 1, j + 1),
                           is_inside(i, j + 1)};
        const int edges[] = {edge(0, i, j), edge(1, i + 1, j), edge(0, i, j + 1), edge(1, i, j)};
        for (int leaves = 0; leaves < 4; ++leaves) {
          if (!in[leaves] || in[(leaves + 1) % 4]) continue;
          int enters = (leaves + 3) % 4;  // the edge where this run of corners begins
          while (in[enters]) enters = (enters + 3) % 4;
          next[static_cast<std::size_t>(edges[leaves])] = edges[enters];
        }
      }
    }
    int start = 0;  // row
    while (node(1, start).y() < 0.5 * height_m_) ++start;
    const int first = edge(0, 0, start);
    // What pierces the mouth's plane parts the border; the longest part is the body.
    std::vector<Vec2> part, body;
    int e = first;
    do {
      if (is_mouth(e)) {
        if (part.size() > body.size()) body = part;
        part.clear();
      } else {
        part.push_back(crossing(e));
      }
      e = next[static_cast<std::size_t>(e)];
    } while (e != first && e >= 0);
    if (part.size() > body.size()) body = part;
    if (!body.empty() && body.front().y() > body.back().y()) std::reverse(body.begin(), body.end());
    body.insert(body.begin(), Vec2(0, 0));
    body.push_back(Vec2(0, height_m_));
    return body;
  }

 private:
  static constexpr float kNone = 2;

  std::size_t count() const {
    return static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  }
  std::size_t at(int i, int j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(i);
  }
  int edge(int axis, int i, int j) const { return 2 * static_cast<int>(at(i, j)) + axis; }
  std::size_t edge_at(int axis, int i, int j) const {
    return 2 * at(i, j) + static_cast<std::size_t>(axis);
  }
  bool is_mouth(int e) const { return e % 2 == 0 && e / 2 % columns_ == 0; }
  Vec2 to_grid(const Vec2& p) const { return {0.5 - p.x() / cell_m_, (p.y() - low_m_) / cell_m_}; }
  bool blocked(int axis, int i, int j) const { return first_[edge_at(axis, i, j)] != kNone; }
  void mark(int axis, int along, int across, double t) {
    const std::size_t e = axis == 0 ? edge_at(0, along, across) : edge_at(1, across, along);
    first_[e] = std::min(first_[e], static_cast<float>(t));
    last_[e] = std::max(last_[e], static_cast<float>(t));
  }
  /// Where an edge leaves the inside.
  Vec2 crossing(int e) const {
    const int axis = e % 2, i = e / 2 % columns_, j = e / 2 / columns_;
    const auto k = static_cast<std::size_t>(e);
    const double t = is_inside(i, j) ? first_[k] : last_[k];
    const Vec2 a = node(i, j), b = axis == 0 ? node(i + 1, j) : node(i, j + 1);
    return a + t * (b - a);
  }

  double height_m_, cell_m_, low_m_ = 0;
  int columns_ = 0, rows_ = 0;
  std::vector<char> inside_;
  std::vector<float> first_, last_;  // per edge: where the mesh crosses it, 0 to 1
};

double area_within(const std::vector<Vec2>& outline) {
  double twice = 0;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Vec2 &a = outline[i], &b = outline[(i + 1) % outline.size()];
    twice += a.x() * b.y() - a.y() * b.x();
  }
  return std::abs(twice) / 2;
}

/// Without the points whose lack moves the line by less than `off_m` (Douglas and Peucker).
std::vector<Vec2> simplified(const std::vector<Vec2>& line, double off_m) {
  std::vector<char> kept(line.size(), 0);
  kept.front() = kept.back() = 1;
  std::vector<std::array<std::size_t, 2>> parts{{0, line.size() - 1}};
  while (!parts.empty()) {
    const auto [begin, end] = parts.back();
    parts.pop_back();
    std::size_t farthest = begin;
    double most = off_m;
    for (std::size_t k = begin + 1; k < end; ++k) {
      const double off = (line[k] - nearest_on({line[begin], line[end]}, line[k])).norm();
      if (off > most) most = off, farthest = k;
    }
    if (farthest == begin) continue;
    kept[farthest] = 1;
    parts.push_back({begin, farthest});
    parts.push_back({farthest, end});
  }
  std::vector<Vec2> few;
  for (std::size_t k = 0; k < line.size(); ++k)
    if (kept[k] != 0) few.push_back(line[k]);
  return few;
}

/// The mean distance from the plane y = from_m to the first steel on `side` (1 or -1), over the
/// inside of a section. @return std::nullopt where most of it has none within most_m.
std::optional<double> mean_reach(const FilledSection& section, const std::vector<Vec3>& points,
                                 const Mesh& mesh, double from_m, int side, double most_m) {
  const int columns = section.columns(), rows = section.rows();
  const Vec2 origin = section.node(0, 0);
  const double cell = section.cell_m();
  std::vector<double> reach(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows),
                            most_m);
  for (const auto& t : mesh.triangles) {
    Vec3 p[3];  // i, j, distance
    double farthest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3& q = points[t[k]];
      p[k] =
          Vec3((origin.x() - q.x()) / cell, (q.z() - origin.y()) / cell, side * (q.y() - from_m));
      farthest = std::max(farthest, p[k].z());
    }
    const double turn = (p[1].x() - p[0].x()) * (p[2].y() - p[0].y()) -
                        (p[2].x() - p[0].x()) * (p[1].y() - p[0].y());
    if (farthest <= 0 || turn == 0) continue;
    const auto bound = [](double v, int end) {
      return static_cast<int>(std::clamp(v, 0.0, double(end)));
    };
    const auto [left, right] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
    const auto [low, high] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
    for (int j = bound(std::ceil(low), rows); j < bound(std::floor(high) + 1, rows); ++j) {
      for (int i = bound(std::ceil(left), columns); i < bound(std::floor(right) + 1, columns);
           ++i) {
        if (!section.is_inside(i, j)) continue;
        const auto share = [&](const Vec3& a, const Vec3& b) {
          return ((b.x() - a.x()) * (j - a.y()) - (b.y() - a.y()) * (i - a.x())) / turn;
        };
        const double w0 = share(p[1], p[2]), w1 = share(p[2], p[0]), w2 = share(p[0], p[1]);
        if (std::min({w0, w1, w2}) < -1e-9) continue;
        const double distance = w0 * p[0].z() + w1 * p[1].z() + w2 * p[2].z();
        double& least = reach[static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) +
                              static_cast<std::size_t>(i)];
        if (distance > 0 && distance < least) least = distance;
      }
    }
  }
  double sum = 0;
  long hits = 0, nodes = 0;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      if (!section.is_inside(i, j)) continue;
      ++nodes;
      const double distance =
          reach[static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) +
                static_cast<std::size_t>(i)];
      if (distance >= most_m) continue;
      ++hits;
      sum += distance;
    }
  }
  if (2 * hits < nodes || hits == 0) return std::nullopt;
  return sum / double(hits);
}

/// A bucket's mesh on its way to a bucket.
class BucketReader {
 public:
  BucketReader(const std::filesystem::path& file, const MouthEdges& edges, double unit_m)
      : file_(file), edges_(edges), unit_m_(unit_m) {
    if (!(unit_m > 0) || !std::isfinite(unit_m))
      fail(fmt::format("unit is {:g}; it must be the metres per unit of the file, such as 0.001",
                       unit_m));
    mesh_ = read_mesh(file);
    if (is_in_metres() && unit_m != 1)
      fail(
          fmt::format("says its unit itself; leave out the unit of {:g}, and give lip and upper "
                      "in metres",
                      unit_m));
    for (const Eigen::Vector3f& p : mesh_.points) points_.push_back(p.cast<double>() * unit_m);
    check_finite("lip", edges.lip[0]);
    check_finite("lip", edges.lip[1]);
    if (edges.upper) check_finite("upper", *edges.upper);
    if (edges.lip[0] == edges.lip[1])
      fail("lip has the same point twice; it must be the two ends of the cutting edge");
    if (lip_m() < kShortestLipM || lip_m() > kLongestLipM)
      fail(is_in_metres()
               ? fmt::format("the lip is {:.3g} m long; of a .dae it must be in metres", lip_m())
               : fmt::format("the lip is {:.3g} m long with a unit of {:g}; unit must be the "
                             "metres per unit of the file, such as 0.001 for millimetres",
                             lip_m(), unit_m));
    check_on_mesh("lip", edges.lip[0]);
    check_on_mesh("lip", edges.lip[1]);
    if (edges.upper) check_on_mesh("upper", *edges.upper);
  }

  MeshBucket read() {
    place(find_upper());
    std::vector<FilledSection> sections;
    std::vector<std::vector<Vec2>> outlines;
    std::vector<double> at_m;
    Eigen::AlignedBox2d box;
    for (const Vec3& p : points_) box.extend(Vec2(p.x(), p.z()));
    int lip_missed = 0, upper_missed = 0;
    const Vec2 lip(0, 0), upper(0, height_m_);
    for (int k = 0; k < kSections; ++k) {
      std::vector<Piece> pieces = section_at(points_, mesh_, section_m(k));
      const Vec2 by_lip = nearest_on(pieces, lip), by_upper = nearest_on(pieces, upper);
      const bool lip_there = (by_lip - lip).norm() < kBridgedShare * height_m_;
      const bool upper_there = (by_upper - upper).norm() < kBridgedShare * height_m_;
      lip_missed += !lip_there;
      upper_missed += !upper_there;
      if (!lip_there || !upper_there) continue;
      pieces.push_back({lip, by_lip});
      pieces.push_back({upper, by_upper});
      FilledSection section(height_m_, box);
      for (const Piece& piece : pieces) section.add(piece);
      if (!section.fill()) continue;
      std::vector<Vec2> outline = section.outline();
      if (outline.size() < 5) continue;
      outlines.push_back(std::move(outline));
      at_m.push_back(section_m(k));
      if (sections.size() == 2) sections.pop_back();
      sections.push_back(std::move(section));  // the first and the last
    }
    constexpr int kMayFail = kSections / 3;
    if (lip_missed > kMayFail)
      fail(fmt::format(
          "the mesh has no edge along the lip between its ends, at {} of {} places; lip "
          "must be the ends of the cutting edge, not the tips of teeth",
          lip_missed, kSections));
    if (upper_missed > kMayFail)
      fail(fmt::format(
          "the mesh has no upper edge through {} along the lip, at {} of {} places; give "
          "upper, a point of the mouth's upper edge",
          words_of(upper_point()), upper_missed, kSections));
    if (kSections - static_cast<int>(outlines.size()) > kMayFail)
      fail(
          fmt::format("the outline is open in {} of {} sections between the lip and the upper edge "
                      "through {}; close gaps of more than {:.2g} m in the body, or give upper, a "
                      "point of the mouth's upper edge",
                      kSections - outlines.size(), kSections, words_of(upper_point()),
                      2 * height_m_ / kCellsPerHeight));
    return made(sections, outlines, at_m);
  }

 private:
  [[noreturn]] void fail(const std::string& what) const { throw InputError(file_, what); }

  /// Whatever the file's unit is: read_mesh() knows it.
  bool is_in_metres() const { return suffix_of(file_) == ".dae"; }
  double lip_m() const { return (edges_.lip[1] - edges_.lip[0]).norm() * unit_m_; }
  double section_m(int k) const {
    return lip_m() * kSectionedShare * ((k + 0.5) / kSections - 0.5);
  }
  /// In the file's coordinates.
  Vec3 upper_point() const {
    return (pose_.position + height_m_ * (pose_.rotation * Vec3::UnitZ())) / unit_m_;
  }

  void check_finite(const char* name, const Vec3& given) const {
    if (!given.allFinite())
      fail(fmt::format("{} has the point {}; its coordinates must be finite", name,
                       words_of(given)));
  }
  void check_on_mesh(const char* name, const Vec3& given) const {
    Vec3 nearest = Vec3::Zero();
    double least = std::numeric_limits<double>::infinity();
    const Vec3 p = given * unit_m_;
    for (const auto& t : mesh_.triangles) {
      const Vec3 q = nearest_on_triangle(points_[t[0]], points_[t[1]], points_[t[2]], p);
      if ((q - p).norm() >= least) continue;
      least = (q - p).norm();
      nearest = q;
    }
    if (least > kOnMeshShare * lip_m())
      fail(fmt::format(
          "{} has the point {}, which is {:.3g} m off the mesh; the nearest point of the "
          "mesh is {}, in {}",
          name, words_of(given), least, words_of(nearest / unit_m_),
          is_in_metres() ? "metres" : "units of the file"));
  }

  /// Moves the mesh to a frame with the lip along y. The other axes are any.
  void put_lip_on_y() {
    const Vec3 y = (edges_.lip[1] - edges_.lip[0]).normalized();
    const Vec3 x = y.unitOrthogonal();
    move_to(x, y, x.cross(y));
  }
  void move_to(const Vec3& x, const Vec3& y, const Vec3& z) {
    Eigen::Matrix3d axes;
    axes << x, y, z;
    pose_ = {(edges_.lip[0] + edges_.lip[1]) / 2 * unit_m_, Eigen::Quaterniond(axes)};
    for (std::size_t k = 0; k < points_.size(); ++k)
      points_[k] = axes.transpose() * (mesh_.points[k].cast<double>() * unit_m_ - pose_.position);
  }

  /// A point of the upper edge, m, in the file's axes.
  Vec3 find_upper() {
    if (edges_.upper) return *edges_.upper * unit_m_;
    put_lip_on_y();
    std::vector<Vec2> found;
    Vec2 middle(0, 0);
    for (int k = 0; k < kSections; ++k) {
      const auto pieces = section_at(points_, mesh_, section_m(k));
      if (const auto upper = upper_of(pieces)) found.push_back(*upper);
      for (const Piece& piece : pieces)
        middle += (piece.a + piece.b).normalized() * (piece.b - piece.a).norm();
    }
    if (found.size() < kSections / 2)
      fail("the mesh has no upper edge opposite the lip; lip must be the ends of the cutting edge");
    // Lugs and pins are in some sections, and further out than the shell.
    const auto inner = found.begin() + static_cast<std::ptrdiff_t>(found.size() / 4);
    std::nth_element(found.begin(), inner, found.end(), [&](const Vec2& a, const Vec2& b) {
      return a.dot(middle) / a.norm() > b.dot(middle) / b.norm();
    });
    return pose_.position + pose_.rotation * Vec3(inner->x(), 0, inner->y());
  }

  /// Moves the mesh to the bucket frame. Which way y points follows from where the body is.
  void place(const Vec3& upper) {
    Vec3 y = (edges_.lip[1] - edges_.lip[0]).normalized();
    const Vec3 lip = (edges_.lip[0] + edges_.lip[1]) / 2 * unit_m_;
    Vec3 z = upper - lip - (upper - lip).dot(y) * y;
    height_m_ = z.norm();
    if (height_m_ < kOnMeshShare * lip_m())
      fail("upper is on the lip; it must be a point of the mouth's upper edge");
    z /= height_m_;
    move_to(y.cross(z), y, z);
    double before = 0, behind = 0;
    for (int k = 0; k < kSections; ++k) {
      for (const Piece& piece : section_at(points_, mesh_, section_m(k))) {
        before = std::max({before, piece.a.x(), piece.b.x()});
        behind = std::max({behind, -piece.a.x(), -piece.b.x()});
      }
    }
    if (before <= behind) return;
    y = -y;
    move_to(y.cross(z), y, z);
  }

  MeshBucket made(const std::vector<FilledSection>& ends,
                  const std::vector<std::vector<Vec2>>& outlines,
                  const std::vector<double>& at_m) const {
    std::vector<double> areas;
    for (const auto& outline : outlines) areas.push_back(area_within(outline));
    std::vector<std::size_t> order(areas.size());
    for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
    std::sort(order.begin(), order.end(), [&](auto a, auto b) { return areas[a] < areas[b]; });
    const auto& outline = outlines[order[order.size() / 2]];
    double top = 0;
    for (const Vec2& p : outline) top = std::max(top, p.y());
    if (!edges_.upper && top > kMostAbove * height_m_)
      fail(fmt::format(
          "the inside goes up to {:.3g} m above the lip, but the upper edge was found at "
          "{:.3g} m; take away faces that close the mouth, or give upper",
          top, height_m_));
    double mean = 0;
    for (const double area : areas) mean += area / double(areas.size());
    const auto side = [&](const FilledSection& section, double from_m, int direction) {
      const double most_m = lip_m() / 2 - std::abs(from_m) + kTaperShare * lip_m();
      if (const auto reach = mean_reach(section, points_, mesh_, from_m, direction, most_m))
        return *reach;
      fail(fmt::format(
          "the mesh has no side plate beside the end {} of the lip; the bucket must have "
          "sides, and lip must reach from one to the other",
          words_of(edges_.lip[(pose_.rotation * Vec3(0, direction, 0))
                                          .dot(edges_.lip[1] - edges_.lip[0]) > 0
                                  ? 1
                                  : 0])));
    };
    const double volume = mean * (at_m.back() - at_m.front()) +
                          areas.front() * side(ends.front(), at_m.front(), -1) +
                          areas.back() * side(ends.back(), at_m.back(), 1);
    MeshBucket result{{.width_m = 0, .height_m = height_m_, .profile = {}, .dump_angle_rad = {}},
                      pose_};
    result.bucket.profile = simplified(outline, kSimplifiedShare * height_m_);
    result.bucket.width_m = volume / area_within(result.bucket.profile);
    try {
      result.bucket.validate();
    } catch (const std::invalid_argument& wrong) {
      fail(fmt::format("as a bucket its {}", wrong.what()));
    }
    return result;
  }

  std::filesystem::path file_;
  MouthEdges edges_;
  double unit_m_;
  Mesh mesh_;
  std::vector<Vec3> points_;  // m; in the file's axes, then in the bucket frame
  Pose pose_;                 // of the frame that points_ are in
  double height_m_ = 0;
};

}  // namespace

MeshBucket read_bucket_mesh(const std::filesystem::path& file, const MouthEdges& edges,
                            double unit_m) {
  return BucketReader(file, edges, unit_m).read();
}

}  // namespace soilvdb::inline v0::io
