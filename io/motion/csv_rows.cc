// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows of a motion as CSV; only used columns are parsed.
#include <fmt/format.h>

#include <functional>
#include <string_view>

#include "io/file/text.h"
#include "io/mcap/mcap_format.h"
#include "io/motion/mcap_files.h"
#include "io/motion/motion_checks.h"
#include "io/motion/row_source.h"

namespace soilvdb::inline v0::io {
namespace {

class CsvRows : public RowSource {
 public:
  CsvRows(const std::filesystem::path& file, const std::optional<Chain>& chain) : lines_(file) {
    std::string begin(kMcapMagic.size(), '\0');
    std::ifstream(file, std::ios::binary).read(begin.data(), std::ssize(begin));
    if (begin == kMcapMagic)
      throw InputError(file,
                       "is an MCAP file; say which topic of it: 'motion: {mcap: FILE, "
                       "topic: /joint_states}'");
    refuse_sqlite(file);
    if (!lines_.next(line_)) throw InputError(file, "is empty; it must be a motion as CSV");
    split_fields(line_, fields_);
    columns_ = read_columns(lines_, fields_, chain);
  }

  const RowPlace& place() const override { return lines_; }
  const Columns& columns() const override { return columns_; }
  RowMark mark() const override { return mark_; }
  void go_to(const RowMark& mark) override { lines_.go_to(mark); }
  std::int64_t bytes_read() const override { return lines_.mark().bytes; }
  MotionSource source() const override { return lines_.file(); }

  Got next() override {
    mark_ = lines_.mark();
    if (!lines_.next(line_)) return Got::kEnd;
    return is_blank(line_) ? Got::kBlank : Got::kRow;
  }
  void values(std::vector<double>& v) override {
    split_fields(line_, fields_);
    if (fields_.size() != columns_.count) {
      lines_.fail(fmt::format("has {} field{}; the header has {} columns", fields_.size(),
                              fields_.size() == 1 ? "" : "s", columns_.count));
    }
    for (std::size_t i = 0; i < v.size(); ++i) {
      if (columns_.fields[i] == Columns::kNone) continue;
      v[i] = i == 0 ? row_time(lines_, fields_[columns_.fields[i]])
                    : row_number(lines_, columns_.names[i], fields_[columns_.fields[i]]);
    }
  }
  std::string time_text() const override { return std::string(fields_[columns_.fields[0]]); }
  std::size_t hash() const override { return std::hash<std::string_view>()(line_); }

  void warn(std::vector<std::string>& warnings) const override {
    std::vector<std::string> zero;
    for (std::size_t i = 0; i < columns_.names.size(); ++i) {
      if (columns_.fields[i] == Columns::kNone) zero.push_back(columns_.names[i]);
    }
    const auto& unused = columns_.unused;
    if (unused.empty()) return;
    std::string warning = fmt::format("{}: ignored column{} {}", lines_.file().string(),
                                      unused.size() == 1 ? "" : "s", quoted_list(unused));
    if (!zero.empty()) {
      warning += fmt::format("; {} {} there, taken as 0", quoted_list(zero),
                             zero.size() == 1 ? "isn't" : "aren't") +
                 other_case(zero, unused);
    }
    warnings.push_back(warning + other_case(columns_.absent, unused));
  }

 private:
  CsvLines lines_;
  RowMark mark_;
  Columns columns_;
  std::string_view line_;
  std::vector<std::string_view> fields_;
};

}  // namespace

std::unique_ptr<RowSource> csv_rows(const std::filesystem::path& file,
                                    const std::optional<Chain>& chain) {
  return std::make_unique<CsvRows>(file, chain);
}

}  // namespace soilvdb::inline v0::io
