// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs that record as MCAP, killed or failing at any operation on any file.
#include <atomic>
#include <cerrno>
#include <random>
#include <utility>

#include "tests/program/crash_fixture.h"
#include "tests/support/faults.h"

namespace soilvdb::test {
namespace mcap_crash_test {

#ifdef SOILVDB_IO_SHIM

class McapCrash : public Crash {
 protected:
  void SetUp() override {
    more_output_ = ", mcap: true";
    Crash::SetUp();
    ASSERT_TRUE(reference_.contains("soil.mcap"));
  }
};

TEST_F(McapCrash, KilledAtRandomOperationsItEndsWithTheSameRecording) {
  std::atomic<std::size_t> kills = 0;
  in_two_lanes(faults(10, 60, 2000), 1, [&](std::size_t i, const std::string& out) {
    std::mt19937 random(static_cast<unsigned>(i));
    fs::remove_all(folder() / out);
    // Killed, and killed on its way on from there.
    for (int k = 0; k < 2; ++k) {
      const auto at = 1 + random() % operations_.size();
      const Result result =
          launch(has_journal(out) ? "resume" : run_, out, fmt::format("kill {}", at));
      kills += result.status == kKilled;
    }
    expect_comes_back(out);
  });
  EXPECT_GT(kills, 0u);
  record_faults("kill -9 of a run that records", kills, "went on to the same recording");
}

TEST_F(McapCrash, AnyOperationOnTheRecordingThatFailsIsSaid) {
  std::vector<std::size_t> on_recording;
  for (std::size_t i = 0; i < operations_.size(); ++i)
    if (operations_[i].find("soil.mcap") != std::string::npos) on_recording.push_back(i);
  ASSERT_GE(on_recording.size(), 4u);  // made, written, synced, renamed
  const std::vector<std::pair<int, std::string>> errors = {{ENOSPC, "No space left on device"},
                                                           {EIO, "Input/output error"}};
  in_two_lanes(
      on_recording.size(), test::kLong ? 1 : 3, [&](std::size_t k, const std::string& out) {
        const std::size_t i = on_recording[k];
        const auto& [error, text] = errors[k % errors.size()];
        SCOPED_TRACE(fmt::format("operation {}: {}: {}", i + 1, operations_[i], text));
        fs::remove_all(folder() / out);
        const char* kind = operations_[i].starts_with("write") ? "short" : "fail";
        const Result result = launch(run_, out, fmt::format("{} {} {}", kind, i + 1, error));
        if (result.status == 0) {  // it is whole and synced, and was read for its checksum
          EXPECT_TRUE(operations_[i].starts_with("close") || operations_[i].starts_with("fclose"));
          return;
        }
        EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
        EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
        EXPECT_NE(result.err.find("soil.mcap"), std::string::npos) << result.err;
        expect_comes_back(out);
      });
}

#endif

}  // namespace mcap_crash_test
}  // namespace soilvdb::test
