// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// LandXML surfaces.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "io/file/text.h"
#include "io/terrain/landxml_stream.h"
#include "io/terrain/tin.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostRow_bytes = 1000, kMostSurfaces = 1000;

/// The numbers of a row, apart by white space; empty if it has others than `count`, or other words.
std::optional<std::array<double, 3>> three_numbers(std::string_view row) {
  constexpr std::string_view kWhite = " \t\r\n";
  std::array<double, 3> all{};
  std::size_t count = 0;
  for (std::size_t at = row.find_first_not_of(kWhite); at != row.npos;
       at = row.find_first_not_of(kWhite, at)) {
    const std::size_t end = row.find_first_of(kWhite, at);
    const auto value = parse_number(row.substr(at, end - at));
    if (count == all.size() || !value || !(std::abs(*value) <= kMaxNumber)) return std::nullopt;
    all[count++] = *value;
    at = end;
  }
  return count == all.size() ? std::optional(all) : std::nullopt;
}

class LandXmlReader final : LandXmlStream {
 public:
  explicit LandXmlReader(const FilePart& from) : LandXmlStream(from.file), from_(from) {}

  TinInput read() {
    parse();
    return chosen();
  }

 private:
  enum class Element { kOther, kSurface, kDefinition, kPoint, kFace };

  Element opened(std::string_view name, const char** attributes) {
    const Element in = open_.empty() ? Element::kOther : open_.back();
    if (name == "Surface") {
      if (names_.size() == kMostSurfaces) fail("has more than 1000 surfaces");
      const char* const given = attribute(attributes, "name");
      name_ = given != nullptr ? given : "";
      return Element::kSurface;
    } else if (name == "Definition" && in == Element::kSurface) {
      const char* const type = attribute(attributes, "surfType");
      if (type != nullptr && std::string_view(type) != "TIN") return Element::kOther;
      names_.push_back(name_);
      // By its number until one has that name; choose_surface() finds out whether it is clear.
      const bool is_named = !from_.part.empty() && name_ == from_.part;
      wanted_ = !named_ && (is_named || number_ == names_.size());
      named_ = named_ || is_named;
      if (wanted_) {
        input_.tin = {};
        ids_.clear();
      }
      return Element::kDefinition;
    } else if (name == "P" && in == Element::kDefinition && wanted_) {
      const char* const id = attribute(attributes, "id");
      id_ = id != nullptr ? id : "";
      return Element::kPoint;
    } else if (name == "F" && in == Element::kDefinition && wanted_) {
      const char* const invisible = attribute(attributes, "i");
      return invisible != nullptr && std::string_view(invisible) == "1" ? Element::kOther
                                                                        : Element::kFace;
    }
    // Pnts and Faces; other lists of a surface, such as breaklines, have no points of its TIN.
    return in == Element::kDefinition && (name == "Pnts" || name == "Faces") ? Element::kDefinition
                                                                             : Element::kOther;
  }

  void begin(std::string_view name, const char** attributes) override {
    open_.push_back(opened(name, attributes));
    if (open_.back() != Element::kOther) text_.clear();  // points may have tags within
  }

  void add(std::string_view text) override {
    if (open_.empty() || (open_.back() != Element::kPoint && open_.back() != Element::kFace))
      return;
    if (text_.size() + text.size() > kMostRow_bytes) fail("has a point or face of over 1000 bytes");
    text_ += text;
  }

  void end() override {
    const Element element = open_.back();
    open_.pop_back();
    if (element == Element::kPoint) add_point();
    if (element == Element::kFace) add_face();
  }

  void add_point() {
    const auto point = three_numbers(text_);
    if (!point)
      fail(fmt::format("point '{}' is '{}'; it must be northing, easting and elevation",
                       printable(id_), printable(text_)));
    Tin& tin = input_.tin;
    if (tin.points.size() == kMostTinPoints) fail("has more than 10 million points");
    if (!ids_.emplace(id_, static_cast<std::uint32_t>(tin.points.size())).second)
      fail(fmt::format("there are two points '{}'", printable(id_)));
    tin.points.emplace_back((*point)[1], (*point)[0], (*point)[2]);
  }

