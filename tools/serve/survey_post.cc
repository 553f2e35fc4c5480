// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/survey_post.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <boost/asio/post.hpp>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "io/file/json.h"
#include "io/file/text.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::chrono::milliseconds kLookAgain{2};
/// A clock that is farther ahead of all machines is wrong.
constexpr double kSurveyAhead_s = 60;

/// The ending of a file's name, by which its format is known, from its first bytes.
const char* suffix_of_bytes(const fs::path& file) {
  std::array<char, 4096> bytes = {};
  std::ifstream in(file, std::ios::binary);
  in.read(bytes.data(), bytes.size());
  const std::string_view begin(bytes.data(), static_cast<std::size_t>(in.gcount()));
  if (begin.empty())
    throw std::invalid_argument("there is no body; send the survey's file as it is");
  if (begin.starts_with("--") && begin.find("Content-Disposition") != begin.npos)
    throw std::invalid_argument(
        "the body is a form; send the file as it is: curl --data-binary @FILE");
  if (begin.starts_with("II") || begin.starts_with("MM")) return ".tif";
  if (begin.starts_with("AutoCAD Binary DXF")) return ".dxf";
  const std::size_t first = begin.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (first != begin.npos && begin[first] == '<') return ".xml";
  if (begin.find("SECTION") != begin.npos || begin.find("$ACADVER") != begin.npos) return ".dxf";
  return ".asc";
}

}  // namespace

