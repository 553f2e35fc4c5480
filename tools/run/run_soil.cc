// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run does besides, where soil moves: pours, and rest at the end.
#include <fmt/format.h>

#include "io/file/text.h"
#include "tools/run/run.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
/// One update per step: machines as many at once as there are between pours.
std::vector<Update> Run::move_on(std::span<const Step> batch, std::span<const Move> moves) {
  if (scenario_.pours.empty()) return tracker_.update(moves);
  const std::size_t machines = scenario_.machines.size();
  std::vector<Update> results;
  for (std::size_t i = 0; i < batch.size();) {
    if (batch[i].machine >= machines) {
      results.push_back(tracker_.pour(batch[i].machine - machines, batch[i].end_s));
      ++i;
      continue;
    }
    std::size_t end = i + 1;
    while (end < batch.size() && batch[end].machine < machines) ++end;
    const std::vector<Update> some = tracker_.update(moves.subspan(i, end - i));
    results.insert(results.end(), some.begin(), some.end());
    i = end;
  }
  return results;
}

/// At the end of the run, once: ground that was read from there is at rest.
void Run::come_to_rest() {
  if (!scenario_.soil || stopped_ || state_.at_rest) return;
  tracker_.come_to_rest(time_s_);
  state_.at_rest = true;
}

const std::string& Run::name_of(std::size_t mover) const {
  const std::size_t machines = scenario_.machines.size();
  return mover < machines ? scenario_.machines[mover].name : scenario_.pours[mover - machines].name;
}

void Run::warn_of_soil() {
  if (const std::int64_t astray = tracker_.site().astray; astray > 0)
    say(fmt::format("warning: {} m³ fell where the terrain has no ground and are lost to the site",
                    number(state_.loose_m3(astray))));
  for (std::size_t i = 0; i < scenario_.machines.size(); ++i) {
    const Ledger& ledger = tracker_.ledger(i);
    // What stays in a bucket that was tipped is less. One that never dumps was warned of already.
    const Bucket& bucket = scenario_.machines[i].bucket;
    const bool dumps = !bucket.profile.empty() || bucket.dump_angle_rad;
    if (!stopped_ && dumps && ledger.load > most_load_[i] / 2)
      say(fmt::format(
          "warning: {} carries its load to the end, {} m³; it was not tipped far enough "
          "to dump that",
          io::printable(scenario_.machines[i].name), number(ledger.bucket_m3())));
  }
}

}  // namespace soilvdb::tools
