// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a session was fed survives it: recorded to a folder it is gone on with to the same bits.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <set>

#include "soilvdb/io/error.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tests/session/session_fixture.h"
#include "tests/support/program.h"
#include "tests/support/sanitized.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace session_record_test {

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

/// Feeds all in one of several ways, which a seed says: one by one, in batches, with pours, rest
/// and states without a time between.
void feed_somehow(Session& session, const std::vector<MachineState>& all, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  for (std::size_t at = 0; at < all.size();) {
    const std::size_t most = std::min<std::size_t>(all.size() - at, 1 + random() % 5);
    if (random() % 4 == 0) {
      ASSERT_TRUE(session.update(std::span(all).subspan(at, most)).ok());
      at += most;
      continue;
    }
    MachineState state = all[at++];
    ASSERT_TRUE(session.update(state).ok());
    switch (random() % 8) {
      case 0:
        ASSERT_TRUE(session.pour(*state.time_s + 0.2).ok());
        break;
      case 1:
        ASSERT_TRUE(session.come_to_rest().ok());
        break;
      case 2:
        state.pose.position.x() += 0.05;
        ASSERT_TRUE(session.update(state).ok()) << "at the same time";
        break;
      case 3:
        state.pose.position.x() += 0.05;
        state.time_s.reset();
        ASSERT_TRUE(session.update(state).ok());
        break;
      default:
        break;
    }
  }
}

TEST_P(Sessions, GoOnFromWhereTheyWereRecorded) {
  for (const bool snapshots : {false, true}) {
    for (const std::uint64_t seed : {1, 2, 3}) {
      if (!test::kLong && !snapshots && seed != 2) continue;
      SCOPED_TRACE(fmt::format("{} {}", snapshots, seed));
      const TempFolder temp;
      Recording recording = to(temp / "site");
      if (snapshots) recording.snapshot_every_s = 3;
      recording.incremental = seed > 1;
      if (seed == 3) recording.keep = 2;
      Session never_stopped(site());
      {
        Session session(site());
        EXPECT_EQ(session.record(recording).updates, 0u);
        feed_somehow(session, part(states(), 0, 0.6), seed);
        session.flush();
      }
      feed_somehow(never_stopped, part(states(), 0, 0.6), seed);
      Session session(site());
      std::uint64_t seen = 0;
      const io::JournalExtent had =
          session.record(recording, [&](const io::JournalExtent& at) { seen = at.updates; });
      EXPECT_GT(had.updates, part(states(), 0, 0.6).size());
      EXPECT_EQ(had.time_s, *part(states(), 0, 0.6).back().time_s);
      EXPECT_LE(seen, had.updates);
      EXPECT_EQ(session.acknowledged().updates, had.updates);
      ASSERT_EQ(session.save(), never_stopped.save());
      feed_somehow(session, part(states(), 0.6, 1), seed);
      feed_somehow(never_stopped, part(states(), 0.6, 1), seed);
      ASSERT_EQ(session.save(), never_stopped.save());
      EXPECT_EQ(session.ground_hash(), never_stopped.ground_hash());
      session.stop_recording();
      std::size_t count = 0;
      for (const auto& entry : fs::directory_iterator(temp / "site"))
        count += entry.path().extension() == ".vdb";
      EXPECT_EQ(count > 1, snapshots);
      EXPECT_NE(refusal([&] { session.record(to(temp / "another")); }).find("before the first"),
                std::string::npos);
      // Without any of its snapshots, or with the newest damaged, the journal says it all.
      for (const auto& entry : fs::directory_iterator(temp / "site"))
        if (entry.path().extension() == ".vdb" && (seed == 1 || entry.file_size() % 2 == 0))
          fs::resize_file(entry.path(), entry.file_size() / 2);
      Session again(site());
      again.record(recording);
      EXPECT_EQ(again.save(), never_stopped.save());
      again.stop_recording();
      EXPECT_NE(refusal([&] { again.record(to(temp / "another")); }).find("before the first"),
                std::string::npos);
    }
  }
}

/// All states from one up to another. In the second quarter of all the digger's clock is 7 s ahead,
/// so that later snapshots are of the same times; then it is set.
void feed_ahead(Session& session, std::size_t begin, std::size_t end) {
  const std::vector<MachineState> all = states();
  for (std::size_t i = begin; i < end; ++i) {
    MachineState state = all[i];
    if (i >= all.size() / 4 && i < all.size() / 2 && state.machine == 0) *state.time_s += 7;
    if (i == all.size() / 2) {
      ASSERT_TRUE(session.reset_clock(0).ok());
    }
    feed(session, {state});
    session.flush();  // else a snapshot that comes due may have to wait for the last
  }
}

