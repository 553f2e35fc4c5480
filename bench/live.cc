// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a live site costs who feeds and who watches it: `soilvdb serve` as a process, real sockets.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <thread>

#include "bench/live_clients.h"
#include "bench/report.h"
#include "soilvdb/io/raster.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::bench {
namespace {

namespace fs = std::filesystem;

/// From one machine to the next, which dig neither at one place nor in step.
constexpr double kApart_m = 8, kApart_s = 0.8;

fs::path scenario(const fs::path& folder, int machines, bool soil, const std::string& terrain) {
  const fs::path file = folder / "site.yaml";
  std::ofstream out(file);
  out << "soilvdb: 1\nvoxel_size: 0.05\nterrain: " << terrain << "\n";
  if (soil) out << "soil: {repose_angle: 0.6, swell: 0.2}\n";
  out << "machines:\n";
  for (int i = 0; i < machines; ++i)
    out << fmt::format(
        "  - {{name: m{}, bucket: {{width: 1.2, height: 0.9, profile: [[0, 0], [-0.5, 0.1], [-0.6, "
        "0.6], [0, 0.9]]}}}}\n",
        i);
  return file;
}

constexpr const char* kPlane = "{plane: {z: 0}}";

/// A machine digs 4 m in 5 s, turns its bucket over above the ground, and goes back for the next.
std::string state(int machine, double time_s, double deeper_m) {
  constexpr double kCycle_s = 8;
  const double cycle = std::floor(time_s / kCycle_s), in_s = time_s - cycle * kCycle_s;
  double x = 0.8 * in_s, z = -0.2 - deeper_m * cycle, pitch = 0;
  if (in_s > 5) {
    const double share = (in_s - 5) / 3;
    x = 4 * (1 - share);
    z += (1.2 - z) * std::min({1.0, 16 * share, 16 * (1 - share)});
    pitch = std::numbers::pi * std::sin(std::numbers::pi * share);
  }
  return fmt::format(
      R"({{"machine":"m{}","time":{:.6f},"position":[{:.6f},{},{:.6f}],"rotation":[0,{:.12f},0,{:.12f}]}})",
      machine, time_s, x, kApart_m * machine, z, std::sin(pitch / 2), std::cos(pitch / 2));
}

struct Fed {
  std::vector<double> ms;
  std::uint64_t lost = 0;
};

/// Feeds machines, each over a connection and at its rate, for so long.
Fed feed(unsigned short port, int machines, double hz, double seconds) {
  std::vector<Fed> fed(static_cast<std::size_t>(machines));
  std::vector<std::thread> threads;
  for (int m = 0; m < machines; ++m)
    threads.emplace_back([&, m] {
      Fed& mine = fed[static_cast<std::size_t>(m)];
      Feed connection(port);
      const Clock::time_point begin = Clock::now();
      const auto count = static_cast<int>(hz * seconds);
      for (int i = 0; i < count; ++i) {
        // Machines don't beat in time.
        const double due_s = (i + static_cast<double>(m) / machines) / hz;
        const Clock::time_point due = begin + std::chrono::duration_cast<Clock::duration>(
                                                  std::chrono::duration<double>(due_s));
        // A state that is late since the one before it wasn't answered has waited since it was due.
        const bool late = Clock::now() > due;
        std::this_thread::sleep_until(due);
        const Clock::time_point sent = late ? due : Clock::now();
        const std::string answer = connection.ask(state(m, i / hz + kApart_s * m, 0.02));
        mine.ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - sent).count());
        if (answer.find("cut_m3") == std::string::npos) ++mine.lost;
      }
    });
  for (std::thread& thread : threads) thread.join();
  Fed all;
  for (const Fed& one : fed) {
    all.ms.insert(all.ms.end(), one.ms.begin(), one.ms.end());
    all.lost += one.lost;
  }
  return all;
}

