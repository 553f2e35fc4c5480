// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The journal of a run: what each update consumed and gave, in an append-only file from which an
// interrupted run goes on.
//
// A file of frames. Each has a checksum over its content and its place in the file, and says up to
// where the file was known to be on disk when it was written. So a bad frame at the end is what a
// crash leaves, the end of the journal; a bad frame before that is damage.
#pragma once

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

/// What the run was asked for, as the program writes it; the first record.
struct JournalConfig {
  std::string text;
};
/// Something that was done to a site, and what came of it.
struct JournalUpdate {
  enum class Kind : std::uint8_t {
    /// A machine moved on over [begin_s, end_s] along `rows`. If those begin later it went evenly
    /// from where it was to the one there is; if `begin_s` is NaN, straight to the last one, and
    /// `end_s` may be NaN, too.
    kMove,
    kPour,   ///< of one pour, all that falls up to end_s; pours are numbered after the machines
    kPours,  ///< the same of all pours
    kRest,   ///< all that moves came to rest
    kClock   ///< a machine's was set: its next time may be earlier than its last
  };
  std::uint32_t machine = 0;
  bool ends_update = true;  ///< else it goes on in the machine's next move
  double begin_s = std::numeric_limits<double>::quiet_NaN(), end_s = begin_s;
  std::int64_t cut_samples = 0;     ///< of Ground::sample_m3()
  std::int64_t bucket_samples = 0;  ///< after it; where soil moves in MassUnits, as what follows
  std::int64_t ns = 0;              ///< it took
  MotionRows rows = {};
  std::int64_t spilled = 0, slid = 0;
  Kind kind = Kind::kMove;
};
/// A file that was finished, as of so many updates.
struct JournalFile {
  std::string name;
  std::uint64_t updates = 0, size = 0, crc = 0;
  std::string parent = {};  ///< an incremental snapshot: the one before it
};
/// A file that is no longer needed and is about to be deleted.
struct JournalRemoval {
  std::string name;
};
/// The run came to its end.
struct JournalEnd {};
using JournalRecord =
    std::variant<JournalConfig, JournalUpdate, JournalFile, JournalRemoval, JournalEnd>;

/// How far a run, or what a session was fed, has come.
struct JournalExtent {
  std::uint64_t updates = 0;
  double time_s = 0;  ///< of the last that has one

  void add(const JournalUpdate& update) {
    if (!update.ends_update) return;
    ++updates;
    if (std::isfinite(update.end_s)) time_s = update.end_s;
  }
};

struct UpdateBefore;  // io/journal/update_coding.h

/// Makes `file` a journal that holds a configuration and nothing else, atomically.
/// @param removed files of a run before, which are about to be deleted
/// @return its size, bytes
/// @throw std::runtime_error naming the file and the cause.
std::uint64_t begin_journal(const std::filesystem::path& file, const JournalConfig& config,
                            const std::vector<std::string>& removed = {});

/// Appends records to a journal. A thread of its own writes and syncs, so add() costs a copy.
///
/// A record is acknowledged once it is on disk for sure. After an error nothing more is written,
/// and the next call throws it. Files and what is removed may be added, and flush() called, by one
/// thread while another adds updates; else it is not thread-safe.
class JournalWriter {
 public:
  /// @param end of the good part of the file, in bytes; what comes after it is cut off
  /// @param done how far the good part comes
  /// @param sync_s at most this long, s, until a record is acknowledged; 0: within add()
  /// @throw std::runtime_error naming the file and the cause, as the others do.
  JournalWriter(std::filesystem::path file, std::uint64_t end, JournalExtent done, double sync_s);
  /// Syncs what there is, if it can.
  ~JournalWriter();
  JournalWriter(const JournalWriter&) = delete;
  JournalWriter& operator=(const JournalWriter&) = delete;

  void add(const JournalUpdate& update);
  void add(const JournalFile& file);
  void add(const JournalRemoval& removed);
  void add(const JournalEnd& end);
  /// Returns when all that was added before is acknowledged.
  void flush();
  /// Throws if writing has failed; doesn't wait.
  void check() const;
  JournalExtent acknowledged() const;

 private:
  void added(std::unique_lock<std::mutex>& lock);
  void work();
  void write_batch(std::unique_lock<std::mutex>& lock, bool sync);

  const std::filesystem::path file_;
  const double sync_s_;
  int descriptor_ = -1;
  std::uint64_t end_ = 0, synced_ = 0;  // bytes
  std::string batch_;                   // records on their way into a frame
  std::vector<UpdateBefore> before_;    // of each machine and pour

  mutable std::mutex mutex_;
  std::condition_variable wake_, done_;
  std::string pending_;  // records that aren't in a frame yet
  JournalExtent added_, acknowledged_;
  std::uint64_t count_added_ = 0, count_acknowledged_ = 0;  // records
  bool stop_ = false, hurry_ = false;
  std::string error_;
  std::thread worker_;
};

/// Reads a journal from its start to the end of its good part.
class JournalReader {
 public:
  /// @throw InputError if `file` is not there or does not begin as a journal does.
  explicit JournalReader(const std::filesystem::path& file);
  ~JournalReader();
  JournalReader(const JournalReader&) = delete;
  JournalReader& operator=(const JournalReader&) = delete;

  /// The next record; nothing at the end of the good part.
  /// @throw InputError if a record makes no sense although its checksum is right.
  std::optional<JournalRecord> next();

  /// Of the frames read so far, in bytes.
  std::uint64_t good_bytes() const { return good_; }
  /// At the end: bytes that a crash left of a frame that never became whole.
  std::uint64_t torn_bytes() const { return damaged_ ? 0 : size_ - good_; }
  /// At the end: is the frame at good_bytes() damaged, having been on disk once?
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
  std::vector<MotionRows> rows_;      // of each machine, as its last move had them
  std::vector<UpdateBefore> before_;  // of each machine and pour
};

/// Does this file begin as a journal does? False if there is none.
bool is_journal(const std::filesystem::path& file);

/// What a journal says, but for the updates.
struct JournalContent {
  JournalConfig config;
  JournalExtent done;                ///< acknowledged
  std::vector<JournalFile> files;    ///< the last of each name, by updates
  std::vector<std::string> removed;  ///< that aren't among them any more
  bool ended = false;
  std::uint64_t good_bytes = 0, torn_bytes = 0;  ///< as of JournalReader
  bool damaged = false;
};
/// @throw InputError as JournalReader does.
JournalContent read_journal(const std::filesystem::path& file);

/// How many updates were made before the first that ended later than a time. One from before its
/// machine's clock was set isn't later if one that was made after it is not: its clock was ahead.
/// @throw InputError as JournalReader does.
std::uint64_t updates_until(const std::filesystem::path& file, double time_s);

}  // namespace soilvdb::inline v0::io
