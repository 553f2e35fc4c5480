// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/live_forces.h"

#include <exception>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "io/file/json.h"
#include "soilvdb/resistance.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

SoilStrength strength_of(const Session& site) { return SoilStrength::of(*site.earthmoving().soil); }

/// Of one machine. @param look gives its cut geometry, or throws why there is none
template <typename Look>
Json force_on(const SiteMachine& machine, const SoilStrength& soil, const Look& look) {
  Json json = {{"name", machine.name},
               {"world_force_n", nullptr},
               {"world_load_n", nullptr},
               {"limited", ""},
               {"why", ""}};
  try {
    const CutGeometry geometry = look();
    const Resistance resistance = geometry.resistance(soil);
    const Eigen::Quaterniond& world_from_bucket = geometry.world_from_bucket().rotation;
    json["world_force_n"] = io::numbers(turned(resistance.total(), world_from_bucket).force);
    json["world_load_n"] = io::numbers(turned(resistance.load, world_from_bucket).force);
    json["limited"] = resistance.limited();
  } catch (const std::exception& e) {
    json["why"] = e.what();
  }
  return json;
}

Json message_of(std::uint32_t view) {
  return {{"type", "force"}, {"id", view}, {"machines", Json::array()}};
}

/// A bucket where it was when its force was asked for.
struct BucketThere {
  const SiteMachine* machine;
  Pose world_from_bucket;
  Vec3 way;
  double load_m3;  ///< as bank soil
};

}  // namespace

std::string force_message(Session& site, std::uint32_t view) {
  Json json = message_of(view);
  const SoilStrength soil = strength_of(site);
  for (std::size_t i = 0; i < site.machines().size(); ++i)
    if (site.last(i))
      json["machines"].push_back(
          force_on(site.machines()[i], soil, [&] { return site.cut_geometry(i); }));
  return io::to_text(json);
}

void LiveForces::compute(GroundCopy& beside, std::function<void(std::string)> done) {
  if (busy_.exchange(true)) return;
  std::vector<BucketThere> buckets;
  for (std::size_t i = 0; i < site_.machines().size(); ++i)
    if (const std::optional<MachineState> last = site_.last(i))
      buckets.push_back(
          {&site_.machines()[i], last->pose, site_.direction(i), site_.ledger(i).bank_m3()});
  beside.run([this, number = ++made_, soil = strength_of(site_),
              swell = site_.earthmoving().soil->swell, buckets = std::move(buckets),
              done = std::move(done)] {
    if (!heights_) heights_.emplace(copy_);
    Json json = message_of(0);
    json["number"] = number;
    for (const BucketThere& there : buckets)
      json["machines"].push_back(force_on(*there.machine, soil, [&] {
        return CutGeometry(*heights_, copy_, there.machine->bucket, there.world_from_bucket,
                           there.way, there.load_m3, swell);
      }));
    done(io::to_text(json));
    busy_ = false;
  });
}

}  // namespace soilvdb::tools