void measure_feeds(const Options& options, Goals& goals, Csv& csv) {
  const double seconds = options.quick ? 1 : 60;
  for (const bool soil : {false, true}) {
    const std::string kind = soil ? "moving soil" : "rigid soil";
    for (const bool many : {false, true}) {
      const test::TempFolder folder;
      const int machines = many ? 10 : 1, viewers = many ? 20 : 5;
      const double hz = many ? 100 : 1000;
      const LiveServer server(scenario(folder.path(), machines, soil, kPlane), folder / "out");
      const Viewers watching(server.port(), viewers);
      Fed fed = feed(server.port(), machines, hz, seconds);
      const Watched seen = watching.watched();
      const double p50 = quantile(fed.ms, 0.5), p99 = quantile(fed.ms, 0.99);
      csv.row(fmt::format("{},{},{},{},{},{},{},{},{}", kind, machines, hz, viewers, p50, p99,
                          fed.ms.back(), fed.lost, seen.largest_block));
      const std::string what =
          fmt::format("{} x {} Hz, {} viewers, {}: ", machines, hz, viewers, kind);
      if (many) {
        goals.add({what + "lost", static_cast<double>(fed.lost), "", 0});
        goals.add({what + "p99", p99, "ms", 5});
      } else {
        goals.add({what + "p50", p50, "ms", 0.3});
        goals.add({what + "p99", p99, "ms", 2});
      }
      goals.add({what + "largest block", static_cast<double>(seen.largest_block), "B", 20e3});
    }
  }
}

/// A machine that cuts in one place after another, and when a viewer has the block of each.
void measure_change(const Options& options, Goals& goals) {
  const test::TempFolder folder;
  const LiveServer server(scenario(folder.path(), 1, false, kPlane), folder / "out");
  Viewers watching(server.port(), 5);
  Feed machine(server.port());
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  std::mt19937 chance(1);
  std::uniform_int_distribution<int> wait_ms(150, 350);
  std::vector<double> ms;
  const int cuts = options.quick ? 3 : 200;
  for (int i = 0; i < cuts; ++i) {
    const auto go = [&](double x, double z) {
      machine.ask(
          fmt::format(R"({{"machine":"m0","position":[{},0,{}],"rotation":[0,0,0,1]}})", x, z));
    };
    const double x = 8.0 * i;
    go(x, 2);
    std::this_thread::sleep_for(std::chrono::milliseconds(wait_ms(chance)));
    watching.take_first_seen();
    const Clock::time_point begin = Clock::now();
    go(x, -0.3);
    go(x + 0.5, -0.3);
    Clock::time_point last = begin;
    // All that comes of it within a while; the latest counts.
    std::this_thread::sleep_for(std::chrono::milliseconds(400));
    for (const auto& [block, at] : watching.take_first_seen()) last = std::max(last, at);
    ms.push_back(std::chrono::duration<double, std::milli>(last - begin).count());
  }
  goals.add({"change to a viewer: p99",
             quantile(ms, 0.99),
             "ms",
             150,
             {},
             fmt::format("all blocks of {} cuts, 5 viewers", cuts)});
}

/// A raster of 1 m posts, 1 km a side: the site's terrain as a page asks for it.
void measure_opening(Goals& goals) {
  const test::TempFolder folder;
  constexpr int kSide = 1001;
  const HeightGrid grid{kSide, kSide, Vec2(500000, 5400000), Vec2(1, 1)};
  std::vector<float> heights;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      heights.push_back(static_cast<float>(400 + 20 * std::sin(x / 90.0) * std::cos(y / 70.0)));
  io::write_geotiff(folder / "site.tif", grid, {{"height", heights}}, "");
  Stopwatch open;
  const LiveServer server(scenario(folder.path(), 1, false, "{raster: site.tif}"), folder / "out");
  goals.add({"1 km2 of 1 m posts: to the address", open.seconds(), "s"});
  const Stopwatch watch;
  double first_s = 0;
  int tiles = 0;
  for (int level = 3; level >= 0; --level) {
    const int side = (1000 / (1 << level) + 255) / 256;
    for (int i = 0; i < side; ++i)
      for (int j = 0; j < side; ++j, ++tiles) {
        try {
          server.get(fmt::format("/terrain?level={}&tile={},{}", level, i, j));
        } catch (const std::runtime_error&) {  // a level that there isn't
        }
        if (first_s == 0) first_s = watch.seconds();
      }
  }
  goals.add(
      {"the same: its coarsest tile", first_s, "s", 2, {}, "data; the page's own: tests/view"});
  goals.add({"the same: all tiles", watch.seconds(), "s", 5, {}, fmt::format("{} tiles", tiles)});
}

