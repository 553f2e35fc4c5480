// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb as anyone uses it: a Ground, a Tracker, each step traced and given to Tracker::update().
// Timed: the trace and the update with its ledger.
#include "bench/engine.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {
namespace {

class SoilVdb : public Engine {
 public:
  explicit SoilVdb(const Task& task)
      : task_(task),
        ground_(task.voxel_m, task.origin, task.terrain),
        tracker_(ground_, {task.bucket}),
        motion_(task.motion->simplified(task.bucket, tracker_.tolerance_m())) {}

  void advance(const Step& step) override { tracker_.update(0, motion_, step.t0, step.t1); }
  void finish() override {}
  double cut_m3() override { return tracker_.total().cut_m3(); }
  double memory_bytes() const override { return static_cast<double>(ground_.memory_bytes()); }

 private:
  Task task_;
  Ground ground_;
  Tracker tracker_;
  Motion motion_;  // without rows that say no more than their neighbours, as the program has it
};

}  // namespace

std::unique_ptr<Engine> make_soilvdb(const Task& task) { return std::make_unique<SoilVdb>(task); }

}  // namespace soilvdb::bench
