// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads URDF: links, joints, and their frames, axes and limits.
#include "soilvdb/io/urdf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "core/constants.h"
#include "io/file/json.h"
#include "io/file/text.h"
#include "io/file/xml.h"
#include "io/mesh/mesh_boxes.h"
#include "soilvdb/io/mesh_file.h"

namespace soilvdb::inline v0::io {
namespace {

using tinyxml2::XMLElement;

constexpr std::size_t kMaxUrdfBytes = 16 << 20;

/// The links and joints of a URDF file.
class Robot {
 public:
  Robot(const std::filesystem::path& file, std::string_view text) : file_(file) {
    const XMLElement& robot =
        parse_xml(file_, text, "a URDF begins with <robot name=\"...\">", document_);
    if (robot.Name() != std::string_view("robot")) fail(robot, "is not the <robot> of a URDF");
    refuse_xacro(robot);
    for (const auto* e = robot.FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
      const std::string_view kind = e->Name();
      if (kind == "link") {
        unique(links_, *e);
      } else if (kind == "joint") {
        unique(joints_, *e);
        by_child_.emplace(linked(*e, "child"), e);
      }
    }
    if (links_.empty()) fail(robot, "has no link");
  }

  bool has_link(const std::string& link) const { return links_.contains(link); }
  std::string nearest_link(const std::string& link) const {
    std::vector<std::string> names;
    for (const auto& [name, xml] : links_) names.push_back(name);
    return printable(nearest(link, names));
  }

  /// Shapes of all links that a machine's joints place: its own, or else what is drawn of it.
  LinkBodies::Read bodies(const std::vector<std::string>& joints) const {
    LinkBodies::Read all;
    std::string first;
    int unread = 0;
    for (const auto& [name, link] : links_) {
      const char* which = link->FirstChildElement("collision") != nullptr ? "collision" : "visual";
      if (link->FirstChildElement(which) == nullptr) continue;
      const auto count_unread = [&](const InputError& e) {
        if (unread++ == 0) first = e.what();
      };
      std::optional<LinkBody> placed;
      try {
        if (!is_free(name)) placed = place(name, joints);
      } catch (const InputError& e) {
        count_unread(e);
      }
      if (!placed) continue;
      for (const auto* shape = link->FirstChildElement(which); shape != nullptr;
           shape = shape->NextSiblingElement(which)) {
        try {
          LinkBody body = *placed;
          body.boxes_m = boxes(*shape);
          body.link.link_from_bucket = origin(*shape);
          all.bodies.push_back(std::move(body));
        } catch (const InputError& e) {
          count_unread(e);
        }
      }
    }
    if (unread > 0)
      all.warning = fmt::format(
          "{}: {} shape{} of links can't be read, so that scans take {} for ground (first: {})",
          file_.string(), unread, unread == 1 ? "" : "s", unread == 1 ? "it" : "them", first);
    return all;
  }

  /// The joints from the root link to `link`, then joints that these mimic.
  std::vector<Joint> chain(const std::string& link) const {
    std::vector<Joint> chain;
    for (std::string child = link; by_child_.contains(child);) {
      const auto [first, last] = by_child_.equal_range(child);
      const XMLElement& joint = *first->second;
      if (std::next(first) != last) {
        const XMLElement& other = *std::next(first)->second;
        fail(other, fmt::format("leads to link '{}', as joint '{}' does; a link has one parent",
                                printable(child), printable(attribute(joint, "name"))));
      }
      if (chain.size() == joints_.size()) {
        fail(joint, fmt::format("is part of a loop, so link '{}' has no root", printable(link)));
      }
      chain.push_back(read(joint));
      child = linked(joint, "parent");
    }
    std::reverse(chain.begin(), chain.end());
    for (std::size_t i = 0; i < chain.size(); ++i) {
      const std::string& name = chain[i].mimics;
      if (name.empty() ||
          std::any_of(chain.begin(), chain.end(), [&](const Joint& j) { return j.name == name; }))
        continue;
      Joint beside = read(*joints_.at(name));
      beside.beside = true;
      chain.push_back(std::move(beside));
    }
    return chain;
  }

 private:
  using Named = std::map<std::string, const XMLElement*>;

  [[noreturn]] void fail(const XMLElement& at, const std::string& message) const {
    const XMLElement* named = &at;  // the enclosing joint or link
    while (named->Attribute("name") == nullptr && named->Parent()->ToElement() != nullptr)
      named = named->Parent()->ToElement();
    const char* name = named->Attribute("name");
    throw InputError(file_, at.GetLineNum(),
                     name == nullptr ? fmt::format("<{}> {}", printable(named->Name()), message)
                                     : fmt::format("{} '{}' {}", printable(named->Name()),
                                                   printable(name), message));
  }

