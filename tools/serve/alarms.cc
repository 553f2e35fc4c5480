// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/alarms.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

#include "core/tool/polygon.h"
#include "io/file/text.h"
#include "soilvdb/io/error.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

/// Depth below the design that the finest work keeps.
constexpr double kBelow_m = 0.05;
/// Room that a day of states and snapshots may take.
constexpr double kLeastRoom_MB = 500;
/// Beyond what networks delay.
constexpr double kMostClock_s = 5;
constexpr std::size_t kMostBoundary_bytes = 1 << 20;

Json alarm(const char* kind, const std::string* machine, const std::string& text) {
  return {
      {"kind", kind}, {"machine", machine != nullptr ? Json(*machine) : Json()}, {"text", text}};
}

/// How deep the lowest of three places of a lip is below a design, m.
double below_m(const InitialTerrain& design, const Pose& lip, double width_m) {
  const Vec3 along = lip.rotation * Vec3(0, width_m / 2, 0);
  std::array<Vec2, 3> places;
  std::array<double, 3> heights{};
  for (std::size_t i = 0; i < 3; ++i)
    places[i] = (lip.position + (double(i) - 1) * along).head<2>();
  heights_of(design)(places, heights);
  double deepest_m = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const double z = (lip.position + (double(i) - 1) * along).z();
    if (std::isfinite(heights[i])) deepest_m = std::max(deepest_m, heights[i] - z);
  }
  return deepest_m;
}

/// Distance from a boundary, m; 0 inside.
double outside_m(const std::vector<Vec2>& boundary, const Vec2& at) {
  if (inside(boundary, at)) return 0;
  double nearest_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < boundary.size(); ++i) {
    const Vec2 &a = boundary[i], b = boundary[(i + 1) % boundary.size()], way = b - a;
    const double share = std::clamp((at - a).dot(way) / way.squaredNorm(), 0.0, 1.0);
    nearest_m = std::min(nearest_m, (at - a - share * way).norm());
  }
  return nearest_m;
}

std::string age(double seconds) {
  return seconds < 120 ? fmt::format("{:.0f} s", seconds) : fmt::format("{:.0f} min", seconds / 60);
}

std::string lost(const FeedSource& source) {
  const auto since = [](FeedSource::Clock::time_point then) {
    return age(std::chrono::duration<double>(FeedSource::Clock::now() - then).count());
  };
  return source.link == FeedSource::Link::kBroken
             ? fmt::format("its connection broke off {} ago", since(source.broke_at))
             : fmt::format("nothing is heard of it for {}", since(source.heard_at));
}

}  // namespace

std::vector<Vec2> read_boundary(const std::filesystem::path& file) {
  std::vector<Vec2> boundary;
  const std::string text = io::read_text(file, kMostBoundary_bytes);
  long number = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    std::string_view line = std::string_view(text).substr(begin, end - begin);
    begin = end + 1;
    ++number;
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty()) continue;
    const std::size_t comma = std::min(line.find(','), line.size());
    const auto x = io::parse_number(line.substr(0, comma));
    const auto y = io::parse_number(line.substr(std::min(comma + 1, line.size())));
    if (!x || !y || !std::isfinite(*x) || !std::isfinite(*y))
      throw io::InputError(file, number,
                           fmt::format("'{}' is no corner x,y of a boundary", io::printable(line)));
    boundary.emplace_back(*x, *y);
  }
  if (boundary.size() > 1 && boundary.front() == boundary.back()) boundary.pop_back();
  if (boundary.size() < 3) throw io::InputError(file, "a boundary has 3 corners or more");
  return boundary;
}

Json alarms(const LiveSite& site, const InitialTerrain* design, const std::vector<Vec2>& boundary,
            const std::filesystem::path& folder) {
  Json all = Json::array();
  const Session& session = site.session();
  for (std::size_t i = 0; i < session.machines().size(); ++i) {
    if (session.is_retired(i)) continue;
    const SiteMachine& machine = session.machines()[i];
    const MachineFeed& feed = site.machine_feeds()[i];
    const auto add = [&](const char* kind, const std::string& text,
                         std::optional<double> by_m = {}) {
      all.push_back(alarm(kind, &machine.name, text));
      if (by_m) all.back()["by_m"] = *by_m;
    };
    if (feed.source != nullptr && feed.source->is_lost())
      add("feed_lost", fmt::format("{}; its last state came {} ago", lost(*feed.source),
                                   age(feed.silent_s().value_or(0))));
    if (feed.source == nullptr || feed.source->link == FeedSource::Link::kEnded) continue;
    if (feed.fix && *feed.fix != Fix::kFixed)
      add("fix", fmt::format("its position is {}, so it digs nothing", word_of(*feed.fix)));
    if (feed.clock_ahead_s && std::abs(*feed.clock_ahead_s) > kMostClock_s)
      add("clock", fmt::format("its times are {} {} this computer's clock",
                               age(std::abs(*feed.clock_ahead_s)),
                               *feed.clock_ahead_s > 0 ? "ahead of" : "behind"));
    const std::optional<MachineState> last = session.last(i);
    if (!last) continue;
    if (design != nullptr && !machine.bucket.shape)
      if (const double deep_m = below_m(*design, last->pose, machine.bucket.width_m);
          deep_m > kBelow_m)
        add("below_design", fmt::format("its lip is {:.2f} m below the design", deep_m), deep_m);
    if (!boundary.empty())
      if (const double far_m = outside_m(boundary, last->pose.position.head<2>()); far_m > 0)
        add("outside", fmt::format("it is {:.1f} m outside the boundary", far_m), far_m);
  }
  if (const std::string why = session.recording_fault(); !why.empty()) {
    all.push_back(alarm("recording", nullptr, why));
  } else if (!folder.empty()) {
    std::error_code none;
    const auto space = std::filesystem::space(folder, none);
    const double left_MB = static_cast<double>(space.available) / 1e6;
    if (!none && left_MB < kLeastRoom_MB)
      all.push_back(
          alarm("disk", nullptr,
                fmt::format("the disk of the recording has only {:.0f} MB left", left_MB)));
  }
  return all;
}

}  // namespace soilvdb::tools
