// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/schedule.h"

#include <algorithm>
#include <limits>

namespace soilvdb::tools {

Schedule::Schedule(std::vector<const Motion*> motions, std::optional<std::int64_t> updates)
    : begin_s_(std::numeric_limits<double>::infinity()), end_s_(-begin_s_) {
  for (const Motion* motion : motions) {
    const auto rows = static_cast<std::int64_t>(motion->times_s().size());
    const bool by_rows = !updates || rows == 1;
    const std::int64_t count = by_rows ? rows : *updates;
    cursors_.push_back({motion, count, 0, by_rows, motion->begin_s()});
    total_ += count;
    begin_s_ = std::min(begin_s_, motion->begin_s());
    end_s_ = std::max(end_s_, motion->end_s());
  }
}

double Schedule::Cursor::until_s() const {
  if (by_rows) return motion->times_s()[static_cast<std::size_t>(done)];
  if (done + 1 == count) return motion->end_s();
  const double share = static_cast<double>(done + 1) / static_cast<double>(count);
  return motion->begin_s() + (motion->end_s() - motion->begin_s()) * share;
}

std::optional<Step> Schedule::next() {
  Cursor* first = nullptr;
  for (Cursor& cursor : cursors_) {
    if (cursor.done < cursor.count && (!first || cursor.until_s() < first->until_s()))
      first = &cursor;
  }
  if (!first) return std::nullopt;
  const Step step{static_cast<std::size_t>(first - cursors_.data()), first->at_s, first->until_s()};
  first->at_s = step.end_s;
  ++first->done;
  return step;
}

}  // namespace soilvdb::tools
