// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Answers to requests.
#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "io/file/json.h"
#include "io/file/text.h"
#include "soilvdb/io/mesh_file.h"
#include "soilvdb/io/picture.h"
#include "tools/run/outputs.h"
#include "tools/run/run_totals.h"
#include "tools/run/text.h"
#include "tools/serve/alarms.h"
#include "tools/serve/measures.h"
#include "tools/serve/progress.h"
#include "tools/serve/report.h"
#include "tools/serve/server_state.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kMostPoints = 5000;
constexpr std::size_t kMostPasts = 4;

Reply json_reply(const Json& json) {
  return {200, "application/json", io::to_text(json) + '\n', {}, false};
}

/// A temporary folder for one file.
class TempFile {
 public:
  explicit TempFile(const std::string& name) {
    std::string path = (fs::temp_directory_path() / "soilvdb-XXXXXX").string();
    if (mkdtemp(path.data()) == nullptr)
      throw std::runtime_error("no temporary folder for the file can be made in " +
                               fs::temp_directory_path().string());
    folder_ = path;
    file_ = folder_ / name;
  }
  ~TempFile() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  TempFile(const TempFile&) = delete;
  TempFile& operator=(const TempFile&) = delete;
  const fs::path& file() const { return file_; }
  std::string bytes() const {
    std::ifstream in(file_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  }

 private:
  fs::path folder_, file_;
};

Reply file_reply(const char* name, const char* type,
                 const std::function<void(const fs::path&)>& write) {
  const TempFile temporary(name);
  write(temporary.file());
  return {200, type, temporary.bytes(), name, false};
}

void require_dug(const Session& session) {
  if (session.site().ground->chunk_count() == 0)
    throw std::invalid_argument("nothing is dug yet, so there is no such file");
}

/// Takes the same time for any difference, so that timing reveals nothing.
bool constant_time_equal(std::string_view a, std::string_view b) {
  unsigned char differs = a.size() != b.size();
  for (std::size_t i = 0; i < a.size(); ++i)
    differs = static_cast<unsigned char>(differs | (a[i] ^ (b.empty() ? '\0' : b[i % b.size()])));
  return differs == 0;
}

/// The token of "Bearer TOKEN", in which the scheme may have any case.
std::optional<std::string_view> bearer(std::string_view authorization) {
  constexpr std::string_view kScheme = "bearer";
  const std::string_view scheme = authorization.substr(0, kScheme.size());
  if (io::lower_case(std::string(scheme)) != kScheme) return {};
  authorization.remove_prefix(kScheme.size());
  const std::size_t begin = authorization.find_first_not_of(' ');
  if (begin == 0 || begin == std::string_view::npos) return {};
  return authorization.substr(begin, authorization.find_last_not_of(' ') + 1 - begin);
}

}  // namespace

Reply refusal(unsigned status, const std::string& why) {
  Reply reply = json_reply({{"error", why}});
  reply.status = status;
  return reply;
}

Role ServerState::role_of(const std::string& target, const std::string& authorization) const {
  if (!has_tokens()) return Role::kFeeder;
  Role role = options.public_view ? Role::kViewer : Role::kNobody;
  const auto take = [&](std::string_view sent) {
    const auto is = [&](const std::string& token) {
      return !token.empty() && constant_time_equal(sent, token);
    };
    if (is(options.view_token)) role = std::max(role, Role::kViewer);
    if (is(options.token)) role = Role::kFeeder;
  };
  if (const auto token = bearer(authorization)) take(*token);
  if (const std::optional<Target> parsed = parse_target(target))
    if (const auto found = parsed->values.find("token"); found != parsed->values.end())
      take(found->second);
  return role;
}

