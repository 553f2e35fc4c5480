// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/motion_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace soilvdb::inline v0::io {
namespace {

std::string warning(const BadRows& bad) {
  const std::string more = bad.count == 1 ? "" : fmt::format(" and {} more", bad.count - 1);
  return fmt::format("{}; this row{} {} left out", bad.first, more, bad.count == 1 ? "is" : "are");
}

}  // namespace

MotionFile::MotionFile(Motion motion)
    : parts_(1),
      only_(std::make_shared<Motion>(std::move(motion))),
      rows_(static_cast<std::int64_t>(only_->times_s().size())),
      begin_s_(only_->begin_s()),
      end_s_(only_->end_s()) {}

MotionFile::MotionFile(const MotionSource& source, const std::optional<Chain>& chain,
                       AngleUnit angles, OnBadRow on_bad_row,
                       const std::function<void(const Motion&, std::int64_t)>& look,
                       std::vector<std::string>& warnings)
    : source_(source), chain_(chain), angles_(angles), stop_(on_bad_row == OnBadRow::kStop) {
  MotionReader reader(source, chain, angles);
  const bool begins_bad = reader.bad_rows().count > 0;
  for (bool more = true; more;) {
    const RowMark mark = reader.mark();
    Motion part = reader.next(kPartSteps);
    const auto steps = static_cast<std::int64_t>(part.times_s().size()) - 1;
    more = steps == kPartSteps;
    if (steps == 0 && !parts_.empty()) break;
    look(part, reader.bytes_read());
    if (parts_.empty()) begin_s_ = part.begin_s();
    end_s_ = part.end_s();
    rows_ += parts_.empty() ? steps + 1 : steps;
    parts_.push_back({mark, reader.digest()});
    only_ = parts_.size() == 1 ? std::make_shared<Motion>(std::move(part)) : nullptr;
  }
  reader.check_angles();
  source_ = reader.source();
  const std::vector<std::string> said = reader.warnings();
  warnings.insert(warnings.end(), said.begin(), said.end());
  bad_rows_ = reader.bad_rows();
  if (stop_ && begins_bad) throw InputError(bad_rows_.first);
  check_odds();
  if (bad_rows_.count > 0 && !stop_) warnings.push_back(warning(bad_rows_));
}

/// Refuses a motion in which the good rows may be the wrong ones.
void MotionFile::check_odds() const {
  const std::int64_t all = rows_ + bad_rows_.count;
  if (bad_rows_.at_odds > 0 && 2 * bad_rows_.at_odds >= all) {
    throw InputError(
        bad_rows_.at_odds_in, bad_rows_.at_odds_with,
        fmt::format("{} of the {} rows contradict the good ones before them, this one above all "
                    "(first: {}); mend or delete what is wrong{}",
                    bad_rows_.at_odds, all, bad_rows_.first,
                    stop_ ? "" : ": 'bad_rows: skip' is for the odd row"));
  }
  if (stop_ && bad_rows_.outnumbering > 0) {
    throw InputError(
        bad_rows_.outnumbered_in, bad_rows_.outnumbered,
        fmt::format("the {} rows after this one contradict it, and fewer good ones come up to it "
                    "(first: {}); mend or delete what is wrong",
                    bad_rows_.outnumbering, bad_rows_.first));
  }
}

std::shared_ptr<const Motion> MotionFile::part(std::size_t i) const {
  if (only_) return only_;
  const auto rows_before = static_cast<std::int64_t>(i) * kPartSteps;
  try {
    MotionReader reader = this->reader();
    reader.go_to(parts_[i].mark);
    auto motion =
        std::make_shared<Motion>(reader.next(std::min(kPartSteps, rows_ - 1 - rows_before)));
    if (reader.digest() == parts_[i].digest) return motion;
  } catch (const InputError&) {
    // A row that was good is bad: the file has changed.
  }
  throw std::runtime_error(file().string() + ": changed while it was being read");
}

}  // namespace soilvdb::inline v0::io
