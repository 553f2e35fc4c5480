// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows of joints with the pose of the machine's base, from other messages of the same files.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <utility>

#include "io/file/text.h"
#include "io/motion/mcap_rows.h"
#include "io/motion/motion_checks.h"

namespace soilvdb::inline v0::io {
namespace {

/// Poses of the base in the order of their stamps, at the times of rows that increase.
class BasePoses {
 public:
  explicit BasePoses(MotionSource source) : source_(std::move(source)) {
    if (!source_.mcap.facts) source_.mcap.facts = io::look_at(source_);
    const McapFacts& facts = *source_.mcap.facts;
    const std::string topics = topics_text(source_.mcap);
    if (facts.type == McapType::kJointState)
      throw InputError(source_.file,
                       fmt::format("{} has joints; a base needs transforms or poses", topics));
    if (facts.type == McapType::kTransforms && source_.mcap.frame.empty())
      throw InputError(source_.file, fmt::format("{} has transforms; say which is the frame of the "
                                                 "urdf's root, as 'frame: NAME' in 'base:'",
                                                 topics));
    if (facts.type == McapType::kTransforms) fixed_ = fixed_pose(source_, facts);
    if (fixed_) return;
    rows_ = mcap_pose_rows(source_, source_.mcap.facts);
    most_end_ns_ = most_end_ns(rows_->usual_ns());
    numbers_.resize(rows_->columns().names.size());
    begin();
  }

  const MotionSource& source() const { return source_; }
  std::int64_t bytes_read() const { return rows_ ? rows_->bytes_read() : 0; }

  /// @param lines of the row at that time @throw LineError if the base isn't known then
  Pose at(const RowPlace& lines, std::int64_t time_ns) {
    if (fixed_) return *fixed_;
    while (next_ && next_->time_ns <= time_ns) step();
    const auto refuse = [&](const std::string& why) {
      lines.fail(fmt::format("the base isn't known at {} s: {}", stamp_text(time_ns), why));
    };
    if (!before_) refuse(fault_.empty() ? "it has no pose" : fault_);
    if (!before_->fault.empty()) refuse(before_->fault);
    if (before_->time_ns == time_ns) return before_->pose;
    if (time_ns < before_->time_ns) {
      if (before_->time_ns - time_ns > most_end_ns_)
        refuse(fmt::format("its first pose is at {} s", stamp_text(before_->time_ns)));
      return before_->pose;
    }
    if (!next_) {
      if (time_ns - before_->time_ns > most_end_ns_)
        refuse(fmt::format("its last pose is at {} s", stamp_text(before_->time_ns)));
      return before_->pose;
    }
    if (!fault_.empty()) refuse(fault_);
    const std::int64_t interval_ns = next_->time_ns - before_->time_ns;
    if (const auto most_s = rows_->most_gap_s();
        most_s && static_cast<double>(interval_ns) * 1e-9 > *most_s)
      refuse(
          fmt::format("its poses before and after are {:.3g} s apart, and at most {:.3g} s are "
                      "bridged",
                      static_cast<double>(interval_ns) * 1e-9, *most_s));
    return interpolate(
        unit(before_->pose), unit(next_->pose),
        static_cast<double>(time_ns - before_->time_ns) / static_cast<double>(interval_ns));
  }

  void go_to(std::int64_t time_ns) {
    if (fixed_) return;
    rows_->go_to({time_ns - rows_->longest_gap_ns(), -1, 0, 0, {}});
    before_.reset();
    next_.reset();
    begin();
  }

 private:
  struct Sample {
    std::int64_t time_ns = 0;
    Pose pose;               // as it was sent
    std::string fault = {};  // why it is not to be used
  };

  static Pose unit(Pose pose) {
    pose.rotation.normalize();
    return pose;
  }

  void begin() {
    step();
    if (next_) step();
  }
  /// Moves to the next pose.
  void step() {
    if (next_) before_ = std::exchange(next_, std::nullopt);
    fault_.clear();
    while (true) {
      try {
        if (rows_->next() == RowSource::Got::kEnd) return;
        rows_->values(numbers_);
        row_pose(rows_->place(), std::span(numbers_).subspan(1), true);  // is it one?
        const Sample read{rows_->mark().bytes, pose_of(&numbers_[1])};
        if (!before_ || read.time_ns != before_->time_ns) {
          next_ = read;
          return;
        }
        if (row_of(read.pose) != row_of(before_->pose))
          before_->fault = "its poses at that time contradict each other";
      } catch (const LineError& e) {
        if (fault_.empty()) fault_ = e.what();
      }
    }
  }

  MotionSource source_;
  std::optional<Pose> fixed_;
  std::unique_ptr<McapRows> rows_;       // unless it is fixed
  std::vector<double> numbers_;          // scratch
  std::optional<Sample> before_, next_;  // around the last time, or the first two
  std::int64_t most_end_ns_ = 0;
  std::string fault_;  // of a bad message between these
};

class BaseRows : public RowSource {
 public:
  BaseRows(std::unique_ptr<RowSource> joints, MotionSource base)
      : joints_(std::move(joints)), base_(std::move(base)), columns_(joints_->columns()) {
    columns_.base = columns_.names.size();
    columns_.quaternion = true;
    for (const char* name : {"x", "y", "z", "qx", "qy", "qz", "qw"})
      columns_.names.push_back(std::string("base_") + name);
  }

  const RowPlace& place() const override { return joints_->place(); }
  const Columns& columns() const override { return columns_; }
  Got next() override { return joints_->next(); }
  void values(std::vector<double>& v) override {
    std::vector<double> joints(*columns_.base);
    joints_->values(joints);
    const auto base = row_of(base_.at(place(), joints_->mark().bytes));
    std::copy(base.begin(), base.end(), std::copy(joints.begin(), joints.end(), v.begin()));
    hash_ = joints_->hash() ^ std::hash<std::string_view>()(
                                  {reinterpret_cast<const char*>(base.data()), sizeof base});
  }
  std::string time_text() const override { return joints_->time_text(); }
  std::size_t hash() const override { return hash_; }
  RowMark mark() const override { return joints_->mark(); }
  void go_to(const RowMark& mark) override {
    joints_->go_to(mark);
    base_.go_to(mark.bytes);
  }
  std::int64_t bytes_read() const override {
    return std::max(joints_->bytes_read(), base_.bytes_read());
  }
  std::optional<double> most_gap_s() const override { return joints_->most_gap_s(); }
  void warn(std::vector<std::string>& warnings) const override { joints_->warn(warnings); }
  MotionSource source() const override {
    MotionSource known = joints_->source();
    known.mcap.base = std::make_shared<McapTopic>(base_.source().mcap);
    return known;
  }

 private:
  std::unique_ptr<RowSource> joints_;
  BasePoses base_;
  Columns columns_;
  std::size_t hash_ = 0;  // of the row
};

}  // namespace

std::unique_ptr<RowSource> mcap_base_rows(std::unique_ptr<RowSource> joints,
                                          const MotionSource& source) {
  MotionSource base = source;
  base.mcap = *source.mcap.base;
  return std::make_unique<BaseRows>(std::move(joints), std::move(base));
}

}  // namespace soilvdb::inline v0::io