/// Kills it again and again while it is fed, and counts what it had acknowledged and has no more.
void measure_kills(const Options& options, Goals& goals) {
  const test::TempFolder folder;
  const fs::path file = scenario(folder.path(), 1, true, kPlane);
  const int kills = options.quick ? 2 : 200;
  std::mt19937 chance(7);
  std::uniform_real_distribution<double> life_s(0.05, options.quick ? 0.5 : 2.5);
  std::uint64_t fed = 0, lost = 0, acknowledged = 0;
  for (int i = 0; i < kills; ++i) {
    LiveServer server(file, folder / "out");
    const auto summary = nlohmann::json::parse(server.get("/summary.json"));
    const std::uint64_t there = summary["updates"];
    if (there < acknowledged) lost += acknowledged - there;
    fed = there;
    Feed machine(server.port());
    const Stopwatch watch;
    const double end_s = life_s(chance);
    while (watch.seconds() < end_s) {
      const auto answer =
          nlohmann::json::parse(machine.ask(state(0, static_cast<double>(fed) / 100, 0.002)));
      ++fed;
      if (!answer["acknowledged_s"].is_null())
        acknowledged =
            static_cast<std::uint64_t>(std::llround(answer["acknowledged_s"].get<double>() * 100)) +
            1;
      // Flat out, most of the time would go on digging again what was fed since a snapshot.
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    server.kill();
  }
  goals.add({fmt::format("acknowledged states lost in {} kills", kills),
             static_cast<double>(lost),
             "",
             0,
             {},
             fmt::format("of {}", acknowledged)});
}

/// A day of ten machines, as fast as it goes, over ground that they have dug already.
void measure_day(const Options& options, Goals& goals, Csv& csv) {
  const test::TempFolder folder;
  const LiveServer server(scenario(folder.path(), 10, false, kPlane), folder / "out");
  const Viewers watching(server.port(), 20);
  const double day_s = options.quick ? 300 : 86400;
  constexpr int kParts = 24;
  std::vector<double> rss;
  for (int part = 0; part < kParts; ++part) {
    std::vector<std::thread> threads;
    for (int m = 0; m < 10; ++m)
      threads.emplace_back([&, m] {
        Feed machine(server.port());
        const auto steps = static_cast<int>(day_s / kParts);
        for (int i = 0; i < steps; ++i) machine.ask(state(m, part * (day_s / kParts) + i, 0));
      });
    for (std::thread& thread : threads) thread.join();
    rss.push_back(server.rss_bytes());
    csv.row(fmt::format("{},{}", (part + 1) * day_s / kParts, rss.back()));
  }
  // What the allocator gives back and takes again isn't growth.
  const auto quarter = rss.begin() + kParts / 4;
  const double early = *std::max_element(rss.begin(), quarter),
               late = *std::max_element(quarter, rss.end());
  goals.add({"most memory in a day over that in its first quarter",
             100 * (late / early - 1),
             "%",
             2,
             {},
             fmt::format("{:.1f} MB, {:.0f} s", late / 1e6, day_s)});
}

}  // namespace
}  // namespace soilvdb::bench

int main(int argc, char** argv) try {
  using namespace soilvdb::bench;
  const Options options = parse(argc, argv, "live");
  Goals goals(options.out);
  Csv feeds(options.out / "feeds.csv",
            "soil,machines,hz,viewers,p50_ms,p99_ms,max_ms,lost,block_B");
  Csv memory(options.out / "memory.csv", "time_s,rss_B");
  measure_feeds(options, goals, feeds);
  measure_change(options, goals);
  measure_opening(goals);
  measure_kills(options, goals);
  measure_day(options, goals, memory);
  goals.print();
  return 0;
} catch (const std::exception& e) {
  fmt::print(stderr, "bench live: {}\n", e.what());
  return 1;
}