Past ServerState::past(double time_s, std::uint64_t changes) {
  if (!history) throw std::invalid_argument("nothing is recorded, so there is no other time");
  if (std::exchange(changes_of_pasts, changes) != changes) pasts.clear();
  const auto found = std::find_if(pasts.begin(), pasts.end(),
                                  [&](const auto& past) { return past.first == time_s; });
  if (found != pasts.end()) {
    pasts.splice(pasts.begin(), pasts, found);
  } else {
    pasts.emplace_front(time_s, history->at(time_s));
    if (pasts.size() > kMostPasts) pasts.pop_back();
  }
  return pasts.front().second;
}

void ServerState::with_ground(std::optional<double> time_s, std::optional<double> against_s,
                              const std::string& client, std::function<Reply(GroundView&)> use,
                              std::function<void(Reply)> done) {
  const auto latest_s = options.takes_feeds ? site.time_s() : known_times.to_s;
  for (const auto& asked_s : {time_s, against_s})
    if (asked_s && latest_s && *asked_s > *latest_s + 1e-3)  // clients see rounded times
      return done(
          refusal(400, fmt::format("{} s is later than what is recorded, which goes up to {} s",
                                   *asked_s, time_text(*latest_s))));
  std::shared_ptr<Session> live;
  if (!time_s) live = std::make_shared<Session>(site.session().clone());
  const bool is_live = !time_s && !against_s;
  if (is_live) heights->post();
  query(
      is_live ? queries : other_times, client,
      [this, is_live, time_s, against_s, clocks = site.changes_of_past(), live = std::move(live),
       use = std::move(use)] {
        const Past now = time_s ? past(*time_s, clocks) : Past{live, nullptr};
        Heights now_heights;
        if (is_live)
          now_heights = [this](std::span<const Vec2> xy_m, std::span<double> z) {
            heights->at(xy_m, z);
          };
        GroundView ground(now, against_s ? past(*against_s, clocks).site : nullptr, design,
                          now_heights);
        return use(ground);
      },
      std::move(done));
}

void ServerState::drop_queries() {
  for (QueryLane* lane : {&places, &queries, &other_times, &scans}) lane->drop();
}

void ServerState::query(QueryLane& lane, const std::string& client, std::function<Reply()> make,
                        std::function<void(Reply)> done) {
  const bool taken = lane.try_run(client, [this, make = std::move(make), done]() mutable {
    Reply reply;
    try {
      reply = make();
    } catch (const std::invalid_argument& e) {
      reply = refusal(400, e.what());
    } catch (const std::exception& e) {
      reply = refusal(500, e.what());
    }
    boost::asio::post(io, [done = std::move(done), reply = std::move(reply)] { done(reply); });
  });
  if (!taken) done(refusal(429, "too many requests; try again later"));
}

FeedLines::Feed ServerState::feed_of(std::shared_ptr<const FeedSource> source) {
  return [this, source = std::move(source)](std::string_view line) {
    return options.takes_feeds ? site.feed(line, source)
                               : io::to_text(Json{{"error", kOnlyLookedAt}});
  };
}

void ServerState::measures_csv(std::shared_ptr<MeasuresCsv> table,
                               std::function<void(Reply)> done) {
  if (table->next == table->measures.size())
    return done({200, "text/csv; charset=utf-8", table->csv, "measures.csv"});
  with_ground(
      table->time_s, table->against_s, table->client,
      [table](GroundView& ground) {
        table->csv += measures_csv_row(table->measures[table->next++], ground);
        return Reply{};
      },
      [this, table, done](const Reply& reply) {
        if (reply.status != 200) return done(reply);
        measures_csv(table, done);
      });
}

void ServerState::with_progress(std::shared_ptr<ProgressQuery> progress, const std::string& client,
                                std::function<Reply()> make, std::function<void(Reply)> done) {
  auto more = std::make_shared<bool>(false);
  const auto step = [this, progress, more, changes = site.changes_of_past()] {
    if (history) *more = progress->step(*history, progress_samples, changes);
    return Reply{};
  };
  query(other_times, client, step, [this, progress, more, client, make, done](const Reply& reply) {
    if (reply.status != 200) return done(reply);
    if (*more) return with_progress(progress, client, make, done);
    progress->take_work(site);
    with_ground(
        {}, {}, client,
        [progress, make](GroundView& live) {
          progress->finish(live);
          return make();
        },
        done);
  });
}

