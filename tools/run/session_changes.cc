// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Machines and hoppers that come to a session, change their names and leave it.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "io/file/json.h"
#include "io/file/text.h"
#include "io/scenario/newcomer.h"
#include "io/terrain/geodetic.h"
#include "tools/run/session_state.h"

namespace soilvdb::inline v0 {
namespace {

using Json = nlohmann::json;

constexpr int kMostLevels = 8;  // of a change's JSON, deeper than any machine's
constexpr std::size_t kMostOfSite = 1000;
constexpr double kForever = std::numeric_limits<double>::infinity();

bool is_deeper(const Json& json, int levels) {
  if (!json.is_structured()) return false;
  return levels == 0 || std::any_of(json.begin(), json.end(),
                                    [&](const Json& part) { return is_deeper(part, levels - 1); });
}

/// Only what newcomers must fit.
io::Scenario scenario_of(const SiteModel& model, double voxel_size_m,
                         const std::filesystem::path& file) {
  io::Scenario site;
  site.file = file;
  site.voxel_size_m = voxel_size_m;
  for (const SiteMachine& machine : model.machines)
    site.machines.emplace_back(machine.name, machine.bucket, machine.chain);
  site.soil = model.earthmoving.soil;
  site.pours = model.earthmoving.pours;
  site.hoppers = model.earthmoving.hoppers;
  return site;
}

std::string name_in(const Json& json, const char* what) {
  if (!json.is_string()) throw std::invalid_argument(std::string(what) + " must be a name");
  return json.get<std::string>();
}

double number_in(const Json& json, const char* what) {
  if (!json.is_number() || !std::isfinite(json.get<double>()))
    throw std::invalid_argument(std::string(what) + " must be numbers, in s");
  return json.get<double>();
}

/// @throw std::invalid_argument with the names that there are
template <typename Named>
std::size_t index_of(const std::vector<Named>& all, const std::string& name, const char* kind) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].name == name) return i;
    names.push_back(all[i].name);
  }
  throw std::invalid_argument(fmt::format("there is no {} '{}'; there are: {}", kind,
                                          io::printable(name),
                                          names.empty() ? "none" : io::quoted_list(names)));
}

/// A change is an object with one key, but for what is added when it is recorded.
void require_verb(const Json& change, const std::vector<std::string>& verbs) {
  std::size_t known = 0;
  for (const std::string& verb : verbs) known += change.contains(verb);
  if (change.is_object() && known == 1) return;
  throw std::invalid_argument(
      fmt::format("a change is an object with one of the keys {}", io::quoted_list(verbs)));
}

template <typename Named>
void rename(std::vector<Named>& all, const Json& change, const char* kind,
            const io::Scenario& site) {
  const Json& names = change["rename"];
  if (!names.is_object() || names.size() != 2 || !names.contains("from") || !names.contains("to"))
    throw std::invalid_argument("'rename' must be an object with 'from' and 'to'");
  const std::size_t i = index_of(all, name_in(names["from"], "'from'"), kind);
  const std::string to = name_in(names["to"], "'to'");
  io::require_new_name(to, site);
  all[i].name = to;
}

/// Can a receiver's positions be brought into the site?
void require_geodetic(const Gnss& gnss, const io::Site& site) {
  try {
    const io::Geodetic geodetic(gnss, site.crs_wkt, site.bounds);
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(fmt::format("gnss: {}", e.what()));
  }
}

/// @param change receives the machine's place in the list, when it is made first
void change_machines(Json& change, SiteModel& model, std::vector<bool>& retired, io::Scenario& site,
                     const io::Site& opened) {
  require_verb(change, {"add", "rename", "retire", "restore"});
  std::vector<SiteMachine>& machines = model.machines;
  if (change.contains("rename")) return rename(machines, change, "machine", site);
  if (change.contains("add")) {
    if (machines.size() >= kMostOfSite)
      throw std::invalid_argument(fmt::format("a site has at most {} machines", kMostOfSite));
    const io::MachineInput read = io::read_machine(io::to_text(change["add"]), site);
    // A recording has poses: whoever opens it needs no grids.
    if (read.gnss && !change.contains("place")) require_geodetic(*read.gnss, opened);
    // Of a scenario, more machines may have come at the end of the list.
    if (!change.contains("place")) change["place"] = machines.size();
    const auto place =
        static_cast<std::ptrdiff_t>(std::min(change["place"].get<std::size_t>(), machines.size()));
    machines.insert(machines.begin() + place,
                    {read.name, read.bucket, read.chain, read.lip_sigma_m, read.gnss});
    retired.insert(retired.begin() + place, false);
    return;
  }
  const bool retire = change.contains("retire");
  const std::string name = name_in(change[retire ? "retire" : "restore"], "a machine");
  const std::size_t i = index_of(machines, name, "machine");
  if (retired[i] == retire)
    throw std::invalid_argument(fmt::format("machine '{}' {}", io::printable(name),
                                            retire ? "is retired already" : "is not retired"));
  retired[i] = retire;
}

