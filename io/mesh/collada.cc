// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// COLLADA 1.4 and 1.5: https://www.khronos.org/collada
#include "io/mesh/collada.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <span>
#include <string>
#include <string_view>

#include "io/file/text.h"
#include "io/file/xml.h"

namespace soilvdb::inline v0::io {
namespace {

using tinyxml2::XMLElement;

constexpr std::size_t kMaxColladaBytes = std::size_t{1} << 29;
constexpr std::size_t kMostTriangles = std::size_t{1} << 24;
// Nodes may stand for others, which may be a circle, or double at each level.
constexpr int kDeepestNode = 64;
constexpr std::size_t kMostNodes = 1 << 20;

class Collada {
 public:
  using Triangles = std::vector<std::array<Vec3, 3>>;

  explicit Collada(const std::filesystem::path& file) : file_(file) {
    const XMLElement& root = parse_xml(file, read_text(file, kMaxColladaBytes),
                                       "a .dae begins with <COLLADA ..>", document_);
    if (root.Name() != std::string_view("COLLADA")) fail(root, "is not the <COLLADA> of a .dae");
    index(root);
    double unit_m = 1;
    const XMLElement* asset = root.FirstChildElement("asset");
    const XMLElement* unit = asset != nullptr ? asset->FirstChildElement("unit") : nullptr;
    if (const char* text = unit != nullptr ? unit->Attribute("meter") : nullptr) {
      unit_m = number(*unit, text);
      if (!(unit_m > 0)) fail(*unit, "must have meter=\"..\" above 0, the metres of its unit");
    }
    const Eigen::Affine3d metres(Eigen::Scaling(unit_m));
    if (const XMLElement* scene = scene_of(root)) {
      each(*scene, "node", [&](const XMLElement& node) { add_node(node, metres, 0); });
    } else {
      each(root, "library_geometries", [&](const XMLElement& library) {
        each(library, "geometry", [&](const XMLElement& geometry) { add(geometry, metres); });
      });
    }
  }

  Triangles take() { return std::move(triangles_); }

 private:
  /// What a face's corners are: place of their indices among those of a corner, and the points.
  struct Corners {
    const std::vector<Vec3>* points = nullptr;
    std::size_t at = 0, stride = 1;
  };

  template <typename F>
  static void each(const XMLElement& in, const char* name, const F& f) {
    for (const auto* e = in.FirstChildElement(name); e != nullptr; e = e->NextSiblingElement(name))
      f(*e);
  }
  [[noreturn]] void fail(const XMLElement& element, std::string_view what) const {
    throw InputError(file_, element.GetLineNum(),
                     fmt::format("<{}> {}", printable(element.Name()), what));
  }

  void index(const XMLElement& element) {
    if (const char* id = element.Attribute("id")) by_id_.emplace(id, &element);
    for (const auto* e = element.FirstChildElement(); e != nullptr; e = e->NextSiblingElement())
      index(*e);
  }
  const XMLElement& named(const XMLElement& from, const char* attribute,
                          std::string_view kind) const {
    const char* text = from.Attribute(attribute);
    if (text == nullptr) fail(from, fmt::format("has no {}=\"..\"", attribute));
    const auto at = by_id_.find(*text == '#' ? text + 1 : text);
    if (at == by_id_.end() || at->second->Name() != kind)
      fail(from, fmt::format("names '{}', but there is no such <{}>", printable(text), kind));
    return *at->second;
  }
  const XMLElement* scene_of(const XMLElement& root) const {
    if (const XMLElement* scene = root.FirstChildElement("scene"))
      if (const XMLElement* e = scene->FirstChildElement("instance_visual_scene"))
        return &named(*e, "url", "visual_scene");
    const XMLElement* library = root.FirstChildElement("library_visual_scenes");
    return library != nullptr ? library->FirstChildElement("visual_scene") : nullptr;
  }

