// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/query_lane.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <future>
#include <string>
#include <vector>

namespace soilvdb::tools {
namespace {

/// A lane whose thread is busy until release() is called; names of clients in the order of their
/// jobs.
class HeldLane {
 public:
  HeldLane() {
    std::promise<void> begun;
    lane.try_run("holder", [this, &begun] {
      begun.set_value();
      held_.get_future().wait();
    });
    begun.get_future().wait();
  }
  /// @return how many of the jobs were taken
  int ask(const std::string& client, int jobs) {
    int taken = 0;
    for (int i = 0; i < jobs; ++i)
      taken += lane.try_run(client, [this, client] { order.push_back(client); }) ? 1 : 0;
    return taken;
  }
  void release() {
    held_.set_value();
    lane.wait();
  }

  std::vector<std::string> order;
  QueryLane lane;

 private:
  std::promise<void> held_;
};

TEST(QueryLane, TakesAtMost32JobsOfAClientAndServesClientsInTurn) {
  HeldLane held;
  EXPECT_EQ(held.ask("greedy", 50), 32);
  EXPECT_EQ(held.ask("modest", 2), 2);
  held.release();
  ASSERT_EQ(held.order.size(), 34u);
  EXPECT_EQ(std::count(held.order.begin(), held.order.begin() + 4, "modest"), 2);
}

TEST(QueryLane, TakesAtMost128JobsOfAllClients) {
  HeldLane held;
  int taken = 0;
  for (const std::string client : {"a", "b", "c", "d", "e"}) taken += held.ask(client, 30);
  EXPECT_EQ(taken, 128);
  EXPECT_EQ(held.ask("f", 1), 0);
  held.release();
  EXPECT_EQ(held.order.size(), 128u);
  EXPECT_EQ(held.ask("f", 1), 1) << "there is room again";
  held.lane.wait();
}

TEST(QueryLane, DropsTheJobsThatHaveNotBegun) {
  HeldLane held;
  held.ask("a", 10);
  held.lane.drop();
  held.release();
  EXPECT_THAT(held.order, testing::IsEmpty());
  EXPECT_EQ(held.ask("a", 1), 1);
  held.lane.wait();
  EXPECT_THAT(held.order, testing::ElementsAre("a"));
}

TEST(QueryLane, GoesOnAfterAJobThatThrows) {
  HeldLane held;
  held.lane.try_run("a", [] { throw std::runtime_error("no"); });
  held.ask("b", 1);
  held.release();
  EXPECT_THAT(held.order, testing::ElementsAre("b"));
}

}  // namespace
}  // namespace soilvdb::tools
