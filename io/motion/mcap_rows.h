// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows of a motion from MCAP messages: the common part of joints, poses and transforms.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/motion/mcap_merge.h"
#include "io/motion/row_source.h"

namespace soilvdb::inline v0::io {

/// Longest gap between two samples that is interpolated. @param usual_ns interval of the samples
std::int64_t most_gap_ns(std::int64_t usual_ns);
/// A track can't be interpolated beyond its ends: there a row uses a sample that is this close.
/// @param usual_ns interval of the samples; 0: unknown
std::int64_t most_end_ns(std::int64_t usual_ns);

/// Rows in the order of their stamps, each with the number of its message in the file.
class McapRows : public RowSource {
 public:
  /// @param wanted the motion's streams
  McapRows(const MotionSource& source, std::shared_ptr<const McapFacts> facts,
           const std::vector<std::uint32_t>& wanted);

  const RowPlace& place() const override { return place_; }
  const Columns& columns() const override { return columns_; }
  std::int64_t bytes_read() const override { return merge_.bytes_read(); }
  std::optional<double> most_gap_s() const override;
  /// The shortest of the usual intervals of its streams; 0: unknown.
  std::int64_t usual_ns() const { return usual_ns(wanted_); }
  /// The longest gap that is interpolated in one of its streams.
  std::int64_t longest_gap_ns() const;
  void warn(std::vector<std::string>& warnings) const override;
  MotionSource source() const override;

  RowMark mark() const override;
  std::string time_text() const override { return stamp_text(row_.time_ns); }
  std::size_t hash() const override { return hash_; }

 protected:
  class Place : public RowPlace {
   public:
    explicit Place(const std::filesystem::path& file) : RowPlace(file, "message") {}
    void set(const std::filesystem::path& file, long number) {
      file_ = file;
      number_ = number;
    }
  };

  std::int64_t usual_ns(const std::vector<std::uint32_t>& streams) const;
  /// Makes this message the current place.
  void look_at(const McapPlace& place);
  static McapPlace place_of(const RowMark& mark);
  /// Updates the hash with the numbers of a complete row.
  void seal(const std::vector<double>& v);

  MotionSource source_;
  std::shared_ptr<const McapFacts> facts_;
  std::vector<std::uint32_t> wanted_;
  McapMerge merge_;
  Place place_;
  Columns columns_;
  McapPlace row_;
  std::size_t hash_ = 0;  // of the current row
};

/// Rows from samples of several tracks (joints or frames). A track has values at its samples'
/// times, and between samples that are close enough.
class TrackRows : public McapRows {
 public:
  using McapRows::McapRows;

  Got next() override;
  void go_to(const RowMark& mark) override;

 protected:
  using Values = std::array<double, 7>;
  struct Sample {
    std::int64_t time_ns = 0;
    Values values = {};
  };
  struct Track {
    std::string what;         ///< name for messages, "frame 'base'"
    bool makes_rows = false;  ///< each sample makes a row
    bool tells_gaps = false;  ///< a long gap is a fault
    McapTimes times;
    std::int64_t usual_ns = 0;  ///< interval of its samples; 0: unknown
    std::vector<std::uint32_t> streams;
    std::deque<Sample> samples;  ///< from the last one at or before the row

    /// Longest gap between two samples.
    std::int64_t most_ns() const { return most_gap_ns(usual_ns); }
    /// Longest from a row to the nearest sample, at an end.
    std::int64_t most_end_ns() const { return io::most_end_ns(usual_ns); }
  };

  void add_track(std::string what, bool makes_rows);
  /// @param i index into tracks_
  void add_stream(std::size_t i, std::uint32_t stream);
  /// Puts an entry's values into tracks. @throw LineError if they are unusable
  virtual void take(const McapEntry& entry) = 0;
  /// Interpolates between two samples. @param s 0 to 1
  virtual Values between(const Track& track, const Values& a, const Values& b, double s) const = 0;

  /// @throw LineError if the track has other values at that time
  void check_same(const Track& track, std::int64_t time_ns, const double* values,
                  std::size_t n) const;
  /// Adds a sample, and a row if it makes one.
  void put(Track& track, const McapPlace& place, const double* values, std::size_t n);
  /// @throw LineError if the track is unknown at the row's time
  Values at_row(Track& track) const;

  std::vector<Track> tracks_;

 private:
  struct Fault {
    std::int64_t time_ns = 0;
    LineError why;
  };
  bool ready() const;
  bool read_more();
  void add_fault(std::int64_t time_ns, const std::string& why);
  void find_early_end();
  McapTimes row_times() const;

  std::deque<McapPlace> waiting_;  // rows to return
  std::deque<Fault> faults_;       // to report before these rows
  std::int64_t newest_ns_ = -kLatest_ns;
  std::optional<McapPlace> from_;  // rows before it are skipped
  bool ended_ = false, looked_at_end_ = false;
};

std::unique_ptr<RowSource> mcap_joint_rows(const MotionSource& source,
                                           const std::shared_ptr<const McapFacts>& facts,
                                           const Chain& chain);
/// Rows of joints with the base's pose at their times.
/// @throw InputError if the source's base has no poses
std::unique_ptr<RowSource> mcap_base_rows(std::unique_ptr<RowSource> joints,
                                          const MotionSource& source);
/// The pose of the source's frame in its parent, if no transform between them moves.
/// @throw InputError if the frame is unknown, or not below the parent
std::optional<Pose> fixed_pose(const MotionSource& source, const McapFacts& facts);
std::unique_ptr<McapRows> mcap_tf_rows(const MotionSource& source,
                                       const std::shared_ptr<const McapFacts>& facts);
/// Rows of poses or transforms. @throw InputError if the source fits neither
std::unique_ptr<McapRows> mcap_pose_rows(const MotionSource& source,
                                         const std::shared_ptr<const McapFacts>& facts);

}  // namespace soilvdb::inline v0::io