  double number(const XMLElement& element, std::string_view text) const {
    const auto value = parse_number(text);
    if (!value || !(std::abs(*value) <= kMaxNumber))
      fail(element, fmt::format("has '{}' where a number is needed, -1e9 to 1e9", printable(text)));
    return *value;
  }
  /// Calls f for each word of an element's text, which comments may divide.
  template <typename F>
  static void each_word(const XMLElement& element, const F& f) {
    constexpr std::string_view kSpace = " \t\r\n";
    for (const auto* part = element.FirstChild(); part != nullptr; part = part->NextSibling()) {
      if (part->ToText() == nullptr) continue;
      for (std::string_view left = part->Value(); !left.empty();) {
        left.remove_prefix(std::min(left.find_first_not_of(kSpace), left.size()));
        const std::string_view word = left.substr(0, left.find_first_of(kSpace));
        left.remove_prefix(word.size());
        if (!word.empty()) f(word);
      }
    }
  }
  std::vector<double> numbers(const XMLElement& element) const {
    std::vector<double> all;
    each_word(element, [&](std::string_view word) { all.push_back(number(element, word)); });
    return all;
  }
  template <std::size_t N>
  std::array<double, N> numbers(const XMLElement& element) const {
    const std::vector<double> all = numbers(element);
    if (all.size() != N)
      fail(element, fmt::format("has {} numbers; it must have {}", all.size(), N));
    std::array<double, N> out;
    std::copy(all.begin(), all.end(), out.begin());
    return out;
  }
  std::vector<std::size_t> indices(const XMLElement& element) const {
    std::vector<std::size_t> all;
    each_word(element, [&](std::string_view word) {
      const auto value = parsed<std::uint32_t>(word);
      if (!value) fail(element, fmt::format("has '{}' where an index is needed", printable(word)));
      all.push_back(*value);
    });
    return all;
  }
  std::size_t count(const XMLElement& element, const char* name, std::size_t otherwise) const {
    const char* text = element.Attribute(name);
    if (text == nullptr) return otherwise;
    const auto value = parsed<std::uint32_t>(text);
    if (!value)
      fail(element, fmt::format("has {}=\"{}\"; it must be a whole number", name, printable(text)));
    return *value;
  }

  Eigen::Affine3d transform(const XMLElement& e) const {
    const std::string_view kind = e.Name();
    Eigen::Affine3d out = Eigen::Affine3d::Identity();
    if (kind == "matrix") {
      const auto m = numbers<16>(e);
      if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
        fail(e, "must end in 0 0 0 1: projections are no places of a mesh");
      for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 4; ++column)
          out.matrix()(row, column) = m[static_cast<std::size_t>(4 * row + column)];
    } else if (kind == "translate") {
      const auto t = numbers<3>(e);
      out.translation() = Vec3(t[0], t[1], t[2]);
    } else if (kind == "scale") {
      const auto s = numbers<3>(e);
      out.linear().diagonal() = Vec3(s[0], s[1], s[2]);
    } else if (kind == "rotate") {
      const auto r = numbers<4>(e);
      const Vec3 axis(r[0], r[1], r[2]);
      if (!(axis.norm() > 0)) fail(e, "has an axis without a direction");
      out.linear() =
          Eigen::AngleAxisd(r[3] * std::numbers::pi / 180, axis.normalized()).toRotationMatrix();
    } else if (kind == "lookat" || kind == "skew") {
      fail(e, "isn't read; write the node's place as a <matrix>");
    }
    return out;
  }

  void add_node(const XMLElement& node, Eigen::Affine3d world, int depth) {
    if (depth > kDeepestNode) fail(node, "stands for itself, or nodes are nested too deep");
    if (++nodes_ > kMostNodes) fail(node, fmt::format("is one of more than {} nodes", kMostNodes));
    for (const auto* e = node.FirstChildElement(); e != nullptr; e = e->NextSiblingElement())
      world = world * transform(*e);
    each(node, "instance_geometry",
         [&](const XMLElement& e) { add(named(e, "url", "geometry"), world); });
    each(node, "instance_controller", [&](const XMLElement& e) {
      fail(e, "is a skinned mesh, which isn't read; apply its modifiers before the export");
    });
    each(node, "node", [&](const XMLElement& e) { add_node(e, world, depth + 1); });
    each(node, "instance_node",
         [&](const XMLElement& e) { add_node(named(e, "url", "node"), world, depth + 1); });
  }

