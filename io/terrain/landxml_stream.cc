// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/landxml_stream.h"

#include <fmt/format.h>
#include <iconv.h>

#include <cmath>
#include <fstream>
#include <new>
#include <utility>
#include <vector>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostDepth = 100;
constexpr XML_Index kMostToken_bytes = 1 << 20;

/// Lengths by LandXML's names, m.
constexpr std::pair<std::string_view, double> kUnits[] = {
    {"millimeter", 0.001}, {"centimeter", 0.01}, {"meter", 1},
    {"kilometer", 1000},   {"foot", 0.3048},     {"USSurveyFoot", 1200.0 / 3937},
    {"inch", 0.0254},      {"mile", 1609.344}};

/// An encoding of one byte per character, by the C library's name of it.
int set_encoding(void*, const char* name, XML_Encoding* encoding) {
  const std::string_view letters = name;
  if (letters.find_first_not_of(
          "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_") != letters.npos)
    return XML_STATUS_ERROR;
  const iconv_t from = iconv_open("WCHAR_T", name);
  if (from == reinterpret_cast<iconv_t>(-1)) return XML_STATUS_ERROR;
  for (int byte = 0; byte < 256; ++byte) {
    char in = static_cast<char>(byte), *next_in = &in;
    wchar_t out = 0;
    char* next_out = reinterpret_cast<char*>(&out);
    std::size_t in_left = 1, out_left = sizeof out;
    iconv(from, nullptr, nullptr, nullptr, nullptr);
    const bool good = iconv(from, &next_in, &in_left, &next_out, &out_left) == 0 && out_left == 0;
    encoding->map[byte] = good ? static_cast<int>(out) : -1;
  }
  iconv_close(from);
  return XML_STATUS_OK;
}

}  // namespace

LandXmlStream::LandXmlStream(std::filesystem::path file)
    : file_(std::move(file)), parser_(XML_ParserCreate(nullptr)) {
  if (parser_ == nullptr) throw std::bad_alloc();
  XML_SetUserData(parser_.get(), this);
  XML_SetElementHandler(
      parser_.get(),
      [](void* self, const char* name, const char** attributes) {
        static_cast<LandXmlStream*>(self)->guard(
            [=](LandXmlStream& stream) { stream.begin_any(name, attributes); });
      },
      [](void* self, const char*) {
        static_cast<LandXmlStream*>(self)->guard([](LandXmlStream& stream) {
          --stream.depth_;
          stream.end();
        });
      });
  XML_SetCharacterDataHandler(parser_.get(), [](void* self, const char* text, int size) {
    static_cast<LandXmlStream*>(self)->guard([=](LandXmlStream& stream) {
      stream.add({text, static_cast<std::size_t>(size)});
    });
  });
  XML_SetUnknownEncodingHandler(parser_.get(), set_encoding, nullptr);
  XML_SetStartDoctypeDeclHandler(
      parser_.get(), [](void* self, const char*, const char*, const char*, int) {
        static_cast<LandXmlStream*>(self)->guard([](LandXmlStream& stream) {
          stream.fail("has a document type declaration, which no LandXML needs; remove it");
        });
      });
}

void LandXmlStream::parse() {
  check_readable(file_);
  std::ifstream in(file_, std::ios::binary);
  std::vector<char> block(1 << 16);
  XML_Index given = 0;
  while (in) {
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    if (in.bad()) throw InputError(file_, "can't be read to its end");
    const auto size = static_cast<int>(in.gcount());
    given += size;
    const bool good = XML_Parse(parser_.get(), block.data(), size, in.eof()) == XML_STATUS_OK;
    if (problem_) std::rethrow_exception(problem_);
    if (!good) {
      const XML_Error error = XML_GetErrorCode(parser_.get());
      if (error == XML_ERROR_NO_MEMORY) throw std::bad_alloc();
      fail(fmt::format("isn't well-formed XML ({})", XML_ErrorString(error)));
    }
    // A token that isn't complete is kept, and read again with each block.
    if (given - XML_GetCurrentByteIndex(parser_.get()) > kMostToken_bytes)
      fail("has a tag or comment of more than 1 MB");
  }
}

long LandXmlStream::line() const {
  return static_cast<long>(XML_GetCurrentLineNumber(parser_.get()));
}

void LandXmlStream::fail(const std::string& what) const { throw InputError(file_, line(), what); }

/// Exceptions must not pass through Expat, which is C.
template <typename F>
void LandXmlStream::guard(const F& f) noexcept {
  if (problem_) return;
  try {
    f(*this);
  } catch (...) {
    problem_ = std::current_exception();
    XML_StopParser(parser_.get(), XML_FALSE);
  }
}

const char* LandXmlStream::attribute(const char** all, std::string_view name) {
  for (; *all != nullptr; all += 2)
    if (name == *all) return all[1];
  return nullptr;
}

double LandXmlStream::unit_of(const char* name) const {
  for (const auto& [known, metres] : kUnits)
    if (known == name) return metres;
  fail(fmt::format("the unit '{}' is not known; LandXML has meter, foot, USSurveyFoot and others",
                   printable(name)));
}

void LandXmlStream::set_units(const char** attributes, const char* usual) {
  const char* const given = attribute(attributes, "linearUnit");
  input_.unit = given != nullptr ? given : usual;
  input_.unit_m = input_.height_unit_m = unit_of(input_.unit.c_str());
  const char* const heights = attribute(attributes, "elevationUnit");
  if (heights == nullptr) return;
  const std::string_view unit = heights;
  // "feet" are those of the linear unit, if that is one of both.
  const bool foot = std::abs(input_.unit_m - 0.3048) < 1e-5;
  if (unit == "feet")
    input_.height_unit_m = foot ? input_.unit_m : 0.3048;
  else
    input_.height_unit_m = unit_of(unit == "miles" ? "mile" : heights);
}

void LandXmlStream::begin_any(const char* full_name, const char** attributes) {
  if (depth_ == kMostDepth) fail("has more than 100 tags within each other");
  const char* const colon = std::strrchr(full_name, ':');
  const std::string_view name = colon != nullptr ? colon + 1 : full_name;
  if (depth_ == 0 && name != "LandXML")
    fail(fmt::format("is XML of a '{}', not of LandXML", printable(name)));
  if (name == "Metric" || name == "Imperial")
    set_units(attributes, name == "Metric" ? "meter" : "foot");
  if (name == "CoordinateSystem" && depth_ == 1) {
    if (const char* epsg = attribute(attributes, "epsgCode")) input_.epsg = epsg;
    if (const char* wkt = attribute(attributes, "ogcWktCode")) input_.wkt = wkt;
  }
  ++depth_;
  begin(name, attributes);
}

}  // namespace soilvdb::inline v0::io
