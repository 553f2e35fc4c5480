// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// URDF by urdfdom, whose complaints become the message of an InputError.
#include "io/urdf.h"

#include <console_bridge/console.h>
#include <cpl_string.h>
#include <fmt/format.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <cctype>
#include <mutex>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "io/text.h"

namespace soilvdb::io {
namespace {

constexpr std::size_t kMaxBytes = 16 << 20;
constexpr int kMaxDepth = 64;  // elements within elements; a URDF has about five

long line_at(std::string_view text, std::size_t position) {
  return 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(position), '\n');
}

/// Refuses what isn't UTF-8: the parser steps over the end of text that ends within a character.
void check_encoding(const std::filesystem::path& file, std::string_view text) {
  for (std::size_t from = 0, end = 0; from < text.size(); from = end + 1) {
    end = std::min(text.find('\n', from), text.size());
    if (!CPLIsUTF8(text.data() + from, static_cast<int>(end - from)))
      throw InputError(file, line_at(text, from), "isn't UTF-8; convert the file to that");
  }
}

/// Overwrites comments with blanks, so that what they hold is neither checked nor found.
void blank_comments(const std::filesystem::path& file, std::string& text) {
  for (std::size_t from = 0; (from = text.find("<!--", from)) != text.npos;) {
    const auto end = text.find("-->", from + 4);
    if (end == text.npos) {
      throw InputError(file, line_at(text, from), "a comment isn't closed; '-->' is missing");
    }
    for (; from < end + 3; ++from) {
      if (text[from] != '\n') text[from] = ' ';
    }
  }
}

/// Refuses what could exhaust the parser's memory or stack, and all that the parser might see
/// otherwise than it is counted here.
void check_structure(const std::filesystem::path& file, std::string_view text) {
  constexpr std::string_view kLiteral = "<![CDATA[", kLiteralEnd = "]]>";
  const std::size_t first = text.find('<');
  int depth = 0;
  for (std::size_t i = 0; (i = text.find('<', i)) != text.npos;) {
    const std::size_t start = i;
    const auto fail = [&](const std::string& message) {
      throw InputError(file, line_at(text, start), message);
    };
    const auto rest = text.substr(i);
    if (rest.starts_with("<!DOCTYPE") || rest.starts_with("<!ENTITY")) {
      fail("document type and entity declarations are not accepted; remove them");
    }
    if (rest.starts_with(kLiteral)) {
      i = text.find(kLiteralEnd, i);
      if (i == text.npos) fail("a CDATA section isn't closed; ']]>' is missing");
      continue;
    }
    const char kind = rest.size() > 1 ? rest[1] : ' ';
    const bool declaration = i == first && rest.starts_with("<?xml");
    if (!declaration && kind != '/' && kind != '_' && kind >= 0 && !std::isalpha(kind)) {
      fail("only elements and comments are accepted after '<'; remove what is not one");
    }
    char quote = 0;
    for (++i; i < text.size() && (quote || text[i] != '>'); ++i) {
      if (quote) {
        if (text[i] == quote) quote = 0;
      } else if (text[i] == '"' || text[i] == '\'') {
        quote = text[i];
      }
    }
    if (i == text.size()) fail("a tag isn't closed; the file may be cut short");
    if (kind == '/') {
      if (--depth < 0) fail("an element is closed that wasn't opened");
    } else if (!declaration && text[i - 1] != '/') {
      if (++depth > kMaxDepth) {
        fail(fmt::format("elements are nested more than {} deep", kMaxDepth));
      }
    }
  }
}

/// Keeps urdfdom's first error instead of printing it. console_bridge has one handler per process.
class Silence : public console_bridge::OutputHandler {
 public:
  Silence() : lock_(mutex_) { console_bridge::useOutputHandler(this); }
  ~Silence() override { console_bridge::restorePreviousOutputHandler(); }
  void log(const std::string& text, console_bridge::LogLevel level, const char*, int) override {
    if (level >= console_bridge::CONSOLE_BRIDGE_LOG_ERROR && first_error_.empty()) {
      first_error_ = text;
    }
  }
  const std::string& first_error() const { return first_error_; }

 private:
  static inline std::mutex mutex_;
  std::lock_guard<std::mutex> lock_;
  std::string first_error_;
};

urdf::ModelInterfaceSharedPtr parse(const std::filesystem::path& file, const std::string& text) {
  Silence silence;
  urdf::ModelInterfaceSharedPtr model;
  std::string error;
  try {
    model = urdf::parseURDF(text);
  } catch (const std::exception& e) {
    error = e.what();
  }
  if (model) {
    // Links own their children, so links in a loop would keep each other alive; not needed here.
    for (const auto& [name, link] : model->links_) {
      link->child_links.clear();
      link->child_joints.clear();
    }
    return model;
  }
  if (!silence.first_error().empty()) error = silence.first_error();
  while (!error.empty() && (error.back() == '\n' || error.back() == '.')) error.pop_back();
  throw InputError(file, fmt::format("is not a valid URDF: {}", error.substr(0, error.find('\n'))));
}

/// Makes the joint ours, or says why it can't be.
class JointReader {
 public:
  JointReader(const std::filesystem::path& file, std::string_view text)
      : file_(file), text_(text) {}

