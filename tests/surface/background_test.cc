// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/background.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <latch>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

namespace soilvdb {
namespace background_test {

class WithOrWithoutThread : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Background, WithOrWithoutThread, ::testing::Bool(),
                         [](const auto& thread) { return thread.param ? "Thread" : "None"; });

TEST_P(WithOrWithoutThread, RunsAllJobsInOrder) {
  std::string seen;
  {
    Background background(GetParam());
    background.wait();
    EXPECT_TRUE(background.done());
    background.run([&] { seen += 'a'; });
    background.wait();
    EXPECT_TRUE(background.done());
    EXPECT_EQ(seen, "a");
    background.run([&] { seen += 'b'; });
    EXPECT_TRUE(background.try_run([&] { seen += 'c'; }));
  }
  EXPECT_EQ(seen, "abc");
}

TEST_P(WithOrWithoutThread, ThrowsEachErrorOnceAndGoesOn) {
  std::atomic<int> ran = 0;
  Background background(GetParam());
  int errors = 0;
  const auto counting = [&](const auto& call) {
    try {
      call();
    } catch (const std::runtime_error&) {
      ++errors;
    }
  };
  const auto fail = [] { throw std::runtime_error("job"); };
  counting([&] { background.run(fail); });
  EXPECT_TRUE(background.try_run(fail)) << "throws nothing itself";
  counting([&] { background.run([&] { ++ran; }); });
  for (int i = 0; i < 4; ++i) counting([&] { background.wait(); });
  EXPECT_EQ(errors, 2);
  EXPECT_EQ(ran, 1);
}

/// One that waits for what holds it up, once it is at work.
struct HeldUp {
  std::latch started{1}, go{1};
  Background background;
  explicit HeldUp(std::size_t most) : background(true, most) {
    background.run([&] {
      started.count_down();
      go.wait();
    });
    started.wait();
  }
};

TEST(Background, TakesNoMoreThanMayWait) {
  EXPECT_THROW(Background(true, 0), std::invalid_argument);
  std::atomic<int> ran = 0;
  std::atomic<bool> gone = false;
  HeldUp held(2);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(held.background.try_run([&] { ++ran; }), i < 2);
  std::thread opener([&] {
    gone = true;
    held.go.count_down();
  });
  held.background.run([&] { ++ran; });
  EXPECT_TRUE(gone) << "there was no room before";
  opener.join();
  held.background.wait();
  EXPECT_EQ(ran, 3);
}

TEST(Background, ForgetsWhatHasNotBegun) {
  std::atomic<int> ran = 0;
  auto counted = std::make_shared<int>(1);
  const std::weak_ptr<int> watched = counted;
  HeldUp held(3);
  held.background.run([&ran, counted = std::move(counted)] { ++ran; });
  held.background.drop();
  EXPECT_TRUE(watched.expired());
  EXPECT_FALSE(held.background.done()) << "one is at work";
  held.go.count_down();
  held.background.wait();
  EXPECT_EQ(ran, 0);
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
