// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs with incremental snapshots, and what is in their files.
#pragma once

#include <gtest/gtest.h>
#include <openvdb/openvdb.h>

#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tests/support/program.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {

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
    text.replace(text.find("0.025"), 5, voxel_);
    write_file(folder() / (out + ".yaml"), text);
    const Result result = run(fmt::format("run {0}.yaml --out {0} {1}", out, options));
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(run("verify " + out).status, 0);
  }

  std::string sync_ = "1", voxel_ = "0.1";
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
    return io::read_snapshot(folder() / file, info).ground->state_hash();
  }
  openvdb::FloatGrid::Ptr surface(const std::string& file) const {
    openvdb::initialize();
    openvdb::io::File vdb((folder() / file).string());
    vdb.open(/*delayLoad=*/false);
    return openvdb::gridPtrCast<openvdb::FloatGrid>(vdb.readGrid("surface"));
  }
  /// Are their surfaces leaf by leaf those of whole ones?
  void expect_surfaces_of_whole_ones() {
    voxel_ = "0.05";
    const std::string every = test::kSanitized ? "every: 2" : "every: 1";
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
    EXPECT_GT(compared, test::kSanitized ? 30u : 100u);
  }
  /// Makes of a finished run one that ended earlier.
  void interrupt(const std::string& out, double share) const {
    cut_journal(folder() / out / "journal", share);
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

}  // namespace soilvdb::test
