// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/background.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <latch>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace soilvdb {
namespace background_test {

class WithOrWithoutThread : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Background, WithOrWithoutThread, ::testing::Bool(),
                         [](const auto& thread) { return thread.param ? "Thread" : "None"; });

TEST_P(WithOrWithoutThread, RunsJobsInOrderAndIdlesAfterThem) {
  std::vector<std::string> seen;
  int left = 0;
  {
    Background background(GetParam(), [&] {
      if (left == 0) return false;
      seen.push_back("idle");
      return --left > 0;
    });
    background.wait();
    EXPECT_TRUE(seen.empty()) << "no job, nothing to do";
    background.run([&] {
      seen.push_back("a");
      left = 2;
    });
    background.wait();
    EXPECT_TRUE(background.done());
    EXPECT_EQ(seen, (std::vector<std::string>{"a", "idle", "idle"}));
    background.run([&] { seen.push_back("b"); });
    background.run([&] { seen.push_back("c"); });
  }
  EXPECT_EQ(seen, (std::vector<std::string>{"a", "idle", "idle", "b", "c"}));
}

TEST_P(WithOrWithoutThread, ThrowsEachErrorOnceAndGoesOn) {
  std::atomic<int> ran = 0, rests = 0;
  Background background(GetParam(), [&]() -> bool {
    if (++rests == 2) throw std::runtime_error("idle");
    return rests < 3;
  });
  int errors = 0;
  const auto counting = [&](const auto& call) {
    try {
      call();
    } catch (const std::runtime_error&) {
      ++errors;
    }
  };
  counting([&] { background.run([] { throw std::runtime_error("job"); }); });
  counting([&] { background.run([&] { ++ran; }); });
  for (int i = 0; i < 4; ++i) counting([&] { background.wait(); });
  EXPECT_EQ(errors, 2) << "the job's and idle()'s";
  EXPECT_EQ(ran, 1);
  EXPECT_GE(rests, 3) << "an error of idle() doesn't end it";
}

TEST(Background, LetsNobodyWaitForWhatRunsBeside) {
  std::atomic<bool> open = false;
  Background background(true);
  background.run([&] {
    while (!open) std::this_thread::yield();
  });
  EXPECT_FALSE(background.done());
  open = true;
  background.wait();
  EXPECT_TRUE(background.done());
}

TEST(Background, WhatAJobHoldsIsGoneWhenItCountsAsDone) {
  Background background(true);
  auto held = std::make_shared<int>(1);
  const std::weak_ptr<int> watched = held;
  background.run([held = std::move(held)] {});
  background.wait();
  EXPECT_TRUE(watched.expired());
}

TEST(Background, IsDoneWhenTheLastJobHasEndedAndNoSooner) {
  std::latch started(1), go(1);
  std::atomic<bool> ended = false;
  Background background(true);
  background.run([&] {
    started.count_down();
    go.wait();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    ended = true;
  });
  started.wait();
  EXPECT_FALSE(background.done());
  go.count_down();
  background.wait();
  EXPECT_TRUE(ended);
  EXPECT_TRUE(background.done());
}

}  // namespace background_test
}  // namespace soilvdb
