// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A LandXML file as a stream of tags, with its units and CRS. Memory is that of what is kept. A DTD
// is refused, and with it entities of a file's own.
#pragma once

#include <expat.h>

#include <exception>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "io/terrain/tin.h"

namespace soilvdb::inline v0::io {

class LandXmlStream {
 public:
  LandXmlStream(const LandXmlStream&) = delete;
  LandXmlStream& operator=(const LandXmlStream&) = delete;

 protected:
  explicit LandXmlStream(std::filesystem::path file);
  virtual ~LandXmlStream() = default;

  /// Reads the file to its end. @throw InputError
  void parse();
  /// The line that is being read.
  long line() const;
  /// @throw InputError with that line
  [[noreturn]] void fail(const std::string& what) const;
  /// Null: it is not given.
  static const char* attribute(const char** all, std::string_view name);

  /// A tag, without the prefix of its name; what is between tags; the end of the last open tag.
  virtual void begin(std::string_view name, const char** attributes) = 0;
  virtual void add(std::string_view text) = 0;
  virtual void end() = 0;

  const std::filesystem::path file_;
  TinInput input_;  ///< its units and CRS are set

 private:
  template <typename F>
  void guard(const F& f) noexcept;
  double unit_of(const char* name) const;
  void set_units(const char** attributes, const char* usual);
  void begin_any(const char* name, const char** attributes);

  struct Free {
    void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
  };
  std::unique_ptr<XML_ParserStruct, Free> parser_;
  std::exception_ptr problem_;
  std::size_t depth_ = 0;
};

}  // namespace soilvdb::inline v0::io