  /// Refuses xacro, which must first be expanded to URDF.
  void refuse_xacro(const XMLElement& element) const {
    bool is_it = std::string_view(element.Name()).starts_with("xacro:");
    for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) {
      const std::string_view value = a->Value();
      is_it |= value.find("${") != value.npos || value.find("$(") != value.npos;
    }
    if (is_it) {
      std::filesystem::path urdf = file_.filename();
      if (urdf.extension() == ".xacro") urdf.replace_extension();
      urdf.replace_extension(".urdf");
      if (urdf == file_.filename()) urdf.replace_filename(urdf.stem().string() + "_made.urdf");
      fail(element, fmt::format("is written in xacro; make a URDF of it first: xacro {} > {}",
                                shell_quoted(file_.filename()), shell_quoted(urdf)));
    }
    for (const auto* e = element.FirstChildElement(); e != nullptr; e = e->NextSiblingElement())
      refuse_xacro(*e);
  }

  std::string attribute(const XMLElement& element, const char* name) const {
    const char* value = element.Attribute(name);
    if (value == nullptr || *value == '\0') fail(element, fmt::format("has no {}=\"...\"", name));
    // The file is UTF-8, but character references can produce other bytes.
    if (!is_utf8(value)) {
      throw InputError(file_, element.GetLineNum(),
                       fmt::format("'{}' isn't UTF-8; write it without '&#'", name));
    }
    return value;
  }

  void unique(Named& elements, const XMLElement& element) const {
    if (!elements.emplace(attribute(element, "name"), &element).second)
      fail(element, "is there twice; rename one");
  }

  /// The name of the link in a joint's <parent> or <child>.
  std::string linked(const XMLElement& joint, const char* which) const {
    const XMLElement* element = joint.FirstChildElement(which);
    if (element == nullptr) fail(joint, fmt::format("has no <{} link=\"...\"/>", which));
    return attribute(*element, "link");
  }

  double number(const XMLElement& element, std::string_view text) const {
    const std::optional<double> value = parse_number(text);
    if (!value || !(std::abs(*value) <= kMaxNumber))
      fail(element, fmt::format("has '{}' where a number is needed, -1e9 to 1e9", printable(text)));
    return *value;
  }

  /// The three numbers of an attribute of a joint's child; `otherwise` if there is no such child.
  Vec3 numbers(const XMLElement& joint, const char* child, const char* name, Vec3 otherwise) const {
    const XMLElement* element = joint.FirstChildElement(child);
    const char* text = element == nullptr ? nullptr : element->Attribute(name);
    if (text == nullptr) return otherwise;
    std::istringstream stream(text);
    const std::vector<std::string> words{std::istream_iterator<std::string>(stream), {}};
    if (words.size() != 3) {
      fail(*element, fmt::format("has {}=\"{}\" in <{}>; it must be three numbers", name,
                                 printable(text), child));
    }
    for (int i = 0; i < 3; ++i) otherwise[i] = number(*element, words[static_cast<std::size_t>(i)]);
    return otherwise;
  }

  /// Is a link below a joint of a kind that no number places?
  bool is_free(std::string link) const {
    for (std::size_t n = 0; n < joints_.size() && by_child_.contains(link); ++n) {
      const XMLElement& joint = *by_child_.find(link)->second;
      const std::string type = attribute(joint, "type");
      if (type == "floating" || type == "planar") return true;
      link = linked(joint, "parent");
    }
    return false;
  }

  /// Where a link is by a machine's joints; empty if other joints move it.
  std::optional<LinkBody> place(const std::string& link,
                                const std::vector<std::string>& joints) const {
    LinkBody body;
    body.link.joints = chain(link);
    for (const std::string& joint : body.link.movable()) {
      const auto at = std::find(joints.begin(), joints.end(), joint);
      if (at == joints.end()) return {};
      body.joints.push_back(static_cast<std::size_t>(at - joints.begin()));
    }
    return body;
  }

  Pose origin(const XMLElement& in) const {
    const Vec3 rpy = numbers(in, "origin", "rpy", Vec3::Zero());
    return {numbers(in, "origin", "xyz", Vec3::Zero()), from_rpy(rpy.x(), rpy.y(), rpy.z())};
  }

  /// A length of a shape, m.
  double length(const XMLElement& shape, const char* name) const {
    const double value = number(shape, attribute(shape, name));
    if (!(value > 0))
      fail(shape, fmt::format("has {}=\"{}\"; it must be more than 0", name, value));
    return value;
  }

