// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs whose disk fails at any operation on any file, is full or may not be written to.
#include <atomic>
#include <cerrno>
#include <utility>

#include "tests/program/crash_fixture.h"
#include "tests/support/faults.h"

namespace soilvdb::test {
namespace disk_fault_test {

#ifdef SOILVDB_IO_SHIM

/// Whatever operation fails, on a folder that held another run.
TEST_F(Crash, AnyOperationThatFailsIsSaidAndLeavesWhatWasThereWhole) {
  const std::map<std::string, std::string> old = run_before();
  const std::vector<std::string> all = operations("again");
  const std::vector<std::pair<int, std::string>> errors = {{ENOSPC, "No space left on device"},
                                                           {EIO, "Input/output error"},
                                                           {EROFS, "Read-only file system"}};
  std::atomic<std::size_t> failed = 0, tolerated = 0;
  in_two_lanes(all.size(), step(), [&](std::size_t i, const std::string& out) {
    const auto& [error, text] = errors[i % errors.size()];
    SCOPED_TRACE(fmt::format("operation {}: {}: {}", i + 1, all[i], text));
    fs::remove_all(folder() / out);
    fs::copy(folder() / "old", folder() / out);
    const char* kind = all[i].starts_with("write") && i % 2 ? "short" : "fail";
    const Result result = launch(run_, out, fmt::format("{} {} {}", kind, i + 1, error));
    if (result.status == 0) {
      // Nothing is at stake when a file that was read, or is synced already, is closed.
      EXPECT_TRUE(all[i].starts_with("close") || all[i].starts_with("fclose"));
      expect_as_reference(out);
      ++tolerated;
      return;
    }
    ++failed;
    EXPECT_EQ(result.status, 1);
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
    EXPECT_NE(result.err.find((folder() / out).string()), std::string::npos) << result.err;
    expect_old_or_new(out, old);
    if (i % 4 == 0) expect_comes_back(out);
  });
  record_faults("each operation on a file fails", failed, "said and what was there is whole");
  record_faults("each operation on a file fails", tolerated, "nothing was at stake");
}

TEST_F(Crash, AFullDiskAndAReadOnlyOneAreSaid) {
  const std::string mount = (folder() / "disk").string();
  fs::create_directories(mount);
  if (std::system(
          fmt::format("mount -t tmpfs -o size=64k tmpfs '{}' 2>/dev/null", mount).c_str()) != 0)
    GTEST_SKIP() << "can't mount";
  const Result full = run(fmt::format("run dig.yaml --out '{}/dig'", mount));
  EXPECT_EQ(full.status, 1);
  EXPECT_NE(full.err.find("No space left on device"), std::string::npos) << full.err;
  const bool remounted = std::system(fmt::format("mount -o remount,ro '{}'", mount).c_str()) == 0;
  const Result read_only = run(fmt::format("resume '{}/dig'", mount));
  const Result verified = run(fmt::format("verify '{}/dig'", mount));
  std::system(fmt::format("mount -o remount,rw,size=10m '{}'", mount).c_str());
  const Result resumed = run(fmt::format("resume '{}/dig'", mount));
  if (resumed.status == 0) fs::copy(mount + "/dig", folder() / "more");
  std::system(fmt::format("umount '{}'", mount).c_str());
  ASSERT_TRUE(remounted);
  EXPECT_NE(read_only.status, 0);
  EXPECT_EQ(std::count(read_only.err.begin(), read_only.err.end(), '\n'), 1) << read_only.err;
  EXPECT_EQ(verified.status, 0) << verified.err;
  EXPECT_EQ(resumed.status, 0) << resumed.err;
  expect_as_reference("more");
  record_faults("full disk and read-only disk", 2, "said; went on to the same files");
}

#endif

}  // namespace disk_fault_test
}  // namespace soilvdb::test
