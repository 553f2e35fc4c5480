// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Other programs' .vdb files that lost their end, or have bits, sizes or numbers that they should
// not: refused or read, never a crash.
#include <sys/resource.h>

#include "tests/program/damage_fixture.h"
#include "tests/support/faults.h"
#include "tests/support/program.h"
#include "tests/support/sanitized.h"
#include "tests/support/spheres.h"

namespace soilvdb::test {
namespace foreign_damage_test {

/// A level set that OpenVDB wrote, of which nothing vouches for the bytes.
class DamagedForeign : public ProgramTest, public ::testing::WithParamInterface<const char*> {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    openvdb::initialize();
    const auto sphere = test::level_set_sphere(0.6f, {0.5f, 0, -0.6f}, 0.05f);
    openvdb::io::File vdb((folder() / "ball.vdb").string());
    const std::string compression = GetParam();
    vdb.setCompression(openvdb::io::COMPRESS_ACTIVE_MASK |
                       (compression == "blosc" ? openvdb::io::COMPRESS_BLOSC
                        : compression == "zip" ? openvdb::io::COMPRESS_ZIP
                                               : openvdb::io::COMPRESS_NONE));
    vdb.write({sphere});
    vdb.close();
    write_file(folder() / "dig.csv", HalfSine{}.csv(5));
    std::string text = half_sine_scenario("{level_set: ball.vdb}");
    text.replace(text.find("0.025"), 5, "0.1");
    write_file(folder() / "dig.yaml", text);
  }

  /// What a command says of the file, but for how long it took.
  std::string said(const Result& result) const {
    const fs::path summary = folder() / "out/summary.json";
    return fs::exists(summary) ? read_json(summary)["state_hash"].get<std::string>() : result.out;
  }
};

INSTANTIATE_TEST_SUITE_P(Compressions, DamagedForeign, ::testing::Values("blosc", "zip", "none"),
                         [](const auto& test) { return std::string(test.param); });

TEST_P(DamagedForeign, IsReadInAChildThatMayBreak) {
  const std::string good = read_file(folder() / "ball.vdb");
  const char* const commands[] = {"info ball.vdb", "run dig.yaml --no-snapshots --out out",
                                  "export ball.vdb --to ball.ply"};
  std::map<std::string, std::string> expected;
  for (const char* command : commands) {
    fs::remove_all(folder() / "out");
    const Result result = run(command);
    // Only what soilvdb wrote is exported.
    EXPECT_EQ(result.status, command == commands[2] ? 2 : 0) << result.err;
    expected[command] = said(result);
  }
  const std::size_t count = faults(4, 12, 1000);
  std::size_t refused = 0, broke = 0, same = 0, other = 0;
  Damage damage(10);
  double slowest_s = 0;
  for (std::size_t i = 0; i < count && !HasFailure(); ++i) {
    const std::string head = good.substr(0, 2000);  // names, types and sizes
    const std::size_t kind = damage.below(5);
    const std::string bad = kind == 0   ? damage.cut_off(good)
                            : kind == 1 ? damage.flipped(good)
                            : kind == 2 ? damage.overwritten(good)
                            : kind == 3 ? damage.flipped(head) + good.substr(head.size())
                                        : damage.resized(good);
    write_file(folder() / "ball.vdb", bad);
    // Most often what reads it all.
    const char* command = commands[i % 8 == 7 ? 2 : i % 2];
    SCOPED_TRACE(fmt::format("case {}: {}", i, command));
    fs::remove_all(folder() / "out");
    rusage before{}, after{};
    getrusage(RUSAGE_CHILDREN, &before);
    const Result result =
        shell(fmt::format("timeout -s KILL 60 '{}' {}", SOILVDB_PROGRAM, command));
    getrusage(RUSAGE_CHILDREN, &after);
    const auto seconds = [](const rusage& r) {
      return static_cast<double>(r.ru_utime.tv_sec + r.ru_stime.tv_sec) +
             1e-6 * static_cast<double>(r.ru_utime.tv_usec + r.ru_stime.tv_usec);
    };
    slowest_s = std::max(slowest_s, seconds(after) - seconds(before));
    if (result.status == 0) {
      ++(said(result) == expected[command] ? same : other);
      continue;
    }
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_TRUE(result.err.starts_with("soilvdb: ball.vdb: ")) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_FALSE(fs::exists(folder() / "out"));
    const bool child = result.err.find("memory or time than") != std::string::npos;
    ++(child ? broke : refused);
  }
  // The child and then the program itself read it, within what tools/app/child.cc gives them.
  EXPECT_LT(slowest_s, 3 * kHang_s);
  rusage all{};
  getrusage(RUSAGE_CHILDREN, &all);
  if (!test::kSanitized) {
    EXPECT_LT(all.ru_maxrss, 1 << 20) << "kB";
  }
  EXPECT_EQ(refused + broke + same + other, count);
  const std::string kind = fmt::format("{}: damaged .vdb of another program", GetParam());
  record_faults(kind, refused, "refused");
  record_faults(kind, broke, "broke the child; refused");
  record_faults(kind, same, "accepted and the same result");
  record_faults(kind, other, "accepted and another result: nothing vouches for it");
}

}  // namespace foreign_damage_test
}  // namespace soilvdb::test
