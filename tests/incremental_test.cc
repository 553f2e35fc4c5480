// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs with incremental snapshots: the ground of whole ones at a cost that goes with what changed.
#include <openvdb/openvdb.h>

#include <random>
#include <set>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program.h"
#include "tests/sanitized.h"

namespace soilvdb::testing {
namespace {

class Incremental : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    std::string csv = "time,x,y,z\n";
    for (int pass = 0, row = 0; pass < 6; ++pass) {
      for (int i = 0; i <= 20; ++i, ++row)
        csv += fmt::format("{},{},{},{}\n", row / 10.0, i / 10.0 + pass / 7.0, pass * 0.6,
                           0.05 - 0.3 * std::sin(std::numbers::pi * i / 20));
    }
    write_file(folder() / "dig.csv", csv);
  }

  void run_with(const std::string& snapshots, const std::string& out,
                const std::string& options = "") const {
    std::string text = half_sine_scenario(
        terrain_, "dig.csv",
        fmt::format("{{snapshots: {{{}}}, journal: {{sync: {}}}}}", snapshots, sync_));
    text.replace(text.find("0.025"), 5, "0.05");
    write_file(folder() / (out + ".yaml"), text);
    const Result result = run(fmt::format("run {0}.yaml --out {0} {1}", out, options));
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(run("verify " + out).status, 0);
  }

  std::string sync_ = "1";
  std::string terrain_ = "{plane: {z: 0, slope: [0.05, 0.02]}}";

  /// Snapshots on the way, in order.
  std::vector<io::JournalFile> snapshots(const std::string& out) const {
    std::vector<io::JournalFile> files = io::read_journal(folder() / out / "journal").files;
    std::erase_if(files, [](const auto& file) {
      return !file.name.ends_with(".vdb") || file.name == "soil_final.vdb";
    });
    return files;
  }
  std::uint64_t hash(const std::string& file, io::SnapshotInfo* info = nullptr) const {
    return io::read_snapshot(folder() / file, info).soil->state_hash();
  }
  openvdb::FloatGrid::Ptr surface(const std::string& file) const {
    openvdb::initialize();
    openvdb::io::File vdb((folder() / file).string());
    vdb.open(/*delayLoad=*/false);
    return openvdb::gridPtrCast<openvdb::FloatGrid>(vdb.readGrid("surface"));
  }
  /// Are their surfaces leaf by leaf those of whole ones?
  void expect_surfaces_of_whole_ones() const {
    const std::string every = test::kSanitized ? "every: 4" : "every: 1";
    run_with(every, "whole");
    run_with(every + ", incremental: true", "part");
    std::size_t compared = 0;
    for (const io::JournalFile& file : snapshots("part")) {
      if (file.parent.empty()) continue;
      const openvdb::FloatGrid::Ptr part = surface("part/" + file.name),
                                    whole = surface("whole/" + file.name);
      for (auto leaf = part->tree().cbeginLeaf(); leaf; ++leaf, ++compared) {
        const auto* const same = whole->tree().probeConstLeaf(leaf->origin());
        ASSERT_NE(same, nullptr);
        EXPECT_TRUE(*same == *leaf) << file.name << ' ' << leaf->origin();
      }
    }
    EXPECT_GT(compared, 100u);
  }
  /// Makes of a finished run one that ended earlier.
  void interrupt(const std::string& out, double share) const {
    const auto size = static_cast<double>(fs::file_size(folder() / out / "journal"));
    fs::resize_file(folder() / out / "journal", static_cast<std::uintmax_t>(size * share));
    for (const char* name : {"summary.json", "soil_final.vdb", "updates.csv"})
      fs::remove(folder() / out / name);
  }
  std::map<std::string, std::string> vdb_files(const std::string& out) const {
    std::map<std::string, std::string> all;
    for (const auto& entry : fs::directory_iterator(folder() / out)) {
      if (entry.path().extension() == ".vdb")
        all[entry.path().filename()] = read_file(entry.path());
    }
    return all;
  }
  void damage(const std::string& file) const {
    std::string bytes = read_file(folder() / file);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 4);
    write_file(folder() / file, bytes);
  }
};