TEST_P(Sessions, GoOnWhereAClockWasAheadAndIsSet) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.snapshot_every_s = 1;
  recording.incremental = true;
  const std::vector<MachineState> all = states();  // two at a time
  std::map<std::size_t, std::uint64_t> grounds;    // by the states there were
  std::string last;
  {
    Session session(site());
    session.record(recording);
    std::size_t fed = 0;
    for (const double share : {0.1, 0.4, 0.8}) {
      const std::size_t until =
          2 * static_cast<std::size_t>(share / 2 * static_cast<double>(all.size()));
      feed_ahead(session, fed, until);
      grounds[fed = until] = session.ground_hash();
    }
    feed_ahead(session, fed, all.size());
    for (const std::size_t machine : {0, 1})
      EXPECT_NE(session.update(all[machine]).why.find("time goes back"), std::string::npos);
    EXPECT_FALSE(session.reset_clock(2).ok());
    last = session.save();
  }
  Session again(site());
  EXPECT_EQ(again.record(recording).updates, all.size() + 1);
  EXPECT_EQ(again.save(), last);
  again.stop_recording();
  // Other times are what was fed by then, whatever the clock said that was ahead.
  for (const auto& [fed, ground] : grounds) {
    const Session there = Session(site()).recorded(recording.folder, *all[fed - 1].time_s);
    EXPECT_EQ(there.ground_hash(), ground) << fed;
  }
  // Snapshots go on to come, and none takes the place of another.
  io::JournalReader reader(recording.folder / "journal");
  std::set<std::string> names;
  std::size_t files = 0, later = 0, of_a_time_again = 0;
  while (const auto record = reader.next()) {
    const auto* file = std::get_if<io::JournalFile>(&*record);
    if (file == nullptr) continue;
    ++files;
    later += file->updates > all.size() / 2 + 1;
    of_a_time_again += std::count(file->name.begin(), file->name.end(), '_') == 2;
    names.insert(file->name);
  }
  EXPECT_EQ(names.size(), files);
  EXPECT_GE(later, 15u) << "in 20 s";
  EXPECT_GE(of_a_time_again, 5u);
}

