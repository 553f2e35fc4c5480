// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The journal of a run: each update's input and result, in an append-only file. An interrupted run
// continues from it.
//
// The file consists of frames. Each has a checksum of its content and its place in the file, and
// the size of the file that was on disk when the frame was written. A bad frame at the end is
// therefore the trace of a crash, and ends the journal. A bad frame before that is damage.
#pragma once

#include <array>
#include <cmath>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <variant>
#include <vector>

#include "soilvdb/io/motion_rows.h"

namespace soilvdb::inline v0::io {

/// The run's configuration, as the program encodes it; the first record. A later one takes its
/// place.
struct JournalConfig {
  std::string text;
};
/// An operation on a site, and its result.
struct JournalUpdate {
  enum class Kind : std::uint8_t {
    /// A machine moved over [begin_s, end_s] along `rows`. If the rows begin later, it moved evenly
    /// from its last pose to the first row. If `begin_s` is NaN, it moved straight to the last row;
    /// `end_s` may then be NaN, too.
    kMove,
    kPour,   ///< soil of one pour fell up to end_s; pours are numbered after the machines
    kPours,  ///< soil of all pours fell up to end_s
    kRest,   ///< moving soil came to rest
    kClock,  ///< a machine's clock was set: its next time may be before its last
    kPlace,  ///< a machine was taken to the pose of the only row
    kSurvey  ///< scans corrected the ground, as `survey` says; scans are numbered after the pours
  };
  /// Is it of a machine that `rows` took to a pose?
  bool has_rows() const { return kind == Kind::kMove || kind == Kind::kPlace; }

  std::uint32_t machine = 0;
  bool ends_update = true;  ///< else the machine's next move continues it
  double begin_s = std::numeric_limits<double>::quiet_NaN(), end_s = begin_s;
  std::int64_t cut_samples = 0;     ///< in samples of Ground::sample_m3()
  std::int64_t bucket_samples = 0;  ///< load after it; MassUnits with moving soil
  std::int64_t ns = 0;              ///< duration
  MotionRows rows = {};
  std::int64_t spilled = 0, slid = 0;
  Kind kind = Kind::kMove;
  /// Of the soil on the bucket after it, bucket frame, at the middle of the lip: force, N, and
  /// moment, N m; if the run records it.
  std::optional<std::array<double, 6>> force = {};
  std::string survey = {};  ///< compressed, as Site::apply_scans() records it
  /// Mass that hoppers received in it; empty: not recorded.
  std::optional<std::int64_t> hauled = {};
};
/// A file that was finished after this many updates.
struct JournalFile {
  std::string name;
  std::uint64_t updates = 0, size = 0, crc = 0;
  std::string parent = {};  ///< of an incremental snapshot: the snapshot before it
};
/// A file that is about to be deleted.
struct JournalRemoval {
  std::string name;
};
/// The run is finished.
struct JournalEnd {};
using JournalRecord =
    std::variant<JournalConfig, JournalUpdate, JournalFile, JournalRemoval, JournalEnd>;

/// The end of a run, or of a session's input so far.
struct JournalExtent {
  std::uint64_t updates = 0;
  double time_s = 0;  ///< of the last update with a time

  void add(const JournalUpdate& update) {
    if (!update.ends_update) return;
    ++updates;
    if (std::isfinite(update.end_s)) time_s = update.end_s;
  }
};

/// Compresses what a survey's update holds, and back.
/// @throw std::invalid_argument for other bytes
std::string pack_survey(std::string_view record);
std::string unpack_survey(std::string_view bytes);

struct UpdateBefore;  // io/journal/update_coding.h

/// Creates `file` as a journal that holds only a configuration, atomically.
/// @param removed files of the previous run, which are about to be deleted
/// @return the journal's size, bytes
/// @throw std::runtime_error naming the file and the cause.
std::uint64_t begin_journal(const std::filesystem::path& file, const JournalConfig& config,
                            const std::vector<std::string>& removed = {});

/// Appends records to a journal. A thread of its own writes and syncs; add() only copies.
///
/// A record is acknowledged when it is certainly on disk. After an error the writer stops, and the
/// next call throws the error. If it waits for room, a full disk stops it only until there is room:
/// it keeps what is not on disk and tries again, at least once in `sync_s`. Until it succeeds,
/// check() and flush() throw DiskFull, and add() takes records. One thread may add files and
/// removals and call flush() while another adds updates; otherwise the class is not thread-safe.
class JournalWriter {
 public:
  /// @param end of the good part of the file, bytes; the constructor cuts off the rest
  /// @param done extent of the good part
  /// @param sync_s longest time until a record is acknowledged, s; 0: within add()
  /// @throw std::runtime_error naming the file and the cause, as the other members do.
  JournalWriter(std::filesystem::path file, std::uint64_t end, JournalExtent done, double sync_s,
                bool waits_for_room = false);
  /// Syncs all records if possible.
  ~JournalWriter();
  JournalWriter(const JournalWriter&) = delete;
  JournalWriter& operator=(const JournalWriter&) = delete;