SurveyPost::SurveyPost(ServerState& state, const std::string& text, std::string from)
    : state_(state), from_(std::move(from)), disk_(state.io) {
  const std::optional<Target> target = parse_target(text);
  if (!target) throw std::invalid_argument("the address can't be read");
  const QueryParameters parameters(*target, {"boundary", "time", "heights", "surface"});
  if (!parameters.text_if("boundary").empty()) {
    const std::vector<double> numbers = parameters.numbers("boundary");
    if (numbers.size() % 2 != 0 || numbers.size() < 6 || numbers.size() > 2 * kMostCorners)
      throw std::invalid_argument(
          fmt::format("'boundary' must be 3 to {} corners x,y", kMostCorners));
    for (std::size_t i = 0; i < numbers.size(); i += 2)
      options_.boundary.emplace_back(numbers[i], numbers[i + 1]);
  }
  time_s_ = parameters.time_if("time");
  const std::optional<double> latest_s = state_.site.time_s();
  if (time_s_ && latest_s && *time_s_ > *latest_s + kSurveyAhead_s)
    throw std::invalid_argument(
        fmt::format("'time' is {} s, more than {} s after the latest state, {} s; is it in the "
                    "time of the feeds?",
                    *time_s_, kSurveyAhead_s, time_text(*latest_s)));
  if (time_s_ && latest_s && *time_s_ < *latest_s && (!state_.history || !state_.site.recorded()))
    throw std::invalid_argument(
        "nothing is recorded here, so the ground at 'time' is not known; leave it out if nothing "
        "was dug since");
  options_.trusts_heights = parameters.word("heights", {"checked", "trusted"}) == "trusted";
  surface_ = parameters.text_if("surface");
  if (state_.surveying)
    throw std::runtime_error("another survey is being taken; send this one when that is done");
  std::string folder = (fs::temp_directory_path() / "soilvdb-survey-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr)
    throw std::runtime_error("no temporary folder for the survey can be made in " +
                             fs::temp_directory_path().string());
  folder_ = folder;
  state_.surveying = true;
}

SurveyPost::~SurveyPost() {
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
  state_.surveying = false;
}

void SurveyPost::refuse(unsigned status, const std::string& why) {
  const std::string so_far =
      taken_ > 0 ? fmt::format(
                       "; {} of {} parts of it are taken, the same survey again takes the "
                       "rest",
                       taken_, input_.parts.size())
                 : "";
  done_(refusal(status, why + so_far));
}

void SurveyPost::take(std::function<void(Reply)> done) {
  done_ = std::move(done);
  begin();
}

void SurveyPost::begin() {
  if (state_.waits_for_undo([self = shared_from_this()] { self->begin(); })) return;
  try {
    if (const std::string why = state_.site.session().recording_fault(); !why.empty())
      return refuse(500, why);
    const bool is_past = time_s_ && state_.site.time_s() && *time_s_ < *state_.site.time_s();
    if (is_past) state_.site.session().flush();  // its journal is read
    auto live = std::make_shared<Session>(state_.site.session().clone());
    // The thread that knows other times, or one that no viewer waits for. What is called at the end
    // keeps this alive, so that it ends on this thread.
    state_.query(
        is_past ? state_.other_times : state_.scans, from_,
        [this, live, is_past] {
          const auto then = is_past ? state_.history->ground_at(*time_s_) : live;
          if (time_s_) options_.since = then.get();
          read(*live);
          return Reply();
        },
        [self = shared_from_this()](Reply reply) {
          if (reply.status != 200) return self->done_(std::move(reply));
          self->next();
        });
  } catch (const std::exception& e) {
    refuse(500, e.what());
  }
}

/// On a thread of queries. @param site a copy of the live one
void SurveyPost::read(Session& site) {
  try {
    fs::path named = file();
    named += suffix_of_bytes(file());
    fs::rename(file(), named);
    if (!surface_.empty()) named += '#' + surface_;
    const io::Base survey = io::open_base(io::RasterTerrain{named});
    const Vec2 middle = survey.bounds.center();
    middle_ = {middle.x(), middle.y(),
               survey.surface->height(middle.x(), middle.y()).value_or(site.origin().z())};
    site.begin_near(middle_);
    origin_ = site.origin();
    options_.name = "the survey";
    options_.go_on = [this] {
      if (state_.ending) throw std::runtime_error("the site has ended");
    };
    input_ = read_survey(site, survey, options_);
  } catch (const std::invalid_argument&) {
    throw;
  } catch (const io::InputError& e) {  // which names where it is kept here
    std::string why = e.what();
    const std::string here = folder_.string() + '/';
    for (std::size_t at = why.find(here); at != why.npos; at = why.find(here, at))
      why.erase(at, here.size());
    throw std::invalid_argument(why);
  }
}

void SurveyPost::next() {
  if (state_.waits_for_undo([self = shared_from_this()] { self->next(); })) return;
  try {
    if (state_.ending) throw std::runtime_error("the site has ended");
    Session& session = state_.site.session();
    session.begin_near(middle_);
    if (session.origin() != origin_)
      throw std::runtime_error("the site was moved to its first machine; send the survey again");
    if (taken_ == input_.parts.size()) return finish(session.hurry());
    SurveyHeights& part = input_.parts[taken_];
    if (!input_.before.empty())
      later_ += leave_changed(*session.site().ground, input_.before[taken_], part);
    const SurveyVolumes made = state_.site.survey(part);
    volumes_.removed_m3 += made.removed_m3;
    volumes_.added_m3 += made.added_m3;
    volumes_.changed += made.changed;
    ++taken_;
  } catch (const std::exception& e) {
    return refuse(500, e.what());
  }
  state_.tell_soon();
  boost::asio::post(state_.io, [self = shared_from_this()] { self->next(); });
}

/// @param updates that are to be on disk
void SurveyPost::finish(std::uint64_t updates) {
  const Session& session = state_.site.session();
  const io::JournalExtent on_disk = session.acknowledged();
  if (on_disk.updates < updates) {
    if (const std::string why = session.recording_fault(); !why.empty())
      return refuse(500, "the ground is that of this survey, but not on disk yet: " + why);
    disk_.expires_after(kLookAgain);
    disk_.async_wait([self = shared_from_this(), updates](const boost::system::error_code& error) {
      if (!error) self->finish(updates);
    });
    return;
  }
  const double column_m2 = session.voxel_size_m() * session.voxel_size_m();
  const double later_m2 = static_cast<double>(later_) * column_m2;
  const double all_m2 =
      input_.area_m2 / std::max(1e-9, 1 - input_.voids - input_.outside - input_.later);
  Json answer = {{"time", time_s_ ? Json(*time_s_) : Json()},
                 {"acknowledged_s", on_disk.updates > 0 ? Json(on_disk.time_s) : Json()},
                 {"area_m2", input_.area_m2 - later_m2},
                 {"changed_m2", static_cast<double>(volumes_.changed) * column_m2},
                 {"removed_m3", volumes_.removed_m3},
                 {"added_m3", volumes_.added_m3},
                 {"voids", input_.voids},
                 {"outside", input_.outside}};
  if (time_s_) answer["dug_since"] = input_.later + later_m2 / all_m2;
  answer["warnings"] = input_.warnings;
  done_({200, "application/json", io::to_text(answer) + '\n'});
}

}  // namespace soilvdb::tools