TEST_P(Sessions, AreTheSameWithLittleMemory) {
  const TempFolder temp;
  Session free(site()), limited(site());
  feed(free, states());
  limited.set_memory_limit(60'000, temp.path());
  limited.record(to(temp / "site"));
  feed(limited, part(states(), 0, 0.7));
  limited.stop_recording();
  EXPECT_LT(limited.memory_bytes(), free.memory_bytes());
  EXPECT_NE(refusal([&] { limited.clone(); }).find("limited"), std::string::npos);
  limited.restore(limited.save());
  feed(limited, part(states(), 0.7, 1));
  EXPECT_LT(limited.memory_bytes(), free.memory_bytes()) << "still";
  EXPECT_EQ(limited.save(), free.save());
  const std::vector<Vec2> places = {{-2, 0}, {0, 0}, {2, 2}};
  std::vector<double> a(3), b(3);
  free.heights(places, a).check();
  limited.heights(places, b).check();
  EXPECT_EQ(a, b);
  Session from_folder(site());
  from_folder.set_memory_limit(60'000, temp.path());
  EXPECT_GT(from_folder.record(to(temp / "site")).updates, 0u);
  feed(from_folder, part(states(), 0.7, 1));
  EXPECT_EQ(from_folder.save(), free.save());
}

TEST_P(Sessions, RefuseWhatTheirMemoryIsTooSmallFor) {
  const TempFolder temp;
  Session session(site());
  EXPECT_NE(refusal([&] { session.set_memory_limit(0, temp.path()); }), "taken");
  EXPECT_NE(refusal([&] { session.set_memory_limit(1000, temp / "no folder"); }), "taken");
  session.set_memory_limit(1000, temp.path());
  StepResult step;
  std::string ground;
  for (std::size_t i = 0; step.ok() && i < states().size(); ++i) {
    ground = session.save();
    step = session.update(states()[i]);
  }
  EXPECT_EQ(step.status, Status::kFailed);
  EXPECT_NE(step.why.find("more memory"), std::string::npos) << step.why;
  EXPECT_EQ(session.save(), ground);
}

TEST(SessionRecord, IsNotMixedUpWithAnythingElse) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  Session session(site_of(moving()));
  session.record(recording);
  EXPECT_EQ(refusal([&] { session.record(to(temp / "other")); }),
            "the session is recorded already");
  EXPECT_FALSE(fs::exists(temp / "other"));
  feed(session, part(states(), 0, 0.2));
  EXPECT_NE(refusal([&] { session.restore(session.save()); }).find("recorded"), std::string::npos);
  {
    Session second(site_of(moving()));
    EXPECT_NE(refusal([&] { second.record(recording); }).find("at work in this folder"),
              std::string::npos);
  }
  const Session clone = session.clone();
  EXPECT_EQ(clone.acknowledged().updates, 0u);
  session.stop_recording();
  EXPECT_EQ(session.acknowledged().updates, 0u);
  EXPECT_NE(refusal([&] { session.record(recording); }).find("before the first state"),
            std::string::npos);

  const auto other_site = [&](const auto& change) {
    SessionSite site = site_of(moving());
    change(site);
    Session other(site);
    const std::string before = read_file(temp / "site/journal");
    const std::string why = refusal([&] { other.record(recording); });
    EXPECT_EQ(read_file(temp / "site/journal"), before);
    EXPECT_TRUE(other.update({.time_s = 0}).ok()) << "it is of use without a recording";
    return why;
  };
  const std::string folder = (temp / "site").string();
  EXPECT_EQ(other_site([](auto& s) { s.voxel_size_m = 0.2; }),
            folder + ": is a recording of another site: voxel_size_m differs; name another folder");
  EXPECT_NE(other_site([](auto& s) {
              s.terrain = io::PlaneTerrain{0.3, {0, 0}};
            }).find("plane"),
            std::string::npos);
  EXPECT_NE(other_site([](auto& s) { s.machines.pop_back(); }).find("has states of machine"),
            std::string::npos);
  EXPECT_NE(other_site([](auto& s) {
              s.machines[0].bucket.profile[1].x() -= 0.01;
            }).find("machine 1: profile"),
            std::string::npos);
  EXPECT_NE(other_site([](auto& s) { s.earthmoving.soil->swell = 0.3; }).find("soil"),
            std::string::npos);
  EXPECT_NE(
      other_site([](auto& s) { s.earthmoving.pours[1].volume_m3 = 2; }).find("pour 2 differs"),
      std::string::npos);
  EXPECT_NE(other_site([](auto& s) { s.earthmoving.hoppers.clear(); }).find("hoppers"),
            std::string::npos);

  const auto bad = [&](const auto& change) {
    Recording other = to(temp / "bad");
    change(other);
    return refusal([&] { Session(site_of()).record(other); });
  };
  EXPECT_NE(bad([](auto& r) { r.sync_s = -1; }), "taken");
  EXPECT_NE(bad([](auto& r) { r.sync_s = kNaN; }), "taken");
  EXPECT_NE(bad([](auto& r) { r.snapshot_every_s = 0; }), "taken");
  EXPECT_NE(bad([](auto& r) { r.keep = 1; }), "taken");
  EXPECT_FALSE(fs::exists(temp / "bad"));
  write_file(temp / "bad/soil_3.vdb", "somebody's");
  EXPECT_NE(bad([](auto&) {}).find("soil_3.vdb"), std::string::npos);
  EXPECT_EQ(read_file(temp / "bad/soil_3.vdb"), "somebody's");
}

TEST(SessionRecord, CountsTheTimesOfABatchForItsSnapshots) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.snapshot_every_s = 3;
  Session session(site_of());
  session.record(recording);
  const std::vector<MachineState> batch = {{.time_s = 0}, {.time_s = 4}};
  ASSERT_TRUE(session.update(batch).ok());
  session.stop_recording();
  EXPECT_TRUE(fs::exists(temp / "site/soil_4.vdb"));
}