  void add(const JournalConfig& config);
  void add(const JournalUpdate& update);
  void add(const JournalFile& file);
  void add(const JournalRemoval& removed);
  void add(const JournalEnd& end);
  /// Returns when all records added before are acknowledged.
  void flush();
  /// As flush(), but does not wait. @return acknowledged().updates when it is done
  std::uint64_t hurry();
  /// Throws if writing has failed; does not wait.
  void check() const;
  JournalExtent acknowledged() const;

 private:
  void added(std::unique_lock<std::mutex>& lock);
  void work();
  void write_batch(std::unique_lock<std::mutex>& lock, bool sync);
  void write_again();
  [[noreturn]] void fail() const;

  const std::filesystem::path file_;
  const double sync_s_;
  const bool waits_for_room_;
  int descriptor_ = -1;
  std::uint64_t end_ = 0, synced_ = 0;  // bytes
  std::string unsynced_;                // frames from `synced_` on
  std::string batch_;                   // records for the next frame
  std::vector<UpdateBefore> before_;    // by machine and pour

  mutable std::mutex mutex_;
  std::condition_variable wake_, done_;
  std::string pending_;  // records that are in no frame yet
  JournalExtent added_, acknowledged_;
  std::uint64_t count_added_ = 0, count_acknowledged_ = 0;  // records
  bool stop_ = false, hurry_ = false;
  std::string error_;
  bool full_ = false;  // the error is a full disk, and the writer tries again
  std::uint64_t tries_ = 0;
  std::thread worker_;
};

/// Reads a journal from its start to the end of its good part.
class JournalReader {
 public:
  /// @throw InputError if `file` does not exist or does not begin as a journal.
  explicit JournalReader(const std::filesystem::path& file);
  ~JournalReader();
  JournalReader(const JournalReader&) = delete;
  JournalReader& operator=(const JournalReader&) = delete;

  /// The next record; empty at the end of the good part.
  /// @throw InputError if a record with a good checksum can't be decoded.
  std::optional<JournalRecord> next();

  /// Size of the frames read so far, bytes.
  std::uint64_t good_bytes() const { return good_; }
  /// At the end: bytes of an incomplete frame that a crash left.
  std::uint64_t torn_bytes() const { return damaged_ ? 0 : size_ - good_; }
  /// At the end: is the frame at good_bytes() damaged although it was once on disk?
  bool damaged() const { return damaged_; }

 private:
  bool take(std::string_view& bytes, JournalUpdate& update);
  bool next_frame();
  bool synced_past(std::uint64_t place);

  std::filesystem::path file_;
  std::ifstream in_;
  std::uint64_t size_ = 0, good_ = 0;
  bool damaged_ = false, at_end_ = false;
  std::string frame_;
  std::size_t at_ = 0;
  std::vector<MotionRows> rows_;      // by machine, up to its last move
  std::vector<UpdateBefore> before_;  // by machine and pour
};

/// Does the file begin as a journal? False if there is no file.
bool is_journal(const std::filesystem::path& file);

/// A journal's content without the updates.
struct JournalContent {
  JournalConfig config;
  JournalExtent done;                ///< acknowledged
  std::vector<JournalFile> files;    ///< the last of each name, by updates
  std::vector<std::string> removed;  ///< names that are not among `files` any more
  bool ended = false;
  std::uint64_t good_bytes = 0, torn_bytes = 0;  ///< as in JournalReader
  bool damaged = false;
};
/// @throw InputError as JournalReader does.
JournalContent read_journal(const std::filesystem::path& file);

/// Number of updates before the first that ended later than a time. An update before its machine's
/// clock was set does not count as later if an update after that is not later: the clock was ahead.
/// @param machine only its updates count as later; empty: those of all
/// @throw InputError as JournalReader does.
std::uint64_t updates_until(const std::filesystem::path& file, double time_s,
                            std::optional<std::uint32_t> machine = {});

}  // namespace soilvdb::inline v0::io
