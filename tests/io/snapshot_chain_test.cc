// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Incremental snapshots: what they hold, what they give back, and every way in which what they go
// on from can be wrong.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>

#include <cmath>
#include <fstream>
#include <random>
#include <sstream>

#include "core/ground/ground_writer.h"
#include "soilvdb/change_follower.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/tracker.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace snapshot_chain_test {

namespace fs = std::filesystem;
using test::TempFolder;
using ::testing::HasSubstr;

std::string content(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

/// A dig that is written as 0.vdb, which is whole, 1.vdb, 2.vdb...
class SnapshotChain : public ::testing::Test {
 protected:
  SnapshotChain() {
    Base base = open_base(PlaneTerrain{0, {0.1, -0.2}});
    site_ = {std::make_unique<Ground>(0.05, Vec3::Zero(), base.surface), base.reference, "",
             base.bounds};
    tracker_ = std::make_unique<Tracker>(*site_.ground, std::vector{bucket()});
    changes_.emplace(*site_.ground);
  }

  static Bucket bucket() {
    Bucket bucket;
    bucket.width_m = 0.5;
    bucket.height_m = 0.4;
    bucket.profile = {{0, 0}, {-0.3, 0.2}, {0, 0.4}};
    return bucket;
  }

  fs::path file(std::size_t n) const { return folder_ / (std::to_string(n) + ".vdb"); }

  /// Digs a part of a path, from 0 to 1, in ten updates.
  void dig(double from, double to) {
    for (int i = 1; i <= 10; ++i) {
      const double s = from + (to - from) * i / 10;
      tracker_->update(0, {{2 * s, 0.1 * s, -0.3 * std::sin(4 * s)}, from_rpy(0.1, s - 0.5, 0.2)});
    }
  }

  SnapshotInfo info() {
    return {"dig", double(count_), tracker_->total().cut_m3(), 0, 0, 0, tracker_->state()};
  }
  void write_whole() {
    write_snapshot(file(count_), site_, info());
    ++count_;
    changes_->take();
  }
  /// What the file must hold.
  struct Changes {
    std::vector<Coord3> held, dropped;
  };
  Changes write_incremental(const std::string& since = "") {
    SnapshotInfo info = this->info();
    info.parent = SnapshotParent{since.empty() ? file(count_ - 1).filename().string() : since,
                                 file_digest(file(count_ - 1))};
    Site part = undug_site(site_);
    Changes changes;
    for (const Coord3& origin : changes_->take()) {
      GroundWriter(*part.ground).copy_from(*site_.ground, origin);
      (site_.ground->find(origin) ? changes.held : changes.dropped).push_back(origin);
    }
    info.parent->dropped = changes.dropped;
    write_snapshot(file(count_++), part, info);
    return changes;
  }

  /// 0.vdb to 4.vdb; @return the hash of the ground in each
  std::vector<std::uint64_t> write_five() {
    std::vector<std::uint64_t> hashes;
    for (int n = 0; n < 5; ++n) {
      dig(n / 5.0, (n + 1) / 5.0);
      n == 0 ? write_whole() : void(write_incremental());
      hashes.push_back(site_.ground->state_hash());
    }
    return hashes;
  }

  std::string refusal(std::size_t n) const {
    bool refused = false;
    const std::string message = test::message_of(folder_, [&] {
      try {
        read_snapshot(file(n));
      } catch (const InputError&) {
        refused = true;
        throw;
      }
    });
    return refused ? message : "accepted: " + message;
  }

  TempFolder folder_;
  Site site_;
  std::unique_ptr<Tracker> tracker_;
  std::optional<ChangeFollower> changes_;
  std::size_t count_ = 0;
};

TEST_F(SnapshotChain, GivesTheBitsOfAWholeOneAndTheTrackerGoesOn) {
  const std::vector<std::uint64_t> hashes = write_five();
  SnapshotInfo info;
  for (std::size_t n = 0; n < 5; ++n) {
    const Site back = read_snapshot(file(n), &info);
    EXPECT_EQ(back.ground->state_hash(), hashes[n]) << n;
    EXPECT_EQ(info.time_s, double(n));
    ASSERT_EQ(info.parent.has_value(), n > 0);
    EXPECT_EQ(info.parent ? info.parent->depth : 0, n);
  }
  // From 2.vdb on again, to the bytes of 3.vdb and 4.vdb.
  const std::string third = content(file(3)), fourth = content(file(4));
  tracker_.reset();
  site_ = read_snapshot(file(2), &info);
  tracker_ = std::make_unique<Tracker>(*site_.ground, std::vector{bucket()});
  tracker_->restore(info.tracker_state);
  changes_.emplace(*site_.ground);
  changes_->take();
  count_ = 3;
  dig(3 / 5.0, 4 / 5.0);
  write_incremental();
  dig(4 / 5.0, 1);
  write_incremental();
  EXPECT_TRUE(content(file(3)) == third);
  EXPECT_TRUE(content(file(4)) == fourth);
}

TEST_F(SnapshotChain, HoldsWhatChangedAndNothingElse) {
  dig(0, 0.5);
  write_whole();
  for (int n = 0; n < 5; ++n) {
    dig(0.5 + n / 10.0, 0.6 + n / 10.0);
    const Changes changes = write_incremental();
    ASSERT_FALSE(changes.held.empty());
    openvdb::io::File vdb(file(count_ - 1).string());
    vdb.open(false);
    std::vector<Coord3> held;
    const auto surface = openvdb::gridPtrCast<openvdb::FloatGrid>(vdb.readGrid("surface"));
    for (auto leaf = surface->tree().cbeginLeaf(); leaf; ++leaf)
      held.emplace_back(leaf->origin().x(), leaf->origin().y(), leaf->origin().z());
    std::sort(held.begin(), held.end(), before);
    EXPECT_EQ(held, changes.held);
    SnapshotInfo info;
    read_snapshot(file(count_ - 1), &info);
    std::vector<Coord3> gone = info.parent->dropped;
    std::sort(gone.begin(), gone.end(), before);
    EXPECT_EQ(gone, changes.dropped);
  }
}

TEST_F(SnapshotChain, AChunkThatWasDroppedIsTheBaseSurfaceAgain) {
  dig(0, 1);
  write_whole();
  const Coord3 origin = site_.ground->chunks().front()->origin;
  GroundWriter(*site_.ground).drop(origin);
  const Changes changes = write_incremental();
  EXPECT_THAT(changes.dropped, ::testing::Contains(origin));
  const Site back = read_snapshot(file(1));
  EXPECT_EQ(back.ground->find(origin), nullptr);
  EXPECT_EQ(back.ground->state_hash(), site_.ground->state_hash());
}

TEST_F(SnapshotChain, MayMoveTogether) {
  const std::uint64_t hash = write_five().back();
  fs::create_directories(folder_ / "else/where");
  for (std::size_t n = 0; n < 5; ++n)
    fs::rename(file(n), folder_ / "else/where" / file(n).filename());
  EXPECT_EQ(read_snapshot(folder_ / "else/where/4.vdb").ground->state_hash(), hash);
}

TEST_F(SnapshotChain, AnyFlippedBitOfAnyFileIsFound) {
  write_five();
  std::mt19937 random(7);
  for (int i = 0; i < 100; ++i) {
    const std::size_t n = random() % 5;
    const std::string good = content(file(n));
    std::string bad = good;
    const std::size_t at = random() % bad.size();
    bad[at] = static_cast<char>(bad[at] ^ (1 << random() % 8));
    folder_.write(file(n).filename().string(), bad);
    const std::string name = file(n).filename().string();
    EXPECT_THAT(refusal(4), HasSubstr(n == 4 ? "4.vdb: is damaged"
                                             : "4.vdb: is good by itself but needs " + name +
                                                   ", which is damaged"));
    EXPECT_EQ(refusal(n == 0 ? 4 : n - 1).starts_with("accepted"), n > 0);
    folder_.write(name, good);
  }
}

TEST_F(SnapshotChain, WhatIsMissingOrAnotherOneIsSaid) {
  write_five();
  const std::string good = content(file(2));
  fs::remove(file(2));
  EXPECT_THAT(refusal(4), HasSubstr("4.vdb: is good by itself but needs 2.vdb, which is missing"));
  fs::create_directory(file(2));
  EXPECT_THAT(refusal(4), HasSubstr("but needs 2.vdb, which is a folder"));
  fs::remove(file(2));
  fs::copy(file(1), file(2));
  EXPECT_THAT(refusal(4),
              HasSubstr("but needs 2.vdb, which is not the snapshot that it continues"));
  fs::copy(file(4), file(2), fs::copy_options::overwrite_existing);  // round and round
  EXPECT_THAT(refusal(4),
              HasSubstr("but needs 2.vdb, which is not the snapshot that it continues"));
  folder_.write("2.vdb", "not a snapshot");
  EXPECT_THAT(refusal(4), HasSubstr("but needs 2.vdb, which is not a snapshot"));
  folder_.write("2.vdb", good.substr(0, good.size() / 2));
  EXPECT_THAT(refusal(4), HasSubstr("but needs 2.vdb, which is damaged: its end is missing"));
  folder_.write("2.vdb", good);
  EXPECT_THAT(refusal(4), HasSubstr("accepted"));
}

TEST_F(SnapshotChain, OfAnotherSiteIsRefused) {
  write_whole();
  site_.reference = {PlaneTerrain{1.5, {0.1, 0.3}}, ""};
  write_incremental();
  EXPECT_THAT(refusal(1),
              HasSubstr("but needs 0.vdb, which is not the snapshot that it continues"));
}

TEST_F(SnapshotChain, GoesOnFromNothingOutsideItsFolder) {
  for (const char* name : {"../0.vdb", "/tmp/0.vdb", "..", ".", "a/0.vdb"}) {
    count_ = 0;
    write_whole();
    write_incremental(name);
    EXPECT_THAT(refusal(1), HasSubstr("the snapshot that it continues is not in its folder"))
        << name;
  }
}

TEST_F(SnapshotChain, ThatIsTooLongIsRefused) {
  write_whole();
  for (std::size_t n = 0; n <= kMaxChainLength; ++n) write_incremental();
  EXPECT_THAT(refusal(kMaxChainLength), HasSubstr("accepted"));
  EXPECT_THAT(refusal(kMaxChainLength + 1), HasSubstr("65.vdb: continues more than 64 others"));
}

}  // namespace snapshot_chain_test
}  // namespace soilvdb::io