TEST(SessionRecord, ThatIsDamagedOrDugOtherwiseIsRefused) {
  const TempFolder temp;
  const fs::path journal = temp / "site/journal";
  {
    Session session(site_of());
    Recording often = to(temp / "site");
    often.sync_s = 0;
    session.record(often);
    feed(session, states());
  }
  const std::string good = read_file(journal);
  std::string damaged = good;
  damaged[damaged.size() / 2] ^= 1;
  write_file(journal, damaged);
  const auto why = [&] { return refusal([&] { Session(site_of()).record(to(temp / "site")); }); };
  EXPECT_NE(why().find("is damaged at byte"), std::string::npos) << why();
  EXPECT_EQ(read_file(journal), damaged) << "nothing is lost";
  // A frame that never became whole is what a crash leaves.
  write_file(journal, good.substr(0, good.size() - 3));
  Session shorter(site_of()), fed(site_of());
  EXPECT_EQ(shorter.record(to(temp / "site")).updates, states().size() - 1);
  feed(fed, states());
  ASSERT_TRUE(shorter.update(states().back()).ok());
  EXPECT_EQ(shorter.save(), fed.save());
  shorter.stop_recording();

  io::JournalReader reader(journal);
  const auto config = std::get<io::JournalConfig>(*reader.next());
  for (const bool load : {false, true}) {
    io::JournalWriter writer(journal, io::begin_journal(journal, config), {}, 1);
    io::JournalUpdate update{.rows = {false, 7, {0}, {-3, 0, 3, 0, 0, 0, 1}}};
    (load ? update.bucket_samples : update.cut_samples) = 17;
    writer.add(update);
    writer.flush();
    EXPECT_NE(why().find(load ? "and now leaves 0 m³" : "and now cuts 0 m³"), std::string::npos)
        << why();
  }
}

TEST_P(Sessions, RecordedOnAFullDiskRefuseWhatTheyCantKeep) {
  for (const double sync_s : {0.0, 0.01}) {
    const TempFolder temp;
    Recording recording = to(temp / "site");
    recording.sync_s = sync_s;
    Session session(site());
    session.record(recording);
    feed(session, part(states(), 0, 0.3));
    session.flush();
    const std::uint64_t safe = session.acknowledged().updates;
    // Beyond the file's size now writing fails as on a full disk.
    rlimit before{};
    getrlimit(RLIMIT_FSIZE, &before);
    const auto handler = signal(SIGXFSZ, SIG_IGN);
    rlimit full = before;
    full.rlim_cur = fs::file_size(temp / "site/journal") + 10;
    setrlimit(RLIMIT_FSIZE, &full);
    StepResult step;
    std::string ground;
    std::size_t taken = 0;
    for (const MachineState& state : part(states(), 0.3, 1)) {
      ground = session.save();
      step = session.update(state);
      if (!step.ok()) break;
      ++taken;
      usleep(20'000);
    }
    EXPECT_EQ(step.status, Status::kFailed);
    EXPECT_NE(step.why.find("can't be written: File too large"), std::string::npos) << step.why;
    EXPECT_EQ(session.acknowledged().updates, safe);
    if (sync_s == 0)
      EXPECT_EQ(taken, 0u) << "what is answered is safe";
    else
      EXPECT_EQ(session.save(), ground) << "what is refused moved nothing";
    EXPECT_FALSE(session.update(states().back()).ok());
    EXPECT_FALSE(session.come_to_rest().ok());
    EXPECT_THROW(session.flush(), std::runtime_error);
    setrlimit(RLIMIT_FSIZE, &before);
    signal(SIGXFSZ, handler);
    EXPECT_THROW(session.stop_recording(), std::runtime_error);
    EXPECT_TRUE(session.update(states().back()).ok()) << "unrecorded it goes on";
    Session again(site());
    EXPECT_EQ(again.record(recording).updates, safe);
  }
}

std::set<std::string> snapshots_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".vdb") names.insert(entry.path().filename());
  return names;
}

