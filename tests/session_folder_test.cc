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
#include "tests/program.h"
#include "tests/session_fixture.h"
#include "tests/temp_folder.h"

namespace soilvdb::testing {
namespace {

INSTANTIATE_TEST_SUITE_P(Soil, Sessions, kSoils, name_of_soil);

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
    session.limit_memory(60'000, "cold");
    session.record(recording);
  }
  const WorkingFolder there(temp / "there");
  feed(session, part(states(), 0, 0.3));
  session.stop_recording();
  session.restore(session.save());
  EXPECT_EQ(read_file(temp / "there/site/soil_3.vdb"), "somebody's");
  EXPECT_EQ(names_in(temp / "there/site").size(), 1u);
  EXPECT_EQ(names_in(temp / "here/site").size(), 3u);
}

TEST_P(Sessions, WhoseMemoryCouldntBeLimitedAreAsBefore) {
  const TempFolder temp;
  Session session(site());
  EXPECT_NE(refusal([&] { session.limit_memory(60'000, temp / "no folder"); }), "taken");
  feed(session, part(states(), 0, 0.3));
  EXPECT_EQ(session.clone().save(), session.save());
}

}  // namespace
}  // namespace soilvdb::testing
