// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Journals. The mutator mends the frames' checksums most of the time, so that what is in them is
// read, too.
#include "io/journal/journal_format.h"
#include "soilvdb/io/journal.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t most);

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  const auto file = folder.write("journal", fuzz::text(data, size));
  fuzz::expect_read_or_refused([&] {
    io::JournalReader reader(file);
    while (const std::optional<io::JournalRecord> record = reader.next()) {
      const auto* move = std::get_if<io::JournalUpdate>(&*record);
      if (!move) continue;
      try {
        io::motion_of(move->rows, {});
      } catch (const std::invalid_argument& no_motion) {
        fuzz::check_message(no_motion);
      }
    }
    fuzz::require(reader.good_bytes() + reader.torn_bytes() <= size, "no more than there is");
    fuzz::require(io::read_journal(file).good_bytes == reader.good_bytes(), "the same again");
  });
  return 0;
}

#ifndef SOILVDB_REPLAY
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t most, unsigned seed) {
  using io::FrameHead;
  size = LLVMFuzzerMutate(data, size, most);
  if (seed % 4 == 0) return size;
  for (std::size_t at = 0; at + FrameHead::kSize < size;) {
    const std::string_view rest = fuzz::text(data + at, size - at).substr(sizeof io::kFrameMark);
    const std::size_t left = size - at - FrameHead::kSize;
    FrameHead head;
    std::string_view fields = rest;
    try_take(fields, head.length);
    try_take(fields, head.synced);
    if (head.length == 0 || head.length > left) head.length = static_cast<std::uint32_t>(left);
    head.crc = io::crc64(fuzz::text(data + at + FrameHead::kSize, head.length));
    const std::string bytes = head.bytes(at);
    std::copy(bytes.begin(), bytes.end(), data + at);
    at += bytes.size() + head.length;
  }
  return size;
}
#endif