  Joint read(const urdf::Joint& in) const {
    Joint joint;
    joint.name = in.name;
    joint.parent_from_joint = pose(in);
    if (in.mimic) {
      fail(in, fmt::format("mimics joint '{}', which is not supported; make it a joint of its own "
                           "with its own column in the motion",
                           printable(in.mimic->joint_name)));
    }
    switch (in.type) {
      case urdf::Joint::FIXED:
        return joint;
      case urdf::Joint::REVOLUTE:
        joint.type = Joint::Type::kRevolute;
        break;
      case urdf::Joint::CONTINUOUS:
        joint.type = Joint::Type::kContinuous;
        break;
      case urdf::Joint::PRISMATIC:
        joint.type = Joint::Type::kPrismatic;
        break;
      default:
        fail(in, fmt::format("is {}; it must be fixed, revolute, continuous or prismatic",
                             in.type == urdf::Joint::FLOATING ? "floating" : "planar"));
    }
    const Vec3 axis(in.axis.x, in.axis.y, in.axis.z);
    if (!(axis.cwiseAbs().maxCoeff() <= kMaxNumber) || axis.norm() < 1e-9) {
      fail(in, fmt::format("has the axis {} {} {}; it must have a direction", axis.x(), axis.y(),
                           axis.z()));
    }
    joint.axis = axis.normalized();
    if (in.limits && joint.type != Joint::Type::kContinuous) {
      joint.lower = in.limits->lower;
      joint.upper = in.limits->upper;
      if (!(joint.lower <= joint.upper)) {
        fail(in, fmt::format("has the lower limit {} above its upper limit {}; swap them",
                             joint.lower, joint.upper));
      }
    }
    return joint;
  }

  [[noreturn]] void fail(const urdf::Joint& joint, const std::string& message) const {
    const std::string text = fmt::format("joint '{}' {}", printable(joint.name), message);
    for (auto at = text_.find("<joint"); at != text_.npos; at = text_.find("<joint", at + 1)) {
      const auto tag = text_.substr(at, text_.find('>', at) - at);
      if (tag.find('"' + joint.name + '"') != tag.npos ||
          tag.find('\'' + joint.name + '\'') != tag.npos) {
        throw InputError(file_, line_at(text_, at), text);
      }
    }
    throw InputError(file_, text);
  }

 private:
  Pose pose(const urdf::Joint& in) const {
    const urdf::Pose& p = in.parent_to_joint_origin_transform;
    Pose pose;
    pose.position = {p.position.x, p.position.y, p.position.z};
    pose.rotation = Eigen::Quaterniond(p.rotation.w, p.rotation.x, p.rotation.y, p.rotation.z);
    if (!(pose.position.cwiseAbs().maxCoeff() <= kMaxNumber) || !(pose.rotation.norm() > 0.5)) {
      fail(in, "has an origin that is not a finite number");
    }
    pose.rotation.normalize();
    return pose;
  }

  const std::filesystem::path& file_;
  std::string_view text_;
};

}  // namespace

Chain read_chain(const std::filesystem::path& file, const std::string& link) {
  std::string text = read_text(file, kMaxBytes);
  blank_comments(file, text);
  check_encoding(file, text);
  check_structure(file, text);
  const auto model = parse(file, text);

  if (!model->links_.contains(link)) {
    std::vector<std::string> links;
    for (const auto& [name, unused] : model->links_) links.push_back(name);
    throw std::invalid_argument(fmt::format("no link '{}' in {}; did you mean '{}'?",
                                            printable(link), file.filename().string(),
                                            printable(nearest(link, links))));
  }

  const JointReader reader(file, text);
  Chain chain;
  std::string child = link;
  while (child != model->getRoot()->name) {
    const urdf::Joint* parent_joint = nullptr;
    for (const auto& [name, joint] : model->joints_) {
      if (joint->child_link_name != child) continue;
      if (parent_joint) {
        reader.fail(*joint, fmt::format("leads to link '{}', as joint '{}' does; a link has one "
                                        "parent",
                                        printable(child), printable(parent_joint->name)));
      }
      parent_joint = joint.get();
    }
    if (!parent_joint || chain.joints.size() == model->joints_.size()) {
      throw InputError(file, fmt::format("link '{}' is not connected to the root link '{}'",
                                         printable(link), printable(model->getRoot()->name)));
    }
    chain.joints.push_back(reader.read(*parent_joint));
    child = parent_joint->parent_link_name;
  }
  std::reverse(chain.joints.begin(), chain.joints.end());
  for (const Joint& joint : chain.joints) {
    if (joint.type != Joint::Type::kFixed && joint.name == "time") {
      throw InputError(file, "joint 'time' has the name of the motion's first column; rename it");
    }
  }
  return chain;
}

}  // namespace soilvdb::io