  /// Boxes about a <collision> or <visual>, in its own frame, m.
  std::vector<Eigen::AlignedBox3d> boxes(const XMLElement& in) const {
    const XMLElement* geometry = in.FirstChildElement("geometry");
    const XMLElement* shape = geometry == nullptr ? nullptr : geometry->FirstChildElement();
    if (shape == nullptr) fail(in, "has no <geometry> with a shape");
    const std::string_view kind = shape->Name();
    const auto about = [](const Vec3& half) {
      return std::vector{Eigen::AlignedBox3d(-half, half)};
    };
    if (kind == "box") {
      attribute(*shape, "size");
      const Vec3 size = numbers(*geometry, "box", "size", Vec3::Zero());
      if (!(size.minCoeff() > 0)) fail(*shape, "has a size that is not more than 0");
      return about(size / 2);
    }
    if (kind == "sphere") return about(Vec3::Constant(length(*shape, "radius")));
    if (kind == "cylinder") {
      const double radius = length(*shape, "radius");
      return about({radius, radius, length(*shape, "length") / 2});
    }
    if (kind != "mesh") fail(*shape, "is no box, cylinder, sphere or mesh");
    const Vec3 scale = numbers(*geometry, "mesh", "scale", Vec3::Ones());
    const Mesh mesh = read_mesh(mesh_file(*shape));
    std::vector<std::array<Vec3, 3>> triangles;
    for (const auto& corners : mesh.triangles) {
      std::array<Vec3, 3>& triangle = triangles.emplace_back();
      for (std::size_t k = 0; k < 3; ++k)
        triangle[k] = mesh.points[corners[k]].cast<double>().cwiseProduct(scale);
    }
    return boxes_about(triangles, kMaskRoomM);
  }

  /// The file of a <mesh>. Of package://NAME/PATH, the folder NAME is sought at and above that of
  /// the URDF, and beside these. If the package's folder has another name, or there is none, PATH
  /// is sought at and above that of the URDF, and its last part beside the URDF.
  std::filesystem::path mesh_file(const XMLElement& mesh) const {
    const std::string name = attribute(mesh, "filename");
    constexpr std::string_view kFile = "file://", kPackage = "package://";
    const std::filesystem::path folder = file_.parent_path();  // absolute, as bodies() needs it
    if (name.starts_with(kFile)) return name.substr(kFile.size());
    if (!name.starts_with(kPackage)) return folder / name;
    const std::filesystem::path in_package = name.substr(kPackage.size());
    const std::filesystem::path package = in_package.empty() ? "" : *in_package.begin();
    const std::filesystem::path path = in_package.lexically_relative(package);
    std::vector<std::filesystem::path> places;
    for (std::filesystem::path at = folder; at != at.root_path(); at = at.parent_path())
      places.insert(places.end(), {at.parent_path() / in_package, at / in_package});
    places.insert(places.end(),
                  {folder / path, folder.parent_path() / path, folder / path.filename()});
    std::error_code none;
    for (const std::filesystem::path& file : places)
      if (std::filesystem::is_regular_file(file, none)) return file;
    fail(mesh,
         fmt::format("has '{}', and no folder '{}' at or above the URDF has that file, nor the "
                     "URDF's own",
                     printable(name), printable(package.string())));
  }

  /// The velocity limit; unlimited if it is 0, which many files use for unknown, or beyond any
  /// machine's.
  double fastest(const XMLElement& limit) const {
    const char* text = limit.Attribute("velocity");
    if (text == nullptr) return 0;
    const std::optional<double> value = parse_number(text);
    if (!value || std::isnan(*value))
      fail(limit, fmt::format("has velocity=\"{}\" in <limit>; it must be a number of rad/s or m/s",
                              printable(text)));
    return *value > 0 && *value <= kMaxNumber ? *value : 0;
  }

  Joint::Type type(const XMLElement& joint) const {
    const std::string type = attribute(joint, "type");
    if (type == "fixed") return Joint::Type::kFixed;
    if (type == "revolute") return Joint::Type::kRevolute;
    if (type == "continuous") return Joint::Type::kContinuous;
    if (type == "prismatic") return Joint::Type::kPrismatic;
    fail(joint, fmt::format("is {}; it must be fixed, revolute, continuous or prismatic",
                            printable(type)));
  }