void change_hoppers(const Json& change, SiteModel& model, const io::Scenario& site) {
  require_verb(change, {"add", "rename", "retire"});
  std::vector<Hopper>& hoppers = model.earthmoving.hoppers;
  if (change.contains("rename")) return rename(hoppers, change, "hopper", site);
  if (change.contains("add")) {
    Json keys = change["add"];
    double begin_s = -kForever, end_s = kForever;
    if (keys.is_object() && keys.contains("time")) {
      const Json& time = keys["time"];
      if (!time.is_array() || time.empty() || time.size() > 2)
        throw std::invalid_argument("'time' must be an array of begin and end, or of begin only");
      begin_s = number_in(time[0], "'time'");
      if (time.size() == 2) end_s = number_in(time[1], "'time'");
      if (begin_s >= end_s)
        throw std::invalid_argument(
            fmt::format("'time' is from {} to {} s; a hopper must be gone later than it comes",
                        begin_s, end_s));
      keys.erase("time");
    }
    hoppers.push_back(io::read_hopper(io::to_text(keys), begin_s, end_s, site));
    return;
  }
  Hopper& hopper = hoppers[index_of(hoppers, name_in(change["retire"], "a hopper"), "hopper")];
  const double time_s = change.contains("time") ? number_in(change["time"], "'time'") : -kForever;
  if (hopper.end_s <= time_s)
    throw std::invalid_argument(
        fmt::format("hopper '{}' is gone already", io::printable(hopper.name)));
  hopper.end_s = std::max(time_s, std::nextafter(hopper.begin_s, kForever));
}

}  // namespace

/// The same state with another model, whose first machines are those that have states.
void Session::State::rebuild(SiteModel model, std::string_view progress) {
  SiteState next(std::move(model), site);
  next.set_progress(progress);
  std::copy(backwards.begin(), backwards.end(), next.backwards.begin());
  next.warnings = std::move(warnings);
  SiteState::operator=(std::move(next));
}

void Session::State::change_lists(Json change) {
  const std::string list = change.value("list", "");
  if (is_deeper(change, kMostLevels)) throw std::invalid_argument("a change is JSON of few levels");
  SiteModel next = model();
  io::Scenario beside =
      scenario_of(next, site.ground->voxel_size_m(),
                  settings.scenario.empty() ? std::filesystem::path("site") : settings.scenario);
  std::vector<bool> retired = settings.retired;
  retired.resize(next.machines.size());
  if (list == "machines")
    change_machines(change, next, retired, beside, site);
  else
    change_hoppers(change, next, beside);
  const std::size_t machines = model().machines.size();
  rebuild(std::move(next), progress());
  settings.retired = std::move(retired);
  settings.changes.push_back(io::to_text(change));
  warn_of_voxels(machines);
  warnings.insert(warnings.end(), beside.warnings.begin(), beside.warnings.end());
}

void Session::State::repeat_changes(const Json& config, const std::filesystem::path& recording) {
  const Json recorded = config.value("changes", Json::array());
  if (recorded == Json(settings.changes)) return;
  try {
    if (!settings.changes.empty())
      throw std::invalid_argument("this session has other changes of its machines");
    for (const Json& change : recorded)
      change_lists(io::parse_json(change.get_ref<const std::string&>()));
  } catch (const std::exception& e) {
    throw io::InputError(
        recording, fmt::format("has machines or hoppers that changed while the site worked, which "
                               "does not fit the scenario now: {}; leave such changes out there",
                               e.what()));
  }
}

bool Session::is_retired(std::size_t machine) const {
  const std::vector<bool>& retired = state_->settings.retired;
  return machine < retired.size() && retired[machine];
}

void Session::change_list(const std::string& list, const std::string& json) {
  State& s = *state_;
  if (!s.broken_.empty()) throw std::runtime_error(s.broken_);
  Json change = io::parse_json(json);
  const std::size_t keys =
      list == "hoppers" && change.contains("retire") && change.contains("time") ? 2 : 1;
  if (!change.is_object() || change.size() != keys)
    throw std::invalid_argument("a change is a JSON object with one key");
  change["list"] = list;
  s.require_recording();
  s.change_lists(std::move(change));
  if (!s.recorder) return;
  Json config = io::from_cbor(s.journal_config);
  const Json site = s.description(/*with_ground=*/false);
  for (const char* key : {"machines", "hoppers"})
    if (site.contains(key)) config["site"][key] = site[key];
  config["changes"] = s.settings.changes;
  s.journal_config = io::to_cbor(config);
  try {
    s.recorder->journal().add(io::JournalConfig{s.journal_config});
    flush();
  } catch (const std::exception& e) {
    throw std::runtime_error(fmt::format("it is changed, but not recorded yet: {}", e.what()));
  }
}

}  // namespace soilvdb::inline v0