TEST_F(Incremental, SnapshotsAreTheGroundOfWholeOnesWithAnyThreads) {
  run_with("every: 1", "whole");
  run_with("every: 1, incremental: true", "one", "--threads 1");
  run_with("every: 1, incremental: true", "two", "--threads 2");
  const std::vector<io::JournalFile> files = snapshots("one");
  ASSERT_EQ(files.size(), snapshots("whole").size());
  EXPECT_EQ(read_json(folder() / "one/summary.json")["files"],
            read_json(folder() / "whole/summary.json")["files"]);
  EXPECT_TRUE(vdb_files("one") == vdb_files("two"));
  for (const io::JournalFile& file : files) {
    EXPECT_EQ(hash("one/" + file.name), hash("whole/" + file.name)) << file.name;
  }
  EXPECT_EQ(hash("one/soil_final.vdb"), hash("whole/soil_final.vdb"));
}

TEST_F(Incremental, TheirSurfaceIsThatOfWholeOnes) { expect_surfaces_of_whole_ones(); }

TEST_F(Incremental, TheirSurfaceIsThatOfWholeOnesInADeepPitOfRoughGround) {
  // Layer below layer, so that what was dug before lies at any distance above what is dug now.
  std::mt19937 random(3);
  std::vector<float> heights(41 * 41);
  for (float& z : heights) z = static_cast<float>(random() % 1024) / 1024 - 0.5f;
  io::write_geotiff(folder() / "rough.tif", {41, 41, {-4, -4}, {0.25, 0.25}}, {{"z", heights}}, "");
  terrain_ = "{raster: rough.tif}";
  std::string csv = "time,x,y,z\n";
  for (int pass = 0, row = 0; pass < 8; ++pass) {
    for (int i = 0; i <= 10; ++i, ++row)
      csv += fmt::format("{},{},0,{}\n", row / 5.0, 0.15 * (pass % 2 ? 10 - i : i),
                         0.3 - 0.25 * pass - 0.2 * std::sin(std::numbers::pi * i / 10));
  }
  write_file(folder() / "dig.csv", csv);
  expect_surfaces_of_whole_ones();
}

TEST_F(Incremental, AWholeOneComesWhenTheOthersHaveComeToTheGroundItself) {
  run_with("every: 1, incremental: true", "dig");
  std::size_t incremental = 0;
  const std::vector<io::JournalFile> files = snapshots("dig");
  for (const io::JournalFile& file : files) {
    io::SnapshotInfo info;
    const io::Site site = io::read_snapshot(folder() / "dig" / file.name, &info);
    ASSERT_EQ(info.parent.has_value(), !file.parent.empty());
    if (!info.parent) continue;
    ++incremental;
    EXPECT_LE(info.parent->depth, io::kMaxChainLength);
    EXPECT_LT(info.parent->chunks, site.soil->chunk_count()) << file.name;
  }
  EXPECT_GT(incremental, files.size() / 2);
  EXPECT_LT(incremental, files.size() - 1);
}

