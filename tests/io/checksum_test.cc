// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/checksum.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace checksum_test {

using test::TempFolder;

TEST(Checksum, IsTheOneThatXzUses) {
  EXPECT_EQ(crc64("123456789"), 0x995dc9bbdf1939fau);  // the check value of CRC-64/XZ
}

TEST(Checksum, TellsFilesApartByTheirStartMiddleAndEnd) {
  const TempFolder folder;
  std::string bytes(10 << 20, 'a');
  const std::string before = file_fingerprint(folder.write("a", bytes));
  EXPECT_EQ(file_fingerprint(folder.write("b", bytes)), before);
  for (const std::size_t at : {std::size_t{0}, bytes.size() - 1}) {
    std::string other = bytes;
    other[at] = 'b';
    EXPECT_NE(file_fingerprint(folder.write("b", other)), before) << at;
  }
  EXPECT_NE(file_fingerprint(folder.write("b", bytes + "a")), before);
  // Between its blocks it only looks if it is told to.
  std::string other = bytes;
  other[100 << 10] = 'b';
  EXPECT_EQ(file_fingerprint(folder.write("b", other)), before);
  EXPECT_NE(file_fingerprint(folder / "b", true), file_fingerprint(folder / "a", true));
}

}  // namespace checksum_test
}  // namespace soilvdb::io
