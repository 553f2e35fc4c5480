// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Writing journals.
#include "soilvdb/io/journal.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <stdexcept>

#include "io/file/atomic_file.h"
#include "io/journal/journal_format.h"
#include "io/journal/update_coding.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kBatch = std::size_t{256} << 10;       // bytes; the thread waits for no more
constexpr std::size_t kMostPending = std::size_t{64} << 20;  // beyond, add() waits for the disk

void append_text(std::string& bytes, std::string_view text) {
  put(bytes, static_cast<std::uint32_t>(text.size()));
  bytes += text;
}

std::string frame(std::string_view content, std::uint64_t place, std::uint64_t synced) {
  const FrameHead head{static_cast<std::uint32_t>(content.size()), synced, crc64(content)};
  return head.bytes(place).append(content);
}

}  // namespace

std::uint64_t begin_journal(const std::filesystem::path& file, const JournalConfig& config,
                            const std::vector<std::string>& removed) {
  std::string content(1, kConfigTag);
  append_text(content, config.text);
  for (const std::string& name : removed) {
    content += kGoneTag;
    append_text(content, name);
  }
  const std::string bytes = frame(content, 0, 0);
  write_atomically(file, bytes);
  return bytes.size();
}

JournalWriter::JournalWriter(std::filesystem::path file, std::uint64_t end, JournalExtent done,
                             double sync_s, bool waits_for_room)
    : file_(std::move(file)),
      sync_s_(sync_s),
      waits_for_room_(waits_for_room),
      end_(end),
      added_(done),
      acknowledged_(done) {
  descriptor_ = ::open(file_.c_str(), O_WRONLY | O_CLOEXEC);
  if (descriptor_ < 0) fail_to_write(file_, errno);
  if (::ftruncate(descriptor_, static_cast<off_t>(end)) != 0 || ::fsync(descriptor_) != 0 ||
      ::lseek(descriptor_, static_cast<off_t>(end), SEEK_SET) < 0) {
    const int error = errno;
    ::close(descriptor_);
    fail_to_write(file_, error);
  }
  synced_ = end;
  worker_ = std::thread([this] { work(); });
}

JournalWriter::~JournalWriter() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  worker_.join();
  ::close(descriptor_);
}

void JournalWriter::add(const JournalUpdate& update) {
  std::unique_lock lock(mutex_);
  pending_ += kUpdateTag;
  append_update(pending_, update, before_);
  added_.add(update);
  added(lock);
}

void JournalWriter::add(const JournalConfig& config) {
  std::unique_lock lock(mutex_);
  pending_ += kConfigTag;
  append_text(pending_, config.text);
  added(lock);
}

void JournalWriter::add(const JournalFile& file) {
  std::unique_lock lock(mutex_);
  pending_ += kFileTag;
  for (const std::uint64_t value : {file.updates, file.size, file.crc}) put(pending_, value);
  append_text(pending_, file.name);
  append_text(pending_, file.parent);
  added(lock);
}

void JournalWriter::add(const JournalRemoval& removed) {
  std::unique_lock lock(mutex_);
  pending_ += kGoneTag;
  append_text(pending_, removed.name);
  added(lock);
}

void JournalWriter::add(const JournalEnd&) {
  flush();  // so that all records before the end are on disk first
  std::unique_lock lock(mutex_);
  pending_ += kEndTag;
  added(lock);
}

void JournalWriter::added(std::unique_lock<std::mutex>& lock) {
  ++count_added_;
  if (pending_.size() >= kBatch) wake_.notify_one();
  done_.wait(lock, [&] { return pending_.size() < kMostPending || !error_.empty(); });
  if (!error_.empty() && !full_) fail();
  if (sync_s_ > 0) return;
  lock.unlock();
  flush();
}

void JournalWriter::flush() {
  std::unique_lock lock(mutex_);
  const std::uint64_t count = count_added_, tries = tries_;
  hurry_ = true;
  wake_.notify_one();
  done_.wait(lock, [&] {
    return count_acknowledged_ >= count || (!error_.empty() && (!full_ || tries_ > tries));
  });
  if (!error_.empty()) fail();
}

std::uint64_t JournalWriter::hurry() {
  const std::lock_guard lock(mutex_);
  hurry_ = true;
  wake_.notify_one();
  return added_.updates;
}

void JournalWriter::fail() const {
  if (full_) throw DiskFull(error_);
  throw std::runtime_error(error_);
}

void JournalWriter::check() const {
  const std::lock_guard lock(mutex_);
  if (!error_.empty()) fail();
}

JournalExtent JournalWriter::acknowledged() const {
  const std::lock_guard lock(mutex_);
  return acknowledged_;
}

void JournalWriter::work() {
  constexpr double kLongest_s = 1e6;  // the clock's range is smaller than a double's
  const auto interval = std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(sync_s_ > 0 ? std::min(sync_s_, kLongest_s) : 1.0));
  Clock::time_point next_sync = Clock::now() + interval;
  std::unique_lock lock(mutex_);
  for (bool last = false; !last;) {
    wake_.wait_until(lock, next_sync,
                     [&] { return stop_ || hurry_ || (pending_.size() >= kBatch && !full_); });
    last = stop_;
    const bool sync = last || hurry_ || Clock::now() >= next_sync;
    hurry_ = false;
    if (sync) next_sync = Clock::now() + interval;
    if (error_.empty() || full_) {
      std::string error;
      bool full = false;
      try {
        write_batch(lock, sync || full_);
      } catch (const DiskFull& e) {
        error = e.what();
        full = waits_for_room_;
      } catch (const std::exception& e) {
        error = e.what();
      }
      if (!lock.owns_lock()) lock.lock();
      error_ = std::move(error);
      full_ = full;
      ++tries_;
    }
    done_.notify_all();
  }
}

/// Nothing that was not synced is certain after a failure.
void JournalWriter::write_again() {
  if (::ftruncate(descriptor_, static_cast<off_t>(synced_)) != 0 ||
      ::lseek(descriptor_, static_cast<off_t>(synced_), SEEK_SET) < 0)
    fail_to_write(file_, errno);
  end_ = synced_;
}

void JournalWriter::write_batch(std::unique_lock<std::mutex>& lock, bool sync) {
  batch_.clear();
  batch_.swap(pending_);  // swaps buffers, so that both keep their capacity
  const JournalExtent upto = added_;
  const std::uint64_t count = count_added_;
  const bool again = full_;
  lock.unlock();
  if (again) write_again();
  if (!batch_.empty()) unsynced_ += frame(batch_, synced_ + unsynced_.size(), synced_);
  while (end_ < synced_ + unsynced_.size()) {
    const std::string_view rest = std::string_view(unsynced_).substr(end_ - synced_);
    const ssize_t n = ::write(descriptor_, rest.data(), rest.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail_to_write(file_, errno);
    end_ += static_cast<std::uint64_t>(n);
  }
  sync |= unsynced_.size() > kMostPending;
  if (sync && synced_ < end_) {
    if (::fdatasync(descriptor_) != 0) fail_to_write(file_, errno);
    // A removed file can't be named any more.
    struct stat now {};
    if (::fstat(descriptor_, &now) == 0 && now.st_nlink == 0) fail_to_write(file_, ENOENT);
    synced_ = end_;
    unsynced_.clear();
  }
  lock.lock();
  if (!sync) return;
  acknowledged_ = upto;
  count_acknowledged_ = count;
}

}  // namespace soilvdb::inline v0::io
