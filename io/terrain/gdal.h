// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What all uses of GDAL share: it is set up once, and its messages are kept from the terminal.
#pragma once

#include <filesystem>
#include <string>

namespace soilvdb::inline v0::io {

/// The format of a file of heights, by GDAL's name; empty: of none that we read, whatever others
/// have told GDAL of. Formats whose files say nothing of themselves (EHdr, ENVI) are asked last:
/// they take any file with a header of theirs beside it.
std::string height_format(const std::filesystem::path& file);

/// While one lives, what GDAL and PROJ would print on this thread is kept here. Makes sure GDAL is
/// ready. Scopes nest.
class GdalMessages {
 public:
  GdalMessages();
  ~GdalMessages();
  GdalMessages(const GdalMessages&) = delete;
  GdalMessages& operator=(const GdalMessages&) = delete;

  /// The first error so far, on one line; empty if there was none.
  const std::string& error() const { return error_; }
  /// The first error, or `otherwise` if GDAL failed without a word.
  std::string error_or(const char* otherwise) const;
  void clear() { error_.clear(); }

 private:
  static void keep(int severity, int number, const char* message);
  std::string error_;
};

}  // namespace soilvdb::inline v0::io
