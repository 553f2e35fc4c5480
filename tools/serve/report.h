// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A report of the machines' work by period, as CSV and as a page to print.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "soilvdb/earthmoving.h"
#include "soilvdb/mass.h"
#include "tools/serve/live_site.h"
#include "tools/serve/progress.h"
#include "tools/serve/target.h"
#include "tools/serve/work_log.h"

namespace soilvdb::tools {

struct ReportQuery {
  /// What soil a volume is of: as it was counted, or converted by swell.
  enum class Soil { kCounted, kBank, kLoose };

  std::optional<double> from_s = {}, to_s = {};
  double every_s = 3600;
  bool yards = false, short_tons = false;
  Soil soil = Soil::kCounted;
  std::string length = {};  ///< the live page's unit, kept for links to it; empty: metres

  ReportQuery() = default;
  /// @throw std::invalid_argument with one line
  explicit ReportQuery(const QueryParameters& parameters);
  /// The value of `units=` that gives these units.
  std::string units() const;
};

/// The work of all machines of a site in periods. Sums of amounts are those of the ledger.
class Report {
 public:
  struct Period {
    double from_s = 0, to_s = 0;
    std::vector<Work> machines;  ///< by machine
    Work all() const;
  };
  /// Amounts in the units of the query. Empty: unknown.
  struct Row {
    double cut = 0, put_down = 0;        ///< counted in place, as bank soil; as loose soil
    std::optional<double> hauled, load;  ///< as loose soil; mass
    std::optional<double> load_factor;   ///< mean load per cycle / struck capacity
  };

  /// Copies what it needs of a site. @throw std::invalid_argument with one line for volumes as bank
  /// or loose soil of a site that does not know its swell
  Report(const LiveSite& site, ReportQuery query);
  /// Sums the periods; may run on another thread.
  /// @throw std::invalid_argument with one line for times that are not recorded, or too many
  /// periods
  void sum();

  const std::string& site() const { return site_; }
  const std::vector<std::string>& names() const { return names_; }
  const ReportQuery& query() const { return query_; }
  const std::vector<Period>& periods() const { return periods_; }
  /// Over all periods.
  const Period& total() const { return total_; }
  /// @param machine empty: of all
  Row row(const Period& period, std::optional<std::size_t> machine) const;
  double in_volume_unit(double m3) const;
  /// Of areas, as of now; empty: there are none.
  const std::vector<Progress>& progress() const { return progress_; }
  void set_progress(std::vector<Progress> progress) { progress_ = std::move(progress); }
  bool has_hoppers() const { return has_hoppers_; }
  bool has_mass() const { return soil_.has_value(); }
  const char* volume_unit() const { return query_.yards ? "yd3" : "m3"; }
  /// "bank" or "loose": the soil of volumes that are counted as one of them.
  const char* soil_of(ReportQuery::Soil counted) const;
  const char* mass_unit() const { return query_.short_tons ? "short_tons" : "t"; }
  /// Loose volume of one bank volume.
  double loose_per_bank() const {
    return static_cast<double>(units_.bank) / static_cast<double>(units_.loose);
  }
  /// Do times count from 1970?
  bool has_dates() const;

 private:
  /// In the query's units. @param counted bank or loose
  double volume(double m3, ReportQuery::Soil counted) const;
  struct Range {
    std::int64_t from = 0, to = 0;  ///< minutes
  };
  std::optional<Range> range() const;

  std::string site_;
  std::vector<std::string> names_;
  WorkLog log_;
  ReportQuery query_;
  std::optional<SoilProperties> soil_;
  MassUnits units_;
  double sample_m3_;
  bool has_hoppers_;
  std::vector<Period> periods_ = {};
  Period total_ = {};
  std::vector<Progress> progress_ = {};
};

/// "2026-11-27T06:00:00Z" of seconds since 1970.
std::string utc_text(double time_s);

/// A row per machine and period, a row of all machines per period, and such rows over all periods.
std::string report_csv(const Report& report);
/// A page of HTML without scripts. @param token for links to other pages; empty: none
std::string report_page(const Report& report, const std::string& token);

}  // namespace soilvdb::tools
