// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/long_motion.h"

#include <algorithm>
#include <stdexcept>

#include "io/motion_csv.h"

namespace soilvdb::io {

LongMotion::LongMotion(Motion motion)
    : parts_(1),
      only_(std::make_shared<Motion>(std::move(motion))),
      rows_(static_cast<std::int64_t>(only_->times_s().size())),
      begin_s_(only_->begin_s()),
      end_s_(only_->end_s()) {}

LongMotion::LongMotion(const std::filesystem::path& file, const std::optional<Chain>& chain,
                       const std::function<void(const Motion&, std::int64_t)>& look,
                       std::vector<std::string>& warnings)
    : file_(file), chain_(chain) {
  MotionReader reader(file, chain);
  for (bool more = true; more;) {
    const CsvLines::Mark mark = reader.mark();
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
  const std::vector<std::string> said = reader.warnings();
  warnings.insert(warnings.end(), said.begin(), said.end());
}

std::shared_ptr<const Motion> LongMotion::part(std::size_t i) const {
  if (only_) return only_;
  const auto rows_before = static_cast<std::int64_t>(i) * kPartSteps;
  try {
    MotionReader reader(file_, chain_);
    reader.go_to(parts_[i].mark);
    auto motion =
        std::make_shared<Motion>(reader.next(std::min(kPartSteps, rows_ - 1 - rows_before)));
    if (reader.digest() == parts_[i].digest) return motion;
  } catch (const InputError&) {
    // It was good before.
  }
  throw std::runtime_error(file_.string() + ": changed while it was being read");
}

}  // namespace soilvdb::io
