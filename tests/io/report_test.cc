// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/journal/report.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace report_test {

namespace fs = std::filesystem;

TEST(Durations, QuantilesAreWithinOnePercentOfTheSortedOnes) {
  constexpr double kBinWidth = 0.011;  // 2^(1/64) - 1
  std::mt19937 random(1);
  std::lognormal_distribution<double> us(3, 2);
  Durations durations;
  std::vector<double> all;
  for (int i = 0; i < 10001; ++i) {
    all.push_back(us(random));
    durations.add(all.back());
  }
  std::sort(all.begin(), all.end());
  for (const double q : {0.0, 0.01, 0.5, 0.99, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::max(0.0, std::ceil(q * 10001) - 1));
    EXPECT_NEAR(durations.quantile_us(q), all[rank], kBinWidth * all[rank]) << q;
  }
  EXPECT_EQ(durations.max_us(), all.back());
  EXPECT_EQ(durations.count(), 10001);
}

TEST(Durations, NoneAtAllAreZero) {
  const Durations none;
  EXPECT_EQ(none.mean_us(), 0);
  EXPECT_EQ(none.quantile_us(0.5), 0);
  EXPECT_EQ(none.max_us(), 0);
}

TEST(Durations, ZeroAndHugeOnesAreCounted) {
  Durations durations;
  durations.add(0);
  durations.add(1e18);
  EXPECT_EQ(durations.count(), 2);
  EXPECT_LE(durations.quantile_us(0.5), 0.002);
  EXPECT_GT(durations.quantile_us(1), 1e9);
}

TEST(Summary, IsJsonWhateverTheNames) {
  Summary summary;
  summary.scenario = "quarry \"north\"\n\xff";
  summary.machines.push_back({"a\\b", 1, 2});
  summary.state_hash = 0xabc;
  const auto json = nlohmann::json::parse(to_json(summary), nullptr, false);
  ASSERT_FALSE(json.is_discarded());
  EXPECT_EQ(json["machines"][0]["name"], "a\\b");
  EXPECT_EQ(json["state_hash"], "0000000000000abc");
  EXPECT_EQ(json["files"], nlohmann::json::array());
}

class UpdatesCsvTest : public ::testing::Test {
 protected:
  std::string text() const {
    std::stringstream text;
    text << std::ifstream(folder_ / "updates.csv").rdbuf();
    return text.str();
  }
  const test::TempFolder folder_;
};

TEST_F(UpdatesCsvTest, IsThereOnceClosed) {
  UpdatesCsv csv(folder_ / "updates.csv");
  csv.add(0.5, "digger", 0.001, 0.25, 12.3456);
  csv.add(1, "a \"b\", c", 0, 0, 1);
  EXPECT_FALSE(fs::exists(folder_ / "updates.csv"));
  csv.close();
  EXPECT_EQ(text(),
            "time,machine,cut_m3,bucket_m3,update_us\n"
            "0.5,digger,0.001,0.25,12.346\n"
            "1,\"a \"\"b\"\", c\",0,0,1.000\n");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()), 1);
}

TEST_F(UpdatesCsvTest, LeavesTheOneBeforeWhenItIsNotClosed) {
  std::ofstream(folder_ / "updates.csv") << "before";
  { UpdatesCsv(folder_ / "updates.csv").add(0, "digger", 0, 0, 0); }
  EXPECT_EQ(text(), "before");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()), 1);
}

TEST_F(UpdatesCsvTest, SaysWhichFileCannotBeWritten) {
  try {
    UpdatesCsv csv(folder_ / "none/updates.csv");
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("none/updates.csv"), std::string::npos);
  }
}

}  // namespace report_test
}  // namespace soilvdb::io
