// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What all uses of GDAL share: it is set up once, and its messages are kept from the terminal.
#pragma once

#include <string>

namespace soilvdb::inline v0::io {

/// The formats that heights are read from, by GDAL's names, a null at the end: whoever links us may
/// have told GDAL of others.
const char* const* height_formats();

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