  void add_face() {
    constexpr std::string_view kWhite = " \t\r\n";
    std::array<std::uint32_t, 3> face{};
    std::size_t count = 0;
    const std::string_view row = text_;
    for (std::size_t at = row.find_first_not_of(kWhite); at != row.npos;
         at = row.find_first_not_of(kWhite, at)) {
      const std::size_t end = row.find_first_of(kWhite, at);
      const auto point = ids_.find(std::string(row.substr(at, end - at)));
      if (count < face.size() && point == ids_.end())
        fail(fmt::format("there is no point '{}' of this face",
                         printable(row.substr(at, end - at))));
      if (count < face.size()) face[count] = point->second;
      ++count;
      at = end;
    }
    if (count != face.size())
      fail(fmt::format("face '{}' has {} points; 3 are needed", printable(text_), count));
    if (input_.tin.faces.size() == kMostTinFaces) fail("has more than 20 million faces");
    input_.tin.faces.push_back(face);
  }

  TinInput chosen() {
    choose_surface(from_, names_);
    if (input_.tin.faces.empty())
      throw InputError(from_.file, fmt::format("the surface has {} points and no visible faces; "
                                               "export it with its triangles",
                                               input_.tin.points.size()));
    if (input_.unit.empty())
      input_.doubts.emplace_back("gives no Units; its coordinates are taken as metres");
    return std::move(input_);
  }

  const FilePart& from_;
  std::vector<Element> open_;
  std::string name_, id_, text_;
  std::vector<std::string> names_;
  const std::size_t number_ =  ///< of the surface if its name isn't clear
      from_.part.empty() ? 1 : parsed<std::size_t>(from_.part).value_or(0);
  bool wanted_ = false, named_ = false;
  std::unordered_map<std::string, std::uint32_t> ids_;
};

}  // namespace

TinInput read_landxml(const FilePart& from) { return LandXmlReader(from).read(); }

std::size_t choose_surface(const FilePart& from, const std::vector<std::string>& names) {
  constexpr std::size_t kListed = 20;
  if (names.empty())
    throw InputError(from.file, "has no surface of triangles (TIN); export one with its faces");
  if (from.part.empty() && names.size() == 1) return 0;
  const auto is_clear = [&](const std::string& name) {
    return !name.empty() && std::count(names.begin(), names.end(), name) == 1;
  };
  const auto at =
      static_cast<std::size_t>(std::find(names.begin(), names.end(), from.part) - names.begin());
  if (is_clear(from.part)) return at;
  // A number never takes the place of a name that another version of the file lacks.
  const std::size_t number = parsed<std::size_t>(from.part).value_or(0);
  if (at == names.size() && number > 0 && number <= names.size() && !is_clear(names[number - 1]))
    return number - 1;
  std::vector<std::string> listed;
  for (const std::string& name : names)
    if (listed.size() < kListed) listed.push_back(printable(name));
  const auto unclear = static_cast<std::size_t>(
      std::find_if_not(names.begin(), names.end(), is_clear) - names.begin());
  const bool several = !from.part.empty() && at < names.size();
  throw InputError(
      from.file,
      fmt::format("has {}{}{}; {}, as in {}#{}",
                  from.part.empty() ? fmt::format("{} surfaces, ", names.size())
                  : several         ? fmt::format("several surfaces '{}': ", printable(from.part))
                                    : fmt::format("no surface '{}', but ", printable(from.part)),
                  quoted_list(listed), names.size() > kListed ? " and others" : "",
                  unclear < names.size()
                      ? "name one, or give the number of one without a name of its own"
                      : "name one",
                  from.file.filename().string(),
                  several        ? std::to_string(at + 1)
                  : unclear == 0 ? "1"
                                 : listed.front()));
}

}  // namespace soilvdb::inline v0::io