TEST_F(Incremental, SnapshotsAreReadByAllCommands) {
  run_with("every: 1", "whole");
  run_with("every: 1, incremental: true", "dig");
  const auto files = snapshots("dig");
  const auto it =
      std::find_if(files.rbegin(), files.rend(), [](const auto& f) { return !f.parent.empty(); });
  ASSERT_NE(it, files.rend());
  const std::string file = it->name, since = it->parent;
  const Result info = run("info dig/" + file);
  EXPECT_NE(info.out.find("goes on from  " + since), std::string::npos) << info.out;
  const auto same = [&](const std::string& command) {
    const Result inc = run(fmt::format(fmt::runtime(command), "dig/" + file));
    const Result whole = run(fmt::format(fmt::runtime(command), "whole/" + file));
    EXPECT_EQ(inc.status, 0) << inc.err;
    return std::pair{inc.out, whole.out};
  };
  const auto [diff, diff_whole] = same("diff --json whole/soil_1.vdb {}");
  auto numbers = nlohmann::json::parse(diff), expected = nlohmann::json::parse(diff_whole);
  for (auto* json : {&numbers, &expected}) json->erase("after");
  EXPECT_EQ(numbers, expected);
  EXPECT_EQ(run("export dig/" + file + " --to a.ply").status, 0);
  EXPECT_EQ(run("export whole/" + file + " --to b.ply").status, 0);
  EXPECT_TRUE(read_file(folder() / "a.ply") == read_file(folder() / "b.ply"));
  EXPECT_EQ(run("verify dig/" + file).status, 0);
  // As the ground to go on from.
  for (const std::string from : {"dig", "whole"}) {
    std::string text = half_sine_scenario("{level_set: " + from + "/" + file + "}", "dig.csv");
    text.replace(text.find("0.025"), 5, "0.05");
    write_file(folder() / ("on_" + from + ".yaml"), text);
    EXPECT_EQ(run("run on_" + from + ".yaml --out on_" + from).status, 0);
  }
  EXPECT_EQ(hash("on_dig/soil_final.vdb"), hash("on_whole/soil_final.vdb"));
}

TEST_F(Incremental, OnlyTheNewestAndWhatTheyNeedAreKept) {
  run_with("every: 1", "whole");
  for (const std::size_t keep : {2, 5}) {
    for (const char* kind : {"", ", incremental: true"}) {
      run_with(fmt::format("every: 1{}, keep: {}", kind, keep), "dig");
      const std::vector<io::JournalFile> files = snapshots("dig");
      std::set<std::string> expected = {"soil_final.vdb"}, needed;
      for (std::size_t i = files.size(); i-- > 0;) {
        if (files.size() - i > keep && !needed.contains(files[i].name)) continue;
        expected.insert(files[i].name);
        needed.insert(files[i].parent);
      }
      std::set<std::string> there;
      for (const auto& [name, bytes] : vdb_files("dig")) there.insert(name);
      EXPECT_EQ(there, expected);
      EXPECT_LT(there.size(), vdb_files("whole").size());
      EXPECT_GE(files.size(), keep);
      const nlohmann::json summary = read_json(folder() / "dig/summary.json");
      for (const auto& name : summary["files"])
        EXPECT_TRUE(fs::exists(folder() / "dig" / std::string(name))) << name;
      for (const std::string& name : there) EXPECT_EQ(hash("dig/" + name), hash("whole/" + name));
    }
  }
}

TEST_F(Incremental, ResumeGoesOnToTheSameFiles) {
  sync_ = "always";
  for (const char* keep : {"", ", keep: 2"}) {
    run_with(std::string("every: 1, incremental: true") + keep, "dig", "--threads 1");
    const auto files = vdb_files("dig");
    const auto summary = read_json(folder() / "dig/summary.json");
    fs::copy(folder() / "dig", folder() / "saved");
    for (const double share : {0.15, 0.5, 0.8}) {
      SCOPED_TRACE(fmt::format("{} {}", keep, share));
      fs::remove_all(folder() / "dig");
      fs::copy(folder() / "saved", folder() / "dig");
      interrupt("dig", share);
      // No crash leaves a journal that knows of files deleted since: that they go is on disk first.
      const auto known = snapshots("dig");
      const bool lost = std::any_of(known.begin(), known.end(), [&](const auto& file) {
        return !fs::exists(folder() / "dig" / file.name);
      });
      const Result result = run("resume dig");
      EXPECT_EQ(result.status, 0) << result.err;
      // What this journal knows may have been deleted by the end of the run.
      const char* from = *keep ? "going on from" : "going on from soil_";
      EXPECT_NE(result.out.find(from), std::string::npos) << result.out;
      EXPECT_TRUE(vdb_files("dig") == files);
      EXPECT_EQ(read_json(folder() / "dig/summary.json")["state_hash"], summary["state_hash"]);
      EXPECT_EQ(read_json(folder() / "dig/summary.json")["files"], summary["files"]);
      if (lost) {
        EXPECT_EQ(run("resume dig").status, 0);
      }
      EXPECT_EQ(run("verify dig").status, 0);
    }
    fs::remove_all(folder() / "saved");
  }
}

