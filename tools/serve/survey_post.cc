// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/survey_post.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

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
constexpr const char* kFolder = "soilvdb-survey-";

/// Opens a folder and locks it. @return a negative number if that is another's
int lock_folder(const fs::path& folder) {
  const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  struct stat status = {};
  if (descriptor < 0 || (fstat(descriptor, &status) == 0 && status.st_uid == geteuid() &&
                         flock(descriptor, LOCK_EX | LOCK_NB) == 0))
    return descriptor;
  close(descriptor);
  return -1;
}

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
  if (std::any_of(begin.begin(), begin.end(),
                  [](unsigned char c) { return c < '\t' || c == 0x7F; }))
    throw std::invalid_argument(
        "the body is no survey; it must be a GeoTIFF, an Esri ASCII grid, LandXML or DXF");
  return ".asc";
}

}  // namespace

void remove_left_surveys() {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(fs::temp_directory_path(ignored), ignored)) {
    if (!entry.path().filename().string().starts_with(kFolder)) continue;
    const int lock = lock_folder(entry.path());
    if (lock < 0) continue;
    fs::remove_all(entry.path(), ignored);
    close(lock);
  }
}

SurveyPost::SurveyPost(ServerState& state, const std::string& text, std::string from)
    : state_(state), from_(std::move(from)), disk_(state.io) {
  const std::optional<Target> target = parse_target(text);
  if (!target) throw std::invalid_argument("the address can't be read");
  const QueryParameters parameters(*target);
  parameters.are_for(target->path, {"boundary", "heights", "surface"});  // throws for others
  if (!parameters.text_if("boundary").empty()) options_.boundary = parameters.corners("boundary");
  options_.trusts_heights = parameters.word("heights", {"checked", "trusted"}) == "trusted";
  surface_ = parameters.text_if("surface");
  if (state_.surveying)
    throw std::runtime_error("another survey is being taken; send this one when that is done");
  folder_.emplace("the survey", kFolder);
  lock_ = lock_folder(folder_->path());
  state_.surveying = true;
}

SurveyPost::~SurveyPost() {
  folder_.reset();
  if (lock_ >= 0) close(lock_);
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
    auto live = std::make_shared<Session>(state_.site.session().clone());
    // On a thread that no viewer waits for. What is called at the end keeps this alive, so that it
    // ends on this thread.
    state_.query(
        state_.scans, from_,
        [this, live] {
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

/// A message without the path of where the file is kept here.
std::string SurveyPost::without_folder(std::string why) const {
  const std::string here = folder_->path().string() + '/';
  for (std::size_t at = why.find(here); at != why.npos; at = why.find(here, at))
    why.erase(at, here.size());
  return why;
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
      if (state_.ending) throw std::runtime_error(kEnded);
    };
    input_ = read_survey(site, survey, options_);
    for (std::string& warning : input_.warnings) warning = without_folder(std::move(warning));
  } catch (const std::invalid_argument&) {
    throw;
  } catch (const io::InputError& e) {  // which names where it is kept here
    throw std::invalid_argument(without_folder(e.what()));
  }
}

void SurveyPost::next() {
  if (state_.waits_for_undo([self = shared_from_this()] { self->next(); })) return;
  try {
    if (state_.ending) return refuse(503, kEnded);
    Session& session = state_.site.session();
    session.begin_near(middle_);
    if (session.origin() != origin_)
      throw std::runtime_error("the site was moved to its first machine; send the survey again");
    if (taken_ == input_.parts.size()) return finish(session.hurry());
    const SurveyHeights& part = input_.parts[taken_];
    SurveyVolumes made;
    const std::string fault = state_.site.survey(part, made);
    volumes_.removed_m3 += made.removed_m3;
    volumes_.added_m3 += made.added_m3;
    volumes_.changed += made.changed;
    ++taken_;
    if (!fault.empty()) return refuse(500, "the last part is not on disk yet: " + fault);
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
  Json answer = {{"acknowledged_s", on_disk.updates > 0 ? Json(on_disk.time_s) : Json()},
                 {"area_m2", input_.area_m2},
                 {"changed_m2", static_cast<double>(volumes_.changed) * column_m2},
                 {"removed_m3", volumes_.removed_m3},
                 {"added_m3", volumes_.added_m3},
                 {"voids", input_.voids},
                 {"outside", input_.outside},
                 {"warnings", input_.warnings}};
  done_({200, "application/json", io::to_text(answer) + '\n'});
}

}  // namespace soilvdb::tools