/// The feed lives as long as its lines are fed.
void ServerState::feed_post(std::shared_ptr<FeedLines> lines, std::shared_ptr<FeedSource> source,
                            std::function<void(Reply)> done) {
  if (waits_for_undo([this, lines, source, done] { feed_post(lines, source, done); })) return;
  if (lines->feed(feed_of(source)) && !ending)
    return boost::asio::post(io, [this, lines, source, done] { feed_post(lines, source, done); });
  source->link = FeedSource::Link::kEnded;
  done({lines->any_taken() ? 200u : 400u, "application/x-ndjson", lines->answers() + '\n'});
}

void ServerState::post(const std::string& text, std::string body, const std::string& from,
                       std::function<void(Reply)> done) {
  try {
    const std::optional<Target> target = parse_target(text);
    const std::string path = target ? target->path : std::string();
    if (path == "/feed") {
      const QueryParameters parameters(*target, {});
      return feed_post(std::make_shared<FeedLines>(std::move(body)),
                       std::make_shared<FeedSource>(FeedSource{from}), std::move(done));
    }
    if (waits_for_undo([this, text, body, from, done] { post(text, body, from, done); })) return;
    if (path == "/undo") {
      const QueryParameters parameters(*target, {"machine", "time"});
      const std::size_t machine = site.session().machine(parameters.text("machine"));
      return undo(machine, parameters.time("time"), done);
    }
    if (path == "/machines" || path == "/hoppers") {
      const QueryParameters parameters(*target, {});
      return done(json_reply(change_list(path.substr(1), body)));
    }
    if (path == "/measures") {
      const QueryParameters parameters(*target, {});
      return done(json_reply(change_measures(body)));
    }
    if (path != "/clock")
      return done(refusal(405,
                          "only GET is answered, and POST of /feed, /survey, /machines, /hoppers, "
                          "/measures, /undo and /clock"));
    const QueryParameters parameters(*target, {"machine"});
    const std::string answer =
        site.feed(io::to_text(Json{{"machine", parameters.text("machine")}, {"clock", "reset"}}));
    done({is_refusal(answer) ? 400u : 200u, "application/json", answer + '\n'});
  } catch (const std::exception& e) {
    done(refusal(400, e.what()));
  }
}