TEST_P(Sessions, WriteToTheJournalWhatIsBooked) {
  const TempFolder temp;
  Session session(site());
  session.record(to(temp / "site"));
  std::vector<std::int64_t> loads;
  std::vector<Update> updates;
  for (const MachineState& state : states()) {
    const StepResult step = session.update(state);
    ASSERT_TRUE(step.ok()) << step.why;
    updates.push_back(step.update);
    loads.push_back(session.ledger(state.machine).load);
  }
  session.stop_recording();
  const Ledger total = session.total();
  io::JournalReader reader(temp / "site/journal");
  reader.next();
  std::int64_t cut = 0, spilled = 0, slid = 0;
  double slid_m3 = 0;
  for (std::size_t i = 0; i < updates.size(); ++i) {
    const auto fed = std::get<io::JournalUpdate>(*reader.next());
    EXPECT_EQ(fed.bucket_samples, loads[i]) << i;
    EXPECT_EQ(fed.ns, std::llround(1000 * updates[i].us)) << i;
    cut += fed.cut_samples;
    spilled += fed.spilled;
    slid += fed.slid;
    slid_m3 += updates[i].slid_m3;
  }
  EXPECT_EQ(cut, total.cut());
  EXPECT_EQ(spilled, total.spilled);
  EXPECT_NEAR(total.units.loose_samples(slid) * total.sample_m3, slid_m3, 1e-9);
  EXPECT_EQ(slid > 0, GetParam());
}

TEST_P(Sessions, WriteSnapshotsWhenTheyAreDueHoweverOftenTheyAreStopped) {
  for (const std::optional<std::size_t> keep : {std::optional<std::size_t>(), {2}}) {
    const TempFolder temp;
    for (const bool stopped : {false, true}) {
      Recording recording = to(temp / (stopped ? "stopped" : "whole"));
      recording.snapshot_every_s = 6;
      recording.keep = keep;
      double fed = 0;
      for (const double until : stopped ? std::vector{0.33, 0.62, 1.0} : std::vector{1.0}) {
        Session session(site());
        session.record(recording);
        for (const MachineState& state : part(states(), fed, until)) {
          feed(session, {state});
          session.flush();  // else one that comes due may have to wait for the last
        }
        fed = until;
      }
    }
    // Every six seconds since the first state.
    double due_s = *states().front().time_s;
    std::vector<std::string> due;
    while ((due_s += 6) <= states().back().time_s) due.push_back(fmt::format("soil_{}.vdb", due_s));
    if (keep) due.erase(due.begin(), due.end() - static_cast<std::ptrdiff_t>(*keep));
    const std::set<std::string> wanted(due.begin(), due.end());
    EXPECT_EQ(snapshots_in(temp / "whole"), wanted);
    EXPECT_EQ(snapshots_in(temp / "stopped"), wanted);
  }
}

TEST_P(Sessions, ThatCantGoOnLeaveTheFolderAsItWas) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.snapshot_every_s = 3;
  Session session(site());
  session.record(recording);
  for (const MachineState& state : part(states(), 0, 0.8)) {
    feed(session, {state});
    session.flush();
  }
  session.stop_recording();
  const std::set<std::string> before = snapshots_in(temp / "site");
  ASSERT_GT(before.size(), 4u);
  recording.keep = 2;
  Session again(site());
  const auto give_up = [](const io::JournalExtent&) { throw std::runtime_error("no more"); };
  EXPECT_THROW(again.record(recording, give_up), std::runtime_error);
  EXPECT_EQ(snapshots_in(temp / "site"), before);
  again.record(recording);
  EXPECT_EQ(again.save(), session.save());
  EXPECT_EQ(snapshots_in(temp / "site").size(), 2u);
}

TEST_P(Sessions, WriteASnapshotThatCameDueTooEarlyOnceTheLastIsSafe) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.snapshot_every_s = 6;
  Session session(site());
  session.record(recording);
  // Some come due while one is written. The last state isn't at a time when one does.
  std::vector<MachineState> fed = states();
  feed(session, {fed.begin(), fed.end() - 1});
  session.flush();
  const std::size_t before = snapshots_in(temp / "site").size();
  *fed.back().time_s += 6;
  feed(session, {fed.back()});
  session.stop_recording();
  EXPECT_TRUE(snapshots_in(temp / "site").contains(fmt::format("soil_{}.vdb", *fed.back().time_s)));
  EXPECT_EQ(snapshots_in(temp / "site").size(), before + 1);
  Session again(site());
  again.record(recording);
  EXPECT_EQ(again.save(), session.save());
}

TEST_P(Sessions, WriteADueSnapshotAfterABatchThatEndsWithoutATime) {
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.snapshot_every_s = 3;
  Session session(site());
  session.record(recording);
  ASSERT_TRUE(session.update({.time_s = 0}).ok());
  const MachineState no_time{.machine = 1, .pose = {{0, -4, 1}, {1, 0, 0, 0}}};
  const MachineState batch[] = {{.time_s = 4}, no_time};
  ASSERT_TRUE(session.update(batch).ok());
  session.stop_recording();
  EXPECT_EQ(snapshots_in(temp / "site"), std::set<std::string>{"soil_4.vdb"});
}

