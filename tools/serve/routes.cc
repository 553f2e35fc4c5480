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
#include "tools/serve/temp_folder.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kMostPoints = 5000;
constexpr std::size_t kMostPasts = 4;

Reply json_reply(const Json& json) {
  return {200, "application/json", io::to_text(json) + '\n', {}, false};
}

Reply file_reply(const char* name, const char* type,
                 const std::function<void(const fs::path&)>& write) {
  const TempFolder folder("the file");
  const fs::path file = folder.path() / name;
  write(file);
  std::ifstream in(file, std::ios::binary);
  return {200, type, {std::istreambuf_iterator<char>(in), {}}, name, false};
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
                              const std::string& client, std::function<Reply(GroundQuery&)> use,
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
        GroundQuery ground(now, against_s ? past(*against_s, clocks).site : nullptr, design,
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
      [table](GroundQuery& ground) {
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
        [progress, make](GroundQuery& live) {
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
    const Target target = parse_target(text).value_or(Target());
    const QueryParameters asked(target);
    if (asked.are_for("/feed", {}))
      return feed_post(std::make_shared<FeedLines>(std::move(body)),
                       std::make_shared<FeedSource>(FeedSource{from}), std::move(done));
    if (waits_for_undo([this, text, body, from, done] { post(text, body, from, done); })) return;
    if (asked.are_for("/undo", {"machine", "time"})) {
      const std::size_t machine = site.session().machine(asked.text("machine"));
      return undo(machine, asked.time("time"), done);
    }
    for (const char* list : {"machines", "hoppers"})
      if (asked.are_for(std::string("/") + list, {}))
        return done(json_reply(change_list(list, body)));
    if (asked.are_for("/measures", {})) return done(json_reply(change_measures(body)));
    if (!asked.are_for("/clock", {"machine"}))
      return done(refusal(405,
                          "only GET is answered, and POST of /feed, /survey, /machines, /hoppers, "
                          "/measures, /undo and /clock"));
    const std::string answer =
        site.feed(io::to_text(Json{{"machine", asked.text("machine")}, {"clock", "reset"}}));
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
    const QueryParameters asked(*target);
    const auto look = [&](const std::function<Reply(GroundQuery&)>& use) {
      with_ground(asked.time_if("time"), asked.time_if("against"), client, use, done);
    };
    if (asked.are_for("/height", {"x", "y", "time", "against"})) {
      const Vec2 at(asked.number("x"), asked.number("y"));
      if (asked.time_if("time") || asked.time_if("against"))
        return look([at](GroundQuery& ground) { return json_reply(ground.height(at)); });
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
    if (asked.are_for("/section", {"from", "to", "points", "time", "against"})) {
      const Vec2 from = asked.place("from"), to = asked.place("to");
      const double points = asked.number_if("points").value_or(500);
      if (!(points >= 2 && points <= kMostPoints && points == std::floor(points)))
        throw std::invalid_argument(fmt::format("'points' must be 2 to {}", kMostPoints));
      return look([=](GroundQuery& ground) {
        return json_reply(ground.section(from, to, static_cast<int>(points)));
      });
    }
    if (asked.are_for("/volume", {"boundary", "time", "against"})) {
      const std::vector<Vec2> boundary = asked.corners("boundary");
      return look([boundary](GroundQuery& ground) { return json_reply(ground.volume(boundary)); });
    }
    if (asked.are_for("/terrain", {"level", "tile", "surface"})) {
      const bool designed = asked.word("surface", {"before", "design"}) == "design";
      if (designed && !design)
        throw std::invalid_argument("there is no design; soilvdb serve takes one by --design");
      const Vec2 tile = asked.place("tile");
      const auto whole = [](double value) {
        return value == std::floor(value) && std::abs(value) < 1e6 ? static_cast<int>(value) : -1;
      };
      const int level = whole(asked.number("level")), i = whole(tile.x()), j = whole(tile.y());
      return query(
          queries, client,
          [this, level, i, j, designed] {
            const auto bytes = terrain->tile(level, i, j, designed ? design.get() : nullptr);
            if (!bytes) return refusal(404, "there is no such tile");
            return Reply{200, "application/octet-stream", deflated(*bytes), {}, true};
          },
          done);
    }
    if (target->path == "/lines")
      return done(refusal(404, "there are no lines; soilvdb serve takes some by --lines"));
    if (target->path == "/drape")
      return done(refusal(404, "there is no drape; soilvdb serve takes one by --drape"));
    if (target->path == "/survey")
      return done(refusal(405, "a survey is sent by POST, with its file as the body"));
    if (asked.are_for("/machines", {})) return done(json_reply(site.feeds()));
    if (asked.are_for("/undo", {"machine", "time"})) {
      const std::size_t machine = site.session().machine(asked.text("machine"));
      return ask_undo(machine, asked.time("time"), client, done);
    }
    if (asked.are_for("/alarms", {})) {
      if (!options.takes_feeds)
        throw std::invalid_argument("nothing is fed here, so nothing alarms");
      return done(json_reply(alarms(site, design.get(), options.boundary, options.folder)));
    }
    if (asked.are_for("/machines.csv", {"time"})) {
      const auto csv = [](const Json& state) {
        return Reply{200, "text/csv; charset=utf-8", machines_csv(state), "machines.csv", false};
      };
      if (!asked.time_if("time")) return done(csv(site.state()));
      return look([csv](GroundQuery& ground) { return csv(ground.state()); });
    }
    if (asked.are_for("/measures", {})) return done(json_reply(measures.json()));
    if (asked.are_for("/measures.geojson", {}))
      return done({200, "application/geo+json",
                   io::to_text(measures.geojson(site.session().site().crs_wkt)) + '\n',
                   "measures.geojson"});
    if (asked.are_for("/measures.csv", {"time", "against"}))
      return measures_csv(
          std::make_shared<MeasuresCsv>(
              MeasuresCsv{measures.all(), asked.time_if("time"), asked.time_if("against"), client}),
          done);
    if (asked.are_for("/progress", {"measure"})) {
      std::vector<Measure> areas = measures.areas();
      if (const auto id = asked.number_if("measure")) {
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
    const std::initializer_list<const char*> of_report = {"from", "to", "every", "units"};
    if (asked.are_for("/report", of_report) || asked.are_for("/report.csv", of_report)) {
      const std::string token = asked.text_if("token");
      auto report = std::make_shared<Report>(site, ReportQuery(asked));
      const bool to_print = target->path == "/report";
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
    if (asked.are_for("/summary.json", {"time"})) {
      io::Summary summary = site.summary();
      return look([this, summary](GroundQuery& ground) {
        io::Summary all = summary;
        put_totals(site.totals(ground.now()), all);
        return Reply{200, "application/json", io::to_json(all), {}, false};
      });
    }
    if (asked.are_for("/surface.tif", {"time"})) {
      return look([this](GroundQuery& ground) {
        require_dug(ground.now());
        const io::Site& of = ground.now().site();
        const auto box = io::footprint(*of.ground, false);
        const double cell_m =
            options.raster_cell_m.value_or(affordable_cell_m(box, of.ground->voxel_size_m()));
        return file_reply("surface.tif", "image/tiff", [&](const fs::path& file) {
          write_surface_raster(file, *of.ground, box, cell_m, of.crs_wkt, ground.sigmas());
        });
      });
    }
    if (asked.are_for("/sigmas", {"time"})) {
      return look([](GroundQuery& ground) {
        return Reply{200, "application/octet-stream", deflated(ground.sigma_map()), {}, true};
      });
    }
    if (asked.are_for("/soil.vdb", {"time"})) {
      return look([](GroundQuery& ground) {
        return file_reply("soil.vdb", "application/octet-stream",
                          [&](const fs::path& file) { ground.now().write(file); });
      });
    }
    if (asked.are_for("/mesh.glb", {"time"})) {
      return look([](GroundQuery& ground) {
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
                 "/section, /volume, /sigmas, /terrain, /lines and /drape"));
  } catch (const std::invalid_argument& e) {
    done(refusal(400, e.what()));
  } catch (const std::exception& e) {
    done(refusal(500, e.what()));
  }
}

}  // namespace soilvdb::tools
