// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a recorded session's folder goes through: programs that go elsewhere, times of any size,
// folders that are removed.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "tests/session/session_fixture.h"
#include "tests/support/program.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace session_folder_test {

using test::TempFolder;

Recording to(const fs::path& folder) { return {.folder = folder}; }

std::string refusal(const auto& work) {
  try {
    work();
  } catch (const std::exception& e) {
    return e.what();
  }
  return "taken";
}

/// A program's working folder, until it goes.
class WorkingFolder {
 public:
  explicit WorkingFolder(const fs::path& folder) : before_(fs::current_path()) {
    fs::create_directories(folder);
    fs::current_path(folder);
  }
  ~WorkingFolder() { fs::current_path(before_); }

 private:
  fs::path before_;
};

std::vector<std::string> names_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

TEST_P(Sessions, StayInTheirFoldersWhereverTheProgramGoes) {
  const TempFolder temp;
  write_file(temp / "there/site/soil_3.vdb", "somebody's");
  Recording recording = to("site");
  recording.snapshot_every_s = 1;
  recording.keep = 2;
  Session session(site());
  {
    const WorkingFolder here(temp / "here");
    fs::create_directory("cold");
    session.set_memory_limit(60'000, "cold");
    session.record(recording);
  }
  const WorkingFolder there(temp / "there");
  feed(session, part(states(), 0, 0.2));
  session.flush();  // else the next that comes due may have to wait
  feed(session, part(states(), 0.2, 0.3));
  session.stop_recording();
  session.restore(session.save());
  EXPECT_EQ(read_file(temp / "there/site/soil_3.vdb"), "somebody's");
  EXPECT_EQ(names_in(temp / "there/site").size(), 1u);
  EXPECT_EQ(names_in(temp / "here/site").size(), 3u);
}

TEST_P(Sessions, WriteNothingButSnapshots) {
  const TempFolder temp;
  const Session session(site());
  for (const char* name : {"y.tif", "y", "y.vdb.tif"}) {
    EXPECT_EQ(
        refusal([&] { session.write(temp / name); }),
        (temp / name).string() + ": a session writes a snapshot; its name must end with .vdb");
    EXPECT_FALSE(fs::exists(temp / name));
  }
}

TEST_P(Sessions, WhoseMemoryCouldntBeLimitedAreAsBefore) {
  const TempFolder temp;
  Session session(site());
  EXPECT_NE(refusal([&] { session.set_memory_limit(60'000, temp / "no folder"); }), "taken");
  feed(session, part(states(), 0, 0.3));
  EXPECT_EQ(session.clone().save(), session.save());
}

TEST(SessionFolder, KeepsSnapshotsApartWhateverTheirTimes) {
  for (const bool incremental : {false, true}) {
    const TempFolder temp;
    Recording recording = to(temp / "site");
    recording.snapshot_every_s = 1e-9;
    recording.incremental = incremental;
    recording.keep = 2;
    const auto feed_all = [](Session& session) {
      feed(session, part(states(), 0, 0.1));
      for (const double until_s : {11.0, 13.0, 17.0}) ASSERT_TRUE(session.pour(until_s).ok());
      MachineState state = states().front();
      for (const double time_s : {20.0, 20 + 1e-8, 20 + 3e-8, 1e300}) {
        state.time_s = time_s;
        state.pose.position.x() += 0.05;
        ASSERT_TRUE(session.update(state).ok());
        session.flush();
      }
    };
    Session session(site_of(moving())), unrecorded(site_of(moving()));
    session.record(recording);
    feed_all(session);
    feed_all(unrecorded);
    session.stop_recording();
    const std::vector<std::string> names = names_in(temp / "site");
    EXPECT_GE(names.size(), 3u) << "a journal and two snapshots";
    EXPECT_EQ(std::count(names.begin(), names.end(), "soil_1e+300.vdb"), 1);
    for (const io::JournalFile& file : io::read_journal(temp / "site/journal").files)
      EXPECT_TRUE(fs::exists(temp / "site" / file.name) && file.name != file.parent) << file.name;
    Session again(site_of(moving()));
    again.record(recording);
    EXPECT_EQ(again.save(), unrecorded.save());
  }
}

TEST(SessionFolder, AcknowledgesNothingInAFolderThatWasRemoved) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.sync_s = 0;
  Session session(site_of());
  session.record(recording);
  feed(session, part(states(), 0, 0.2));
  const std::uint64_t safe = session.acknowledged().updates;
  fs::remove_all(temp / "site");
  const StepResult step = session.update(part(states(), 0.2, 1).front());
  EXPECT_EQ(step.status, Status::kFailed);
  EXPECT_NE(step.why.find("can't be written: No such file"), std::string::npos) << step.why;
  EXPECT_EQ(session.acknowledged().updates, safe);
  EXPECT_THROW(session.stop_recording(), std::runtime_error);
}

TEST(SessionFolder, WaitsAsLongAsItIsToldToWithoutWork) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.sync_s = 1e300;
  Session session(site_of());
  session.record(recording);
  feed(session, part(states(), 0, 0.1));
  const std::clock_t begin = std::clock();
  usleep(300'000);
  EXPECT_LT(std::clock() - begin, CLOCKS_PER_SEC / 10);
  EXPECT_EQ(session.acknowledged().updates, 0u);
}

TEST(SessionFolder, PassesOverAPipeInASnapshotsPlace) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.snapshot_every_s = 5;
  Session session(site_of());
  session.record(recording);
  feed(session, states());
  session.stop_recording();
  for (const std::string& name : names_in(temp / "site")) {
    if (!name.ends_with(".vdb")) continue;
    fs::remove(temp / "site" / name);
    fs::create_symlink("/dev/zero", temp / "site" / name);
  }
  alarm(60);  // who reads it never ends
  Session again(site_of());
  again.record(recording);
  alarm(0);
  EXPECT_EQ(again.save(), session.save());
}

TEST(SessionFolder, OfAnotherChainIsRefusedThoughNothingWasDug) {
  const TempFolder temp;
  const auto site = [](const Vec3& first, const Vec3& second) {
    SessionSite all = site_of();
    Chain& chain = all.machines[0].chain.emplace();
    for (const Vec3& axis : {first, second}) {
      Joint& joint = chain.joints.emplace_back();
      joint.name = chain.joints.size() == 1 ? "a" : "b";
      joint.type = Joint::Type::kPrismatic;
      joint.axis = axis;
    }
    return all;
  };
  const std::vector<double> joints = {1, 7};
  Session session(site(Vec3::UnitX(), Vec3::UnitZ()));
  session.record(to(temp / "site"));
  ASSERT_TRUE(session.update({.time_s = 0, .joints = joints}).ok());
  session.stop_recording();
  // Both together bring the bucket to the same places.
  Session swapped(site(Vec3::UnitZ(), Vec3::UnitX()));
  EXPECT_NE(refusal([&] { swapped.record(to(temp / "site")); }).find("machine 1: chain"),
            std::string::npos);
  Session same(site(Vec3::UnitX(), Vec3::UnitZ()));
  EXPECT_EQ(same.record(to(temp / "site")).updates, 1u);
}

}  // namespace session_folder_test
}  // namespace soilvdb::test