TEST_P(Sessions, KeepInASnapshotWhatChangedSinceTheLast) {
  // The same dig at one place after the other: none holds the chunks of those before it.
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.snapshot_every_s = 10;
  recording.incremental = true;
  SessionSite level = site();
  level.terrain = io::PlaneTerrain{0.04, {0, 0}};
  level.earthmoving.pours.clear();
  Session session(level);
  session.record(recording);
  double time_s = 0;
  for (int place = 0; place < 8; ++place) {
    for (int i = 0; i <= 10; ++i) {
      const Pose pose{{-40 + 12.8 * place + 0.2 * i, 0, -0.3}, {1, 0, 0, 0}};
      ASSERT_TRUE(session.update({.time_s = time_s, .pose = pose}).ok());
      session.flush();
      time_s += 10.0 / 11;
    }
    const Pose lifted{{-40 + 12.8 * place + 2, 0, 3}, {1, 0, 0, 0}};
    ASSERT_TRUE(session.update({.pose = lifted}).ok());
  }
  session.stop_recording();
  std::vector<std::size_t> chunks;
  std::map<std::string, std::size_t> before;
  for (const io::JournalFile& file : io::read_journal(temp / "site/journal").files) {
    io::SnapshotInfo info;
    io::read_snapshot(temp / "site" / file.name, &info);
    before[file.name] = info.parent ? info.parent->chunks : 0;
    if (info.parent) chunks.push_back(info.parent->chunks - before.at(info.parent->name));
  }
  ASSERT_GT(chunks.size(), 2u);
  const auto [least, most] = std::minmax_element(chunks.begin(), chunks.end());
  EXPECT_LT(*most, 2 * *least);
}

TEST_P(Sessions, AreRecordedFromTheirFirstStateOnly) {
  const auto is_refused = [](Session& session) {
    const TempFolder other;
    const std::string why = refusal([&] { session.record(to(other / "other")); });
    EXPECT_NE(why.find("before the first state"), std::string::npos) << why;
    EXPECT_FALSE(fs::exists(other / "other"));
  };
  Session fed(site());
  ASSERT_TRUE(fed.update(states().front()).ok());
  is_refused(fed);
  Session restored(site());
  restored.restore(fed.save());
  is_refused(restored);
  Session clone = fed.clone();
  is_refused(clone);
  const TempFolder temp;
  Recording recording = to(temp / "site");
  recording.snapshot_every_s = 1;
  {
    Session session(site());
    session.record(recording);
    ASSERT_TRUE(session.update({.time_s = 0}).ok());
    ASSERT_TRUE(session.update({.time_s = 2}).ok());
    session.stop_recording();
  }
  EXPECT_TRUE(fs::exists(temp / "site/soil_2.vdb")) << "so that nothing is fed again";
  Session from_snapshot(site());
  EXPECT_EQ(from_snapshot.record(recording).updates, 2u);
  from_snapshot.stop_recording();
  is_refused(from_snapshot);
}

TEST(SessionRecord, SaysWhichUpdateDiffers) {
  const TempFolder temp;
  const fs::path journal = temp / "site/journal";
  {
    Session session(site_of());
    session.record(to(temp / "site"));
  }
  const auto config = [&] {
    io::JournalReader reader(journal);
    return std::get<io::JournalConfig>(*reader.next());
  }();
  io::JournalWriter writer(journal, io::begin_journal(journal, config), {}, 1);
  for (int i = 0; i < 3; ++i)
    writer.add(io::JournalUpdate{.end_s = 1.0 + i,
                                 .cut_samples = i == 1 ? 17 : 0,
                                 .rows = {false, 7, {1.0 + i}, {-3, 0, 3, 0, 0, 0, 1}}});
  writer.flush();
  EXPECT_NE(
      refusal([&] { Session(site_of()).record(to(temp / "site")); }).find("update 2, at 2 s, cut "),
      std::string::npos);
}

constexpr const char* kFolder = "SOILVDB_TEST_FOLDER";

