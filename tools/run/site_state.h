// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site with machines as a run or a session brings it from update to update.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/session.h"
#include "soilvdb/tracker.h"

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

struct SiteState {
  /// What a machine was brought to last; its pose is NaN before that.
  struct Fed {
    double time_s = std::numeric_limits<double>::quiet_NaN();
    Pose pose = {Vec3::Constant(std::numeric_limits<double>::quiet_NaN()), {1, 0, 0, 0}};
    std::vector<double> joints = {};  ///< none: it was a pose
  };

  /// @throw std::invalid_argument for what can't be a site's machines or soil
  SiteState(std::vector<SessionMachine> machines_, Earthmoving earthmoving_, io::Site site_);
  SiteState(const io::Scenario& scenario, io::Site site_);
  /// To go on apart from the other.
  SiteState(const SiteState& other);
  SiteState(SiteState&&) = default;
  SiteState& operator=(SiteState&&) = default;

  std::string name(std::size_t machine) const;
  /// Of the machines' times the latest; NaN: there is none.
  double last_s() const;
  /// Volumes and masses in the units of a journal, and back.
  std::int64_t samples(double m3) const;
  std::int64_t mass(double loose_m3) const;
  double volume_m3(std::int64_t samples) const;
  double loose_m3(std::int64_t mass) const;
  double kg(std::int64_t mass) const;  ///< of soil that moves

  /// Pours come down up to a time, that included, in the order of their parts' times.
  void pour(double until_s);
  /// Those that come before a machine's move to that time, if it has one.
  void pour_before(double time_s);
  /// Notes where an update brought its machine, whoever made it.
  void follow(const io::JournalUpdate& update);
  /// Makes updates again, which follow on the last one.
  /// @throw UpdateDiffers
  void redo(std::span<const io::JournalUpdate> updates);

  /// All that the next update depends on besides the ground, as bytes and back.
  std::string progress() const;
  /// @throw std::invalid_argument if it isn't of these machines
  void set_progress(std::string_view bytes);
  /// Of now, with the progress.
  io::SnapshotInfo snapshot_info(double time_s) const;

  std::vector<SessionMachine> machines;
  Earthmoving earthmoving;
  io::Site site;
  std::unique_ptr<Tracker> tracker;
  MassUnits units;
  std::vector<Fed> fed;  ///< of each machine
  bool at_rest = false;  ///< soil that moves has come to rest at a run's end
  double poured_s = -std::numeric_limits<double>::infinity();  ///< up to which pours came down

 private:
  Pose row_pose(std::size_t machine, const io::MotionRows& rows, std::size_t row) const;
  Move move_of(const io::JournalUpdate& update,
               std::vector<std::unique_ptr<Motion>>& motions) const;
  void require_mover(std::size_t i, const io::JournalUpdate& update) const;
  void require_same(std::size_t i, const io::JournalUpdate& update, const Update& made) const;

  double next_pour_s_ = -std::numeric_limits<double>::infinity();  // none falls before
};

}  // namespace soilvdb::tools
