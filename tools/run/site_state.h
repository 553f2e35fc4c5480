// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site with what a run or a session needs of it besides: where its ground comes from, and records
// of its updates.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/site.h"
#include "tools/run/schedule.h"

namespace soilvdb::tools {

/// An update of a journal that doesn't come out as it did, or can't be made any more.
class UpdateDiffers : public std::runtime_error {
 public:
  UpdateDiffers(std::size_t i, const std::string& why) : runtime_error(why), index(i) {}
  std::size_t index;  ///< of those that were made again
};

/// What is said of it. @param update its number, from 1
std::runtime_error differs(const std::filesystem::path& journal, std::uint64_t update,
                           double time_s, const UpdateDiffers& why);

/// What a scenario says of a site besides its ground.
SiteModel model_of(const io::Scenario& scenario);

struct SiteState : Site {
  /// @throw std::invalid_argument for machines or soil that can't be
  SiteState(SiteModel model, io::Site opened);
  /// To go on apart from the other.
  SiteState(const SiteState& other);
  SiteState(SiteState&&) = default;
  SiteState& operator=(SiteState&&) = default;

  /// Volumes and masses in the units of a journal, and back.
  std::int64_t samples(double m3) const;
  std::int64_t mass(double loose_m3) const;
  double volume_m3(std::int64_t samples) const;
  double loose_m3(std::int64_t mass) const;
  double kg(std::int64_t mass) const;  ///< of soil that moves

  /// Moves machines, and lets pours fall, as the steps of a run say.
  /// @return a record of each
  std::vector<io::JournalUpdate> advance(std::span<const Step> steps);
  /// Makes updates again, which follow on the last one.
  /// @throw UpdateDiffers
  void redo(std::span<const io::JournalUpdate> updates);
  /// Soil that moves comes to rest at a run's end, once.
  void rest_at_end(double time_s);
  bool rests_at_end() const { return at_rest_; }

  /// Of now, with the progress.
  io::SnapshotInfo snapshot_info(double time_s) const;

  io::Site site;  ///< the ground, and where it comes from
  MassUnits units;

 private:
  void follow(const io::JournalUpdate& update);
  Pose row_pose(std::size_t machine, const io::MotionRows& rows, std::size_t row) const;
  Move move_of(const io::JournalUpdate& update,
               std::vector<std::unique_ptr<Motion>>& motions) const;
  void require_mover(std::size_t i, const io::JournalUpdate& update) const;
  void require_same(std::size_t i, const io::JournalUpdate& update, const Update& made) const;
};

}  // namespace soilvdb::tools