/// What is killed: feeds, and says how many are acknowledged.
TEST(SessionRecord, DISABLED_IsFedUntilKilled) {
  const char* folder = std::getenv(kFolder);
  if (folder == nullptr) GTEST_SKIP() << "for KilledAtAnyTime";
  Recording recording = to(fs::path(folder) / "site");
  recording.sync_s = 0;
  recording.snapshot_every_s = 2;
  recording.incremental = true;
  recording.keep = 2;
  Session session(site_of(moving()));
  std::uint64_t at = session.record(recording).updates;
  std::ofstream acknowledged(fs::path(folder) / "acknowledged", std::ios::app);
  const std::vector<MachineState> all = states();
  const std::uint64_t stop = at + all.size() / 6;  // and waits, so that no life is long enough
  for (; at < all.size(); ++at) {
    if (at == stop) pause();
    ASSERT_TRUE(session.update(all[at]).ok());
    acknowledged << at + 1 << std::endl;
  }
}

TEST(SessionRecord, KilledAtAnyTimeLosesNothingThatWasAcknowledged) {
  const TempFolder temp;
  std::mt19937_64 random(5);
  std::uint64_t last = 0;
  int kills = 0;
  for (; last < states().size() && kills < 1000; ++kills) {
    const pid_t child = fork();
    if (child == 0) {
      setenv(kFolder, temp.path().c_str(), 1);
      freopen("/dev/null", "w", stdout);
      execl("/proc/self/exe", "session_record_test", "--gtest_filter=*IsFedUntilKilled",
            "--gtest_also_run_disabled_tests", nullptr);
      _exit(127);
    }
    // However slow the machine is, some states further and then at any time.
    const auto said = [&] {
      std::error_code none;
      const auto size = fs::file_size(temp / "acknowledged", none);
      return none ? 0 : size;
    };
    const auto before = said();
    bool ended = false;
    while (said() == before && !ended) {
      usleep(2000);
      ended = waitpid(child, nullptr, WNOHANG) != 0;
    }
    usleep(static_cast<useconds_t>(random() % 100'000));
    if (!ended) {
      kill(child, SIGKILL);
      waitpid(child, nullptr, 0);
    }
    if (!fs::exists(temp / "site/journal")) continue;
    std::uint64_t acknowledged = 0;
    std::ifstream lines(temp / "acknowledged");
    for (std::uint64_t line = 0; lines >> line;) acknowledged = line;
    Recording recording = to(temp / "site");
    Session session(site_of(moving()));
    const std::uint64_t there = session.record(recording).updates;
    ASSERT_GE(there, acknowledged);
    ASSERT_GE(there, last);
    last = there;
    Session fed(site_of(moving()));
    feed(fed, part(states(), 0, static_cast<double>(there) / static_cast<double>(states().size())));
    ASSERT_EQ(session.save(), fed.save());
  }
  EXPECT_EQ(last, states().size());
  EXPECT_GT(kills, 3);
}

using Program = ProgramTest;

TEST_F(Program, KnowsWhatASessionRecorded) {
  {
    Session session(site_of(moving()));
    Recording recording = to(folder() / "site");
    recording.snapshot_every_s = 5;
    session.record(recording);
    feed(session, states());
    session.stop_recording();
  }
  const std::string report = good("verify site").out;
  EXPECT_NE(report.find(fmt::format("{} updates to", states().size())), std::string::npos)
      << report;
  EXPECT_EQ(report.find("resume"), std::string::npos) << "that isn't how it goes on";
  good("info site/soil_5.5.vdb");
  const auto resumed = run("resume site");
  EXPECT_EQ(resumed.status, 2);
  EXPECT_NE(resumed.err.find("site: was recorded by a session"), std::string::npos) << resumed.err;
  write_file(folder() / "site/soil_5.5.vdb", "damaged");
  EXPECT_EQ(run("verify site").status, 1);
}

TEST_F(Program, SaysThatARecordingOfAnotherFormatIsNotGoneOnWith) {
  fs::create_directory(folder() / "site");
  // CBOR of {"session": 1}
  io::begin_journal(folder() / "site/journal", {"\xa1\x67session\x01"});
  const auto verified = run("verify site");
  EXPECT_EQ(verified.status, 1);
  EXPECT_NE(verified.err.find("is a recording of format 1; this version goes on with format 4"),
            std::string::npos)
      << verified.err;
  EXPECT_EQ(verified.err.find("from which"), std::string::npos) << verified.err;
}

}  // namespace session_record_test
}  // namespace soilvdb::test