  /// Sets the joint that it mimics, through joints that mimic others themselves.
  void follow(const XMLElement& in, Joint& joint) const {
    std::size_t followed = 0;
    for (const auto* mimic = in.FirstChildElement("mimic"); mimic != nullptr;) {
      joint.mimics = attribute(*mimic, "joint");
      const auto at = joints_.find(joint.mimics);
      if (at == joints_.end()) {
        std::vector<std::string> names;
        for (const auto& [name, xml] : joints_) names.push_back(name);
        fail(*mimic, fmt::format("mimics joint '{}', which does not exist; did you mean '{}'?",
                                 printable(joint.mimics), printable(nearest(joint.mimics, names))));
      }
      if (type(*at->second) == Joint::Type::kFixed)
        fail(*mimic, fmt::format("mimics joint '{}', which is fixed", printable(joint.mimics)));
      if (followed++ > joints_.size()) fail(in, "mimics itself, through other joints");
      const auto value = [&](const char* name, double otherwise) {
        const char* text = mimic->Attribute(name);
        return text == nullptr ? otherwise : number(*mimic, text);
      };
      joint.offset += joint.multiplier * value("offset", 0);
      joint.multiplier *= value("multiplier", 1);
      mimic = at->second->FirstChildElement("mimic");
    }
  }

  Joint read(const XMLElement& in) const {
    Joint joint;
    joint.name = attribute(in, "name");
    if (const std::string parent = linked(in, "parent"); !has_link(parent)) {
      fail(in, fmt::format("has the parent link '{}', which does not exist; did you mean '{}'?",
                           printable(parent), nearest_link(parent)));
    }
    joint.type = type(in);
    joint.parent_from_joint = origin(in);
    if (joint.type == Joint::Type::kFixed) return joint;
    follow(in, joint);
    const Vec3 axis = numbers(in, "axis", "xyz", Vec3::UnitX());
    if (axis.norm() < 1e-9) {
      fail(in, fmt::format("has the axis {} {} {}; it must have a direction", axis.x(), axis.y(),
                           axis.z()));
    }
    joint.axis = axis.normalized();
    const XMLElement* limit = in.FirstChildElement("limit");
    if (limit != nullptr) joint.fastest = fastest(*limit);
    if (joint.type == Joint::Type::kContinuous) return joint;
    if (limit == nullptr)
      fail(in, R"(has no <limit lower="..." upper="..."/>; without limits it is continuous)");
    if (const char* lower = limit->Attribute("lower")) joint.lower = number(*limit, lower);
    if (const char* upper = limit->Attribute("upper")) joint.upper = number(*limit, upper);
    if (joint.lower > joint.upper) {
      fail(in, fmt::format("has the lower limit {} above its upper limit {}; swap them",
                           joint.lower, joint.upper));
    }
    return joint;
  }

  const std::filesystem::path& file_;
  tinyxml2::XMLDocument document_;
  Named links_, joints_;
  std::multimap<std::string, const XMLElement*> by_child_;
};

}  // namespace

std::string limits_in_degrees(const Chain& chain) {
  // Hoses and cables allow little more than a turn either way.
  constexpr double kMostLimit_rad = 6.3;
  std::vector<std::string> names;
  std::string first;
  for (const Joint& joint : chain.joints) {
    if (joint.type != Joint::Type::kRevolute ||
        std::max(std::abs(joint.lower), std::abs(joint.upper)) <= kMostLimit_rad)
      continue;
    if (names.empty()) first = fmt::format("{:g} to {:g}", joint.lower, joint.upper);
    names.push_back(printable(joint.name));
  }
  if (names.empty()) return {};
  return fmt::format(
      "limits of joint{} {} are beyond a turn (first: {}): they look like degrees, "
      "and a urdf has radians",
      names.size() == 1 ? "" : "s", quoted_list(names), first);
}

Chain read_chain(const std::filesystem::path& file, const std::string& link) {
  const std::string text = read_text(file, kMaxUrdfBytes);
  const Robot robot(file, text);
  if (!robot.has_link(link)) {
    throw std::invalid_argument(fmt::format("no link '{}' in {}; did you mean '{}'?",
                                            printable(link), file.filename().string(),
                                            robot.nearest_link(link)));
  }
  Chain chain;
  chain.joints = robot.chain(link);
  for (const Joint& joint : chain.joints) {
    if (joint.moves_itself() && joint.name == "time") {
      throw InputError(file, "joint 'time' has the name of the motion's first column; rename it");
    }
  }
  chain.bodies = std::make_shared<const LinkBodies>(
      [file = std::filesystem::absolute(file), text, joints = chain.movable()] {
        return Robot(file, text).bodies(joints);
      });
  return chain;
}

}  // namespace soilvdb::inline v0::io