void ServerState::answer(const std::string& text, const std::string& client,
                         std::function<void(Reply)> done) {
  try {
    const std::optional<Target> target = parse_target(text);
    if (!target) return done(refusal(400, "the address can't be read"));
    const std::string& path = target->path;
    const auto look = [&](const QueryParameters& parameters,
                          const std::function<Reply(GroundView&)>& use) {
      with_ground(parameters.time_if("time"), parameters.time_if("against"), client, use, done);
    };
    if (path == "/height") {
      const QueryParameters parameters(*target, {"x", "y", "time", "against"});
      const Vec2 at(parameters.number("x"), parameters.number("y"));
      if (parameters.time_if("time") || parameters.time_if("against"))
        return look(parameters, [at](GroundView& ground) { return json_reply(ground.height(at)); });
      place_heights->post();
      return query(
          places, client,
          [this, at, before = site.session().site().ground->shared_terrain()] {
            const Heights now = [this](std::span<const Vec2> xy_m, std::span<double> z) {
              place_heights->at(xy_m, z);
            };
            return json_reply(height_answer(at, now, heights_of(*before), design.get()));
          },
          done);
    }
    if (path == "/section") {
      const QueryParameters parameters(*target, {"from", "to", "points", "time", "against"});
      const Vec2 from = parameters.place("from"), to = parameters.place("to");
      const double points = parameters.number_if("points").value_or(500);
      if (!(points >= 2 && points <= kMostPoints && points == std::floor(points)))
        throw std::invalid_argument(fmt::format("'points' must be 2 to {}", kMostPoints));
      return look(parameters, [=](GroundView& ground) {
        return json_reply(ground.section(from, to, static_cast<int>(points)));
      });
    }
    if (path == "/volume") {
      const QueryParameters parameters(*target, {"boundary", "time", "against"});
      const std::vector<double> numbers = parameters.numbers("boundary");
      if (numbers.size() % 2 != 0 || numbers.size() < 6 || numbers.size() > 2 * kMostCorners)
        throw std::invalid_argument(
            fmt::format("'boundary' must be 3 to {} corners x,y", kMostCorners));
      std::vector<Vec2> boundary;
      for (std::size_t i = 0; i < numbers.size(); i += 2)
        boundary.emplace_back(numbers[i], numbers[i + 1]);
      return look(parameters,
                  [boundary](GroundView& ground) { return json_reply(ground.volume(boundary)); });
    }
    if (path == "/terrain") {
      const QueryParameters parameters(*target, {"level", "tile", "surface"});
      const bool designed = parameters.word("surface", {"before", "design"}) == "design";
      if (designed && !design)
        throw std::invalid_argument("there is no design; soilvdb serve takes one by --design");
      const Vec2 tile = parameters.place("tile");
      const auto whole = [](double value) {
        return value == std::floor(value) && std::abs(value) < 1e6 ? static_cast<int>(value) : -1;
      };
      const int level = whole(parameters.number("level")), i = whole(tile.x()), j = whole(tile.y());
      return query(
          queries, client,
          [this, level, i, j, designed] {
            const auto bytes = terrain->tile(level, i, j, designed ? design.get() : nullptr);
            if (!bytes) return refusal(404, "there is no such tile");
            return Reply{200, "application/octet-stream", deflated(*bytes), {}, true};
          },
          done);
    }
    if (path == "/lines")
      return done(refusal(404, "there are no lines; soilvdb serve takes some by --lines"));
    if (path == "/drape")
      return done(refusal(404, "there is no drape; soilvdb serve takes one by --drape"));
    if (path == "/survey")
      return done(refusal(405, "a survey is sent by POST, with its file as the body"));
    if (path == "/machines") {
      const QueryParameters parameters(*target, {});
      return done(json_reply(site.feeds()));
    }
    if (path == "/undo") {
      const QueryParameters parameters(*target, {"machine", "time"});
      const std::size_t machine = site.session().machine(parameters.text("machine"));
      return ask_undo(machine, parameters.time("time"), client, done);
    }
    if (path == "/alarms") {
      const QueryParameters parameters(*target, {});
      if (!options.takes_feeds)
        throw std::invalid_argument("nothing is fed here, so nothing alarms");
      return done(json_reply(alarms(site, design.get(), options.boundary, options.folder)));
    }
    if (path == "/machines.csv") {
      const QueryParameters parameters(*target, {"time"});
      const auto csv = [](const Json& state) {
        return Reply{200, "text/csv; charset=utf-8", machines_csv(state), "machines.csv", false};
      };
      if (!parameters.time_if("time")) return done(csv(site.state()));
      return look(parameters, [csv](GroundView& ground) { return csv(ground.state()); });
    }
    if (path == "/measures") {
      const QueryParameters parameters(*target, {});
      return done(json_reply(measures.json()));
    }
    if (path == "/measures.geojson") {
      const QueryParameters parameters(*target, {});
      return done({200, "application/geo+json",
                   io::to_text(measures.geojson(site.session().site().crs_wkt)) + '\n',
                   "measures.geojson"});
    }
    if (path == "/measures.csv") {
      const QueryParameters parameters(*target, {"time", "against"});
      return measures_csv(
          std::make_shared<MeasuresCsv>(MeasuresCsv{measures.all(), parameters.time_if("time"),
                                                    parameters.time_if("against"), client}),
          done);
    }
    if (path == "/progress") {
      const QueryParameters parameters(*target, {"measure"});
      std::vector<Measure> areas = measures.areas();
      if (const auto id = parameters.number_if("measure")) {
        const Measure& one =
            measures.find(*id >= 0 && *id == std::floor(*id) ? static_cast<std::uint64_t>(*id) : 0);
        if (one.kind != Measure::Kind::kBoundary)
          throw std::invalid_argument("progress is that of a measure with a boundary");
        areas = {one};
      }
      auto progress = std::make_shared<ProgressQuery>(site, std::move(areas), design);
      return with_progress(
          progress, client, [progress] { return json_reply(progress_json(progress->result())); },
          done);
    }
    if (path == "/report" || path == "/report.csv") {
      const QueryParameters parameters(*target, {"from", "to", "every", "units"});
      const std::string token = parameters.text_if("token");
      auto report = std::make_shared<Report>(site, ReportQuery(parameters));
      const bool to_print = path == "/report";
      const auto make = [report, token, to_print] {
        report->sum();
        if (to_print) return Reply{200, "text/html; charset=utf-8", report_page(*report, token)};
        return Reply{200, "text/csv; charset=utf-8", report_csv(*report), "report.csv"};
      };
      if (!to_print || !design || measures.areas().empty())
        return query(queries, client, make, done);
      auto progress = std::make_shared<ProgressQuery>(site, measures.areas(), design);
      return with_progress(
          progress, client,
          [report, progress, make] {
            report->set_progress(progress->result());
            return make();
          },
          done);
    }
    if (path == "/summary.json") {
      const QueryParameters parameters(*target, {"time"});
      io::Summary summary = site.summary();
      return look(parameters, [this, summary](GroundView& ground) {
        io::Summary all = summary;
        put_totals(site.totals(ground.now()), all);
        return Reply{200, "application/json", io::to_json(all), {}, false};
      });
    }
    if (path == "/surface.tif") {
      const QueryParameters parameters(*target, {"time"});
      return look(parameters, [this](GroundView& ground) {
        require_dug(ground.now());
        const io::Site& of = ground.now().site();
        const auto box = io::footprint(*of.ground, false);
        const double cell_m =
            options.raster_cell_m.value_or(affordable_cell_m(box, of.ground->voxel_size_m()));
        return file_reply("surface.tif", "image/tiff", [&](const fs::path& file) {
          write_surface_raster(file, *of.ground, box, cell_m, of.crs_wkt);
        });
      });
    }
    if (path == "/soil.vdb") {
      const QueryParameters parameters(*target, {"time"});
      return look(parameters, [](GroundView& ground) {
        return file_reply("soil.vdb", "application/octet-stream",
                          [&](const fs::path& file) { ground.now().write(file); });
      });
    }
    if (path == "/mesh.glb") {
      const QueryParameters parameters(*target, {"time"});
      return look(parameters, [](GroundView& ground) {
        require_dug(ground.now());
        const io::Site& of = ground.now().site();
        return file_reply("mesh.glb", "model/gltf-binary", [&](const fs::path& file) {
          io::write_mesh(file, ground.now().mesh(), of.ground->origin(), of.crs_wkt);
        });
      });
    }
    done(refusal(404,
                 "there is no such page; there are /summary.json, /soil.vdb, /surface.tif, "
                 "/mesh.glb, /machines, /machines.csv, /measures, /measures.geojson, "
                 "/measures.csv, /progress, /report, /report.csv, /alarms, /undo, /height, "
                 "/section, /volume, /terrain, /lines and /drape"));
  } catch (const std::invalid_argument& e) {
    done(refusal(400, e.what()));
  } catch (const std::exception& e) {
    done(refusal(500, e.what()));
  }
}

}  // namespace soilvdb::tools