  /// The points of a <source> with x, y and z.
  std::vector<Vec3> points_of(const XMLElement& source) const {
    const XMLElement* array = source.FirstChildElement("float_array");
    if (array == nullptr) fail(source, "has no <float_array>");
    const std::vector<double> all = numbers(*array);
    const XMLElement* common = source.FirstChildElement("technique_common");
    const XMLElement* accessor =
        common != nullptr ? common->FirstChildElement("accessor") : nullptr;
    const XMLElement& how = accessor != nullptr ? *accessor : source;
    const std::size_t stride = count(how, "stride", 3), from = count(how, "offset", 0);
    if (stride < 3) fail(how, "must have a stride of 3 or more: x, y and z");
    std::vector<Vec3> points;
    for (std::size_t i = from; i + 3 <= all.size(); i += stride)
      points.emplace_back(all[i], all[i + 1], all[i + 2]);
    return points;
  }
  const std::vector<Vec3>& positions(const XMLElement& vertices) {
    const auto [known, is_new] = points_.try_emplace(&vertices);
    std::vector<Vec3>& points = known->second;
    if (!is_new) return points;
    each(vertices, "input", [&](const XMLElement& input) {
      if (input.Attribute("semantic", "POSITION") != nullptr)
        points = points_of(named(input, "source", "source"));
    });
    return points;
  }
  Corners corners_of(const XMLElement& faces) {
    Corners corners;
    each(faces, "input", [&](const XMLElement& input) {
      const std::size_t at = count(input, "offset", 0);
      corners.stride = std::max(corners.stride, at + 1);
      if (input.Attribute("semantic", "VERTEX") == nullptr) return;
      corners.at = at;
      corners.points = &positions(named(input, "source", "vertices"));
    });
    if (corners.points == nullptr) fail(faces, "has no <input semantic=\"VERTEX\"/>");
    return corners;
  }

  void add(const XMLElement& geometry, const Eigen::Affine3d& world) {
    const auto [known, is_new] = geometries_.try_emplace(&geometry);
    Triangles& all = known->second;
    if (is_new) {
      const XMLElement* mesh = geometry.FirstChildElement("mesh");
      if (mesh == nullptr) fail(geometry, "has no <mesh>; splines and other shapes aren't read");
      for (const auto* e = mesh->FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
        const std::string_view kind = e->Name();
        if (kind == "triangles" || kind == "polylist" || kind == "polygons" || kind == "trifans" ||
            kind == "tristrips")
          add_faces(*e, kind, all);
      }
    }
    if (all.size() > kMostTriangles - triangles_.size())
      fail(geometry, fmt::format("makes more than {} triangles with its nodes", kMostTriangles));
    for (const auto& t : all)
      triangles_.push_back({Vec3(world * t[0]), Vec3(world * t[1]), Vec3(world * t[2])});
  }

  void add_faces(const XMLElement& faces, std::string_view kind, Triangles& to) {
    const Corners corners = corners_of(faces);
    if (const XMLElement* hole = faces.FirstChildElement("ph"))
      fail(*hole, "is a face with holes, which isn't read; split faces into triangles");
    std::vector<std::size_t> sizes;  // of the faces of a polylist
    if (const XMLElement* vcount = faces.FirstChildElement("vcount")) sizes = indices(*vcount);
    each(faces, "p", [&](const XMLElement& p) {
      const std::vector<std::size_t> all = indices(p);
      if (all.size() % corners.stride != 0)
        fail(p, fmt::format("has {} indices; each corner has {}", all.size(), corners.stride));
      std::vector<Vec3> face;
      for (std::size_t i = corners.at; i < all.size(); i += corners.stride) {
        if (all[i] >= corners.points->size())
          fail(p, fmt::format("has the corner {}; there are {} points", all[i],
                              corners.points->size()));
        face.push_back((*corners.points)[all[i]]);
      }
      if (kind == "polylist") {
        std::size_t from = 0;
        for (const std::size_t size : sizes) {
          if (size > face.size() - from) fail(p, "has fewer corners than <vcount> says");
          add_fan({face.data() + from, size}, to);
          from += size;
        }
        if (from != face.size()) fail(p, "has more corners than <vcount> says");
      } else if (kind == "triangles") {
        if (face.size() % 3 != 0) fail(p, "has a triangle without three corners");
        for (std::size_t i = 0; i < face.size(); i += 3) add_fan({face.data() + i, 3}, to);
      } else if (kind == "tristrips") {
        for (std::size_t i = 2; i < face.size(); ++i)
          to.push_back({face[i - 2 + i % 2], face[i - 1 - i % 2], face[i]});
      } else {
        add_fan(face, to);
      }
    });
  }
  static void add_fan(std::span<const Vec3> face, Triangles& to) {
    for (std::size_t k = 2; k < face.size(); ++k) to.push_back({face[0], face[k - 1], face[k]});
  }

  const std::filesystem::path& file_;
  tinyxml2::XMLDocument document_;
  std::map<std::string, const XMLElement*, std::less<>> by_id_;
  std::map<const XMLElement*, std::vector<Vec3>> points_;  // of <vertices>
  std::map<const XMLElement*, Triangles> geometries_;      // in their own frames
  std::size_t nodes_ = 0;
  Triangles triangles_;
};

}  // namespace

std::vector<std::array<Vec3, 3>> read_collada(const std::filesystem::path& file) {
  return Collada(file).take();
}

}  // namespace soilvdb::inline v0::io