TEST_F(Incremental, ABrokenChainIsToldAndResumeFallsBack) {
  sync_ = "always";
  run_with("every: 1, incremental: true", "dig", "--threads 1");
  const auto files = vdb_files("dig");
  // One that ended when the newest two were incremental.
  std::vector<io::JournalFile> known;
  do {
    interrupt("dig", 0.95);
    known = snapshots("dig");
    ASSERT_GT(known.size(), 2u);
  } while (known.back().parent.empty() || known[known.size() - 2].parent.empty());
  const std::string file = known.back().name, since = known.back().parent;
  damage("dig/" + since);
  const std::string what = " is good by itself but needs " + since + ", which is damaged";
  const Result of_file = run("verify dig/" + file), of_folder = run("verify dig");
  EXPECT_EQ(of_file.status, 1);
  EXPECT_NE(of_file.err.find(file + ":" + what), std::string::npos) << of_file.err;
  EXPECT_EQ(of_folder.status, 1);
  EXPECT_NE(of_folder.err.find("; " + file + what), std::string::npos) << of_folder.err;
  expect_refused("info dig/" + file, what);
  const Result result = run("resume dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.err.find(what), std::string::npos) << result.err;
  EXPECT_TRUE(vdb_files("dig") == files);
  EXPECT_EQ(run("verify dig").status, 0);
}

TEST_F(Incremental, AllKeptMayHangOnOneAndWithoutItTheJournalGivesEverythingBack) {
  run_with("every: 1, incremental: true, keep: 2", "dig");
  const auto files = vdb_files("dig");
  const auto summary = read_json(folder() / "dig/summary.json");
  const std::vector<io::JournalFile> kept = snapshots("dig");
  const auto roots =
      std::count_if(kept.begin(), kept.end(), [](const auto& file) { return file.parent.empty(); });
  ASSERT_EQ(roots, 1);
  // Killed before it came to its end, which is the last frame: a head and a letter.
  fs::resize_file(folder() / "dig/journal", fs::file_size(folder() / "dig/journal") - 33);
  for (const char* name : {"summary.json", "soil_final.vdb", "updates.csv"})
    fs::remove(folder() / "dig" / name);
  damage("dig/" + kept.front().name);
  for (const io::JournalFile& file : kept) EXPECT_EQ(run("verify dig/" + file.name).status, 1);
  const Result result = run("resume dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("going on from the beginning"), std::string::npos) << result.out;
  EXPECT_TRUE(vdb_files("dig") == files);
  EXPECT_EQ(read_json(folder() / "dig/summary.json")["state_hash"], summary["state_hash"]);
  EXPECT_EQ(run("verify dig").status, 0);
}

TEST_F(Incremental, OneOfAFinishedRunIsMadeAnew) {
  for (const char* keep : {"", ", keep: 2"}) {
    run_with(std::string("every: 1, incremental: true") + keep, "dig");
    const auto files = vdb_files("dig");
    const std::string summary = read_file(folder() / "dig/summary.json");
    const std::vector<io::JournalFile> known = snapshots("dig");
    for (std::size_t i = 0; i < known.size(); i += (known.size() + 3) / 4) {
      const std::string& name = known[i].name;
      SCOPED_TRACE(name);
      damage("dig/" + name);
      const Result result = run("resume dig");
      EXPECT_EQ(result.status, 0) << result.err;
      EXPECT_NE(result.err.find(name + ": is damaged"), std::string::npos) << result.err;
      EXPECT_TRUE(vdb_files("dig") == files);
      EXPECT_EQ(read_file(folder() / "dig/summary.json"), summary);
      EXPECT_EQ(run("verify dig").status, 0);
    }
  }
}

TEST_F(Incremental, VerifyKnowsWhatASnapshotGoesOnFromByMoreThanItsName) {
  run_with("every: 1", "whole");
  run_with("every: 1, incremental: true", "dig");
  const auto files = vdb_files("dig");
  const std::vector<io::JournalFile> known = snapshots("dig");
  const auto one = std::find_if(known.begin(), known.end(),
                                [](const auto& file) { return !file.parent.empty(); });
  ASSERT_NE(one, known.end());
  // Another good one in its place, of which the journal knows.
  io::JournalFile other = *(one - 1);
  ASSERT_EQ(other.name, one->parent);
  io::SnapshotInfo info;
  const io::Site site = io::read_snapshot(folder() / "whole" / other.name, &info);
  info.scenario = "another";
  io::write_snapshot(folder() / "dig" / other.name, site, info);
  const io::FileDigest digest = io::file_digest(folder() / "dig" / other.name);
  other.size = digest.size, other.crc = digest.crc, other.parent = "";
  const io::JournalContent journal = io::read_journal(folder() / "dig/journal");
  io::JournalWriter(folder() / "dig/journal", journal.good_bytes, journal.done, 1).add(other);
  const Result result = run("verify dig");
  EXPECT_EQ(result.status, 1);
  const std::string what = one->name + " is good by itself but needs " + other.name +
                           ", which is another one than it goes on from";
  EXPECT_NE(result.err.find(what), std::string::npos) << result.err;
  EXPECT_EQ(run("resume dig").status, 0);
  EXPECT_EQ(run("verify dig").status, 0);
}

TEST_F(Incremental, OfARunThatWasStoppedGoOnFromTheLastOnTheWay) {
  run_with("every: 0.3, incremental: true", "dig", "--updates 3000");
  const auto files = vdb_files("dig");
  fs::remove_all(folder() / "dig");
  const Result stopped =
      shell(fmt::format("'{}' run dig.yaml --out dig --updates 3000 & run=$!\n"
                        "until ls dig/soil_[3-9]* >/dev/null 2>&1 || ! kill -0 $run; do sleep "
                        "0.01; done\nkill $run; wait $run",
                        SOILVDB_PROGRAM));
  if (stopped.status == 0) GTEST_SKIP() << "came to its end first";
  EXPECT_EQ(stopped.status, 1);
  EXPECT_TRUE(fs::exists(folder() / "dig/soil_final.vdb"));
  EXPECT_EQ(run("verify dig").status, 0);
  EXPECT_EQ(run("resume dig").status, 0);
  EXPECT_TRUE(vdb_files("dig") == files);
}

TEST_F(Incremental, KeysAreChecked) {
  const auto refused = [&](const std::string& snapshots, const std::string& hint) {
    write_file(folder() / "bad.yaml",
               half_sine_scenario("{plane: {z: 0}}", "dig.csv",
                                  fmt::format("{{snapshots: {{{}}}}}", snapshots)));
    expect_refused("run bad.yaml", hint);
  };
  refused("every: 1, keep: 1", "keep is 1; it must be a whole number from 2 to 1000000");
  refused("every: 1, keep: 2.5", "keep is 2.5; it must be a whole number");
  refused("every: 1, incremental: yes", "incremental is 'yes'; it must be true or false");
  refused("incremental: true", "key 'every' is missing");
}

}  // namespace
}  // namespace soilvdb::testing
