// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a scenario says of soil that moves, of pours and hoppers, and the one line about each slip.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "soilvdb/io/raster.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "tests/support/program.h"
#include "tests/support/scenario_fixture.h"
#include "tests/support/site_fixture.h"

namespace soilvdb::io {
namespace earthmoving_input_test {

const std::string kHead = "soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0}}\n";
const std::string kSoil = "soil: {repose_angle: 0.61}\n";
const std::string kPour = "pours: [{name: truck, at: [5, 0, 3], time: [0, 2], volume: 1}]\n";
const std::string kDigger =
    "machines: [{name: digger, bucket: {width: 1, height: 1}, motion: m.csv}]\n";

class Earthmoving : public ScenarioFile {
 protected:
  std::string soil(const std::string& keys) {
    return error_of(kHead + "soil: {" + keys + "}\n" + kPour);
  }
  std::string pours(const std::string& items) {
    return error_of(kHead + kSoil + "pours:\n" + items);
  }
  std::string hoppers(const std::string& items) {
    return error_of(kHead + kSoil + kPour + "hoppers:\n" + items);
  }
};

TEST_F(Earthmoving, EverythingInItIsRead) {
  const Scenario s = read(kHead +
                          "soil:\n  repose_angle: 0.61\n  swell: 0.25\n  density: 1900\n"
                          "  cohesion: 10000\n  friction_angle: 0.5\n" +
                          kDigger +
                          "pours:\n"
                          "  - {name: truck, at: [5.0, 0.5, 3.0], time: [1, 2], volume: 1.5}\n"
                          "  - {name: chute, at: [6, 0, 3], time: [4, 4], volume: 2}\n"
                          "hoppers:\n"
                          "  - {name: truck, box: [8, -1.5, 13, 1.5], top: 2.0, time: [0, 600]}\n"
                          "  - {name: crusher, box: [13, -2, 14, 2], top: 1}\n");
  ASSERT_TRUE(s.soil);
  EXPECT_EQ(s.soil->repose_rad, 0.61);
  EXPECT_EQ(s.soil->swell, 0.25);
  EXPECT_EQ(s.soil->density_kg_m3, 1900);
  EXPECT_EQ(s.soil->cohesion_pa, 10000);
  EXPECT_EQ(s.soil->friction_rad, 0.5);
  ASSERT_EQ(s.pours.size(), 2u);
  EXPECT_EQ(s.pours[0].name, "truck");
  EXPECT_EQ(s.pours[0].at_m, Vec3(5, 0.5, 3));
  EXPECT_EQ(s.pours[0].begin_s, 1);
  EXPECT_EQ(s.pours[0].end_s, 2);
  EXPECT_EQ(s.pours[0].volume_m3, 1.5);
  EXPECT_EQ(s.pours[1].end_s, s.pours[1].begin_s) << "all at once";
  ASSERT_EQ(s.hoppers.size(), 2u);
  EXPECT_EQ(s.hoppers[0].name, "truck") << "brings and takes";
  EXPECT_EQ(s.hoppers[0].box_m.min(), Vec2(8, -1.5));
  EXPECT_EQ(s.hoppers[0].box_m.max(), Vec2(13, 1.5));
  EXPECT_EQ(s.hoppers[0].top_m, 2);
  EXPECT_EQ(s.hoppers[0].begin_s, 0);
  EXPECT_EQ(s.hoppers[0].end_s, 600);
  EXPECT_TRUE(std::isinf(s.hoppers[1].begin_s) && std::isinf(s.hoppers[1].end_s));
  ASSERT_EQ(s.warnings.size(), 1u);
  EXPECT_NE(s.warnings[0].find("never dumps"), std::string::npos);
}

TEST_F(Earthmoving, WhatIsOptionalMayBeLeftOut) {
  const Scenario s = read(kHead + kSoil + kPour);
  EXPECT_EQ(s.soil->swell, 0);
  EXPECT_EQ(s.soil->density_kg_m3, 1800);
  EXPECT_FALSE(s.soil->cohesion_pa || s.soil->friction_rad);
  EXPECT_TRUE(s.machines.empty() && s.hoppers.empty());
  const Scenario rigid = read(kHead + kDigger);
  EXPECT_FALSE(rigid.soil);
  EXPECT_TRUE(rigid.pours.empty() && rigid.hoppers.empty());
}

TEST_F(Earthmoving, SomethingMustHappen) {
  EXPECT_EQ(error_of(kHead + kSoil), "s.yaml:1: key 'machines' is missing in scenario");
  EXPECT_EQ(error_of(kHead + kSoil + "machines: []\n" + kPour),
            "s.yaml:5: machines is empty; it must be a list of at least one machine");
}

TEST_F(Earthmoving, UnknownAndMissingKeys) {
  EXPECT_EQ(soil("repose: 0.6"),
            "s.yaml:4: unknown key 'repose' in soil; did you mean 'repose_angle'? Its keys are "
            "repose_angle, swell, density, cohesion, friction_angle, tool_friction, adhesion");
  EXPECT_EQ(soil("swell: 0.2"), "s.yaml:4: key 'repose_angle' is missing in soil");
  EXPECT_EQ(pours("- {name: a, at: [0, 0, 1], time: [0, 1], volum: 1}\n"),
            "s.yaml:6: unknown key 'volum' in pour; did you mean 'volume'? Its keys are name, at, "
            "time, volume");
  for (const std::string key : {"name", "at", "time", "volume"}) {
    std::string item = "- {name: a, at: [0, 0, 1], time: [0, 1], volume: 1}\n";
    const std::size_t at = item.find(key + ": ");
    item.erase(at, item.find_first_of(key == "at" || key == "time" ? "]" : ",}", at) - at +
                       (key == "volume" ? 0
                        : key == "name" ? 1
                                        : 2));
    EXPECT_EQ(pours(item), "s.yaml:6: key '" + key + "' is missing in pour");
  }
  EXPECT_EQ(hoppers("- {name: a, box: [0, 0, 1, 1]}\n"),
            "s.yaml:7: key 'top' is missing in hopper");
  EXPECT_EQ(hoppers("- {nam: a}\n"),
            "s.yaml:7: unknown key 'nam' in hopper; did you mean 'name'? Its keys are name, box, "
            "top, time");
  EXPECT_EQ(error_of(kHead + "soils: 3\n"),
            "s.yaml:4: unknown key 'soils' in scenario; did you mean 'soil'? Its keys are soilvdb, "
            "name, voxel_size, terrain, soil, machines, pours, hoppers, sensors, scans, output");
}

TEST_F(Earthmoving, SoilWithoutSense) {
  const std::string at = "s.yaml:4: ";
  EXPECT_EQ(soil("repose_angle: 35"),
            at + "repose_angle is 35; it must be in radians, more than 0 and less than 1.5708: "
                 "35 degrees are 0.611");
  for (const std::string angle : {"0", "-0.6", "1.5707963267948966", "120"}) {
    EXPECT_EQ(soil("repose_angle: " + angle),
              at + "repose_angle is " + angle +
                  "; it must be in radians, more than 0 and less than 1.5708");
  }
  EXPECT_EQ(soil("repose_angle: .nan"), at + "repose_angle is '.nan'; it must be a number");
  EXPECT_EQ(soil("repose_angle: 0.6, swell: 25"),
            at + "swell is 25; it must be loose over bank volume less 1, a share from 0 to 3: 25 "
                 "percent are 0.25");
  EXPECT_EQ(soil("repose_angle: 0.6, swell: -0.1"),
            at + "swell is -0.1; it must be loose over bank volume less 1, a share from 0 to 3");
  EXPECT_EQ(soil("repose_angle: 0.6, density: 0"),
            at + "density is 0 kg/m3; it must be more than 0");
  EXPECT_EQ(soil("repose_angle: 0.6, density: 1800, cohesion: -1"),
            at + "cohesion is -1 Pa; it must be 0 or more");
  EXPECT_EQ(soil("repose_angle: 0.6, cohesion: 10000"),
            at + "'cohesion' needs 'density'; add it, in kg/m3 of bank soil");
  EXPECT_EQ(soil("repose_angle: 0.6, friction_angle: 30"),
            at + "friction_angle is 30; it must be in radians, at least 0 and less than 1.5708: 30 "
                 "degrees are 0.524");
  EXPECT_NO_THROW(read(kHead + "soil: {repose_angle: 0.6, friction_angle: 0}\n" + kPour));
  EXPECT_NO_THROW(read(kHead + "soil: {repose_angle: 0.6, density: 1800, cohesion: 0}\n" + kPour));
}

TEST_F(Earthmoving, SteepSoilIsWarnedOfOnce) {
  const Scenario s = read(kHead + "soil:\n  repose_angle: 1.1\n" + kPour);
  ASSERT_EQ(s.warnings.size(), 1u);
  EXPECT_EQ(s.warnings[0],
            (folder_ / "s.yaml").string() +
                ":5: a repose_angle of 1.1 rad, 63.0 degrees, is steeper than loose soil stands; "
                "most is from 0.44 to 0.79");
}

TEST_F(Earthmoving, ABucketThatNeverDumpsIsWarnedOfOnce) {
  const auto warnings = [&](const std::string& soil, const std::string& keys) {
    return read(kHead + soil + "machines:\n- name: digger\n  motion: m.csv\n  bucket: {width: 1, " +
                "height: 1" + keys + "}\n")
        .warnings;
  };
  EXPECT_EQ(warnings(kSoil, ""),
            std::vector{(folder_ / "s.yaml").string() +
                        ":8: the bucket of 'digger' has neither profile nor dump_angle: it holds "
                        "any amount of soil and never dumps it"});
  EXPECT_TRUE(warnings(kSoil, ", dump_angle: 0.8").empty());
  EXPECT_TRUE(warnings(kSoil, ", profile: [[0, 0], [-0.5, 0.5], [0, 1]]").empty());
  EXPECT_TRUE(warnings("", "").empty()) << "soil that doesn't move is only counted";
}

TEST_F(Earthmoving, PoursAndHoppersNeedSoil) {
  EXPECT_EQ(error_of(kHead + kPour),
            "s.yaml:4: 'pours' are for a scenario with 'soil', which says how it moves; add that, "
            "or remove 'pours'");
  EXPECT_EQ(error_of(kHead + kDigger + "hoppers: [{name: a, box: [0, 0, 1, 1], top: 2}]\n"),
            "s.yaml:5: 'hoppers' are for a scenario with 'soil', which says how it moves; add "
            "that, or remove 'hoppers'");
}

TEST_F(Earthmoving, PoursWithoutSense) {
  EXPECT_EQ(pours("- {name: a, at: [0, 0, 1], time: [0, 1], volume: 0}\n"),
            "s.yaml:6: volume is 0 m3; it must be more than 0");
  EXPECT_EQ(pours("- {name: a, at: [0, 0, 1], time: [2, 1], volume: 1}\n"),
            "s.yaml:6: time is from 2 to 1 s; a pour must not end before it begins");
  EXPECT_EQ(pours("- {name: a, at: [0, 1], time: [0, 1], volume: 1}\n"),
            "s.yaml:6: at is a list of 2; it must be a list of 3 numbers");
  EXPECT_EQ(pours("- {name: a, at: [0, 0, .inf], time: [0, 1], volume: 1}\n"),
            "s.yaml:6: at is '.inf'; it must be a number");
  EXPECT_EQ(error_of(kHead + kSoil + "pours: []\n"),
            "s.yaml:5: pours is empty; it must be a list of at least one pour");
}

TEST_F(Earthmoving, HoppersWithoutSense) {
  EXPECT_EQ(hoppers("- {name: a, box: [13, -1, 8, 1], top: 2}\n"),
            "s.yaml:7: box goes from x 13 to x 8; it must be [xmin, ymin, xmax, ymax], xmin less "
            "than xmax");
  EXPECT_EQ(hoppers("- {name: a, box: [8, 1, 13, 1], top: 2}\n"),
            "s.yaml:7: box goes from y 1 to y 1; it must be [xmin, ymin, xmax, ymax], ymin less "
            "than ymax");
  EXPECT_EQ(hoppers("- {name: a, box: [8, 1, 13, 2], top: 2, time: [3, 3]}\n"),
            "s.yaml:7: time is from 3 to 3 s; a hopper must be gone later than it comes");
}

TEST_F(Earthmoving, HoppersMustBeApartInPlanOrTime) {
  const std::string first = "- {name: a, box: [0, 0, 2, 2], top: 2, time: [0, 10]}\n";
  EXPECT_EQ(hoppers(first + "- {name: b, box: [1, 1, 3, 3], top: 2}\n"),
            "s.yaml:8: hopper 'b' overlaps hopper 'a'; they must be apart in plan, or one gone "
            "when the other comes");
  EXPECT_EQ(hoppers(first + "- {name: b, box: [1, 1, 3, 3], top: 2, time: [10, 12]}\n"),
            "nothing thrown");
  EXPECT_EQ(hoppers(first + "- {name: b, box: [2, 0, 3, 2], top: 2}\n"), "nothing thrown");
}

TEST_F(Earthmoving, NamesAreOfOneMachineOrTruck) {
  const std::string twice = "- {name: a, at: [0, 0, 1], time: [0, 1], volume: 1}\n";
  EXPECT_EQ(pours(twice + twice), "s.yaml:7: pour 'a' is there twice; names must differ");
  EXPECT_EQ(error_of(kHead + kSoil + kDigger +
                     "pours: [{name: digger, at: [0, 0, 1], time: [0, 1], volume: 1}]\n"),
            "s.yaml:6: pour 'digger' has the name of a machine; names must differ");
  EXPECT_EQ(
      error_of(kHead + kSoil + kDigger + "hoppers: [{name: digger, box: [0, 0, 1, 1], top: 1}]\n"),
      "s.yaml:6: hopper 'digger' has the name of a machine; names must differ");
  EXPECT_EQ(hoppers("- {name: truck, box: [0, 0, 1, 1], top: 1}\n"
                    "- {name: truck, box: [5, 0, 6, 1], top: 1}\n"),
            "s.yaml:8: hopper 'truck' is there twice; names must differ");
}

TEST_F(Earthmoving, ABucketWithAProfileMustHoldSomething) {
  const auto of = [&](const std::string& profile) {
    return error_of(kHead + kSoil +
                    "machines:\n- name: digger\n  bucket:\n    width: 1\n"
                    "    height: 0.5\n    profile: " +
                    profile + "\n  motion: m.csv\n");
  };
  const std::string zero =
      "s.yaml:10: profile gives the bucket a capacity of zero; it must enclose an area with the "
      "mouth";
  EXPECT_EQ(of("[[0, 0], [0, 0.25], [0, 0.5]]"), zero);
  EXPECT_EQ(of("[[0, 0], [-1e-12, 0.25], [0, 0.5]]"), zero);
  EXPECT_EQ(of("[[0, 0], [-0.3, 0.25], [0, 0.5]]"), "nothing thrown");
}

TEST_F(Earthmoving, ABlankThatIsMissingAfterAColonIsNamed) {
  const std::string says = "a blank is missing after the colon of ";
  EXPECT_EQ(error(3, "voxel_size:0.05"), "s.yaml:3: is not valid YAML: " + says + "'voxel_size'");
  EXPECT_EQ(error(9, "      width:1.2"), "s.yaml:9: is not valid YAML: " + says + "'width'");
  EXPECT_EQ(error(7, "  - name:digger"), "s.yaml:7: is not valid YAML: " + says + "'name'");
  EXPECT_EQ(error(3, "voxel_size:0.05\n\n# of the ground"),
            "s.yaml:3: is not valid YAML: " + says + "'voxel_size'");
  EXPECT_EQ(error(5, "  plane: {z:2.5}"), "s.yaml:5: " + says + "'z' in plane");
  EXPECT_EQ(error(5, "  plane:{z: 2.5}"), "s.yaml:5: " + says + "'plane' in terrain");
  EXPECT_EQ(error(17, "  raster:{cell: 0.1}"), "s.yaml:17: " + says + "'raster' in output");
  EXPECT_EQ(error_of("soilvdb:1\n"), "s.yaml:1: " + says + "'soilvdb' in scenario");
}

TEST_F(Earthmoving, PoursBeginAboveTheTerrain) {
  const auto of = [&](const std::string& pour, const std::string& rest = "") {
    const Scenario s =
        read(kHead + kSoil + "pours: [{name: truck, " + pour + ", volume: 1}]\n" + rest);
    return refusal(folder_, [&] { open_site(s); });
  };
  EXPECT_EQ(of("at: [5, 0, 0], time: [0, 1]"), "accepted: nothing thrown");
  EXPECT_EQ(of("at: [5, 0, -1], time: [0, 1]"),
            "s.yaml: pour 'truck' at x 5.00, y 0.00, z -1.00 begins underground; the ground there "
            "is at z 0.00, and it must fall from above");
  EXPECT_EQ(of("at: [0.5, 0, -0.1], time: [0, 1]", kDigger).substr(0, 13), "s.yaml: pour ");
  folder_.write("m.csv", "time,x,y,z\n0,0,0,-0.2\n1,1,0,-0.2\n");
  EXPECT_EQ(of("at: [0.5, 0, -0.1], time: [2, 3]", kDigger), "accepted: nothing thrown")
      << "dug by then";
  EXPECT_NE(of("at: [9e8, 0, 1], time: [0, 1]", kDigger).find("can number"), std::string::npos);
}

TEST_F(Earthmoving, PoursAreNoWiderThanWhatIsLookedAt) {
  const auto of = [&](const std::string& volume) {
    const Scenario s = read(kHead + kSoil +
                            "pours: [{name: truck, at: [5, 0, 3], time: [0, 9], "
                            "volume: " +
                            volume + "}]\n");
    return refusal(folder_, [&] { open_site(s); });
  };
  EXPECT_EQ(of("80000"), "accepted: nothing thrown");
  EXPECT_EQ(of("90000"),
            "s.yaml: pour 'truck' of 90000 m3 makes a cone with a radius of 49.7 m; voxels of 0.1 "
            "m can have one of 48.0 m: a voxel_size of 0.11 or more would do");
}

TEST_F(Earthmoving, PoursFallOnTheTerrain) {
  std::vector<float> heights(11 * 11, 10);
  heights[5 * 11 + 5] = std::nanf("");
  write_geotiff(folder_ / "hills.tif", {11, 11, {100, 200}, {1, 1}}, {{"z", heights}}, "");
  const auto of = [&](const std::string& at) {
    const Scenario s = read("soilvdb: 1\nvoxel_size: 0.1\nterrain: {raster: hills.tif}\n" + kSoil +
                            "pours: [{name: truck, at: " + at + ", time: [0, 1], volume: 1}]\n");
    return refusal(folder_, [&] { open_site(s); });
  };
  EXPECT_EQ(of("[102, 203, 11]"), "accepted: nothing thrown");
  EXPECT_EQ(of("[99, 203, 11]"),
            "s.yaml: pour 'truck' at x 99.00, y 203.00, z 11.00 is outside the terrain, which "
            "covers x 100.0 to 110.0, y 200.0 to 210.0; both must be in the same coordinates");
  EXPECT_EQ(of("[105, 205, 11]"),
            "s.yaml: pour 'truck' at x 105.00, y 205.00, z 11.00 falls where the terrain has no "
            "height; a terrain that has one there would do, or another place");
}

using Program = test::ProgramTest;

TEST_F(Program, InfoShowsWhatMovesSoil) {
  test::write_file(folder() / "s.yaml",
                   kHead +
                       "soil: {repose_angle: 0.61, swell: 0.25, density: 1900, cohesion: 1e4}\n" +
                       kPour + "hoppers: [{name: bin, box: [8, -1, 9, 1], top: 2}]\n");
  const std::string out = good("info s.yaml").out;
  for (const std::string line :
       {"soil          repose 0.61 rad (35.0°), swell 0.25, 1900 kg/m³\n",
        "  bank        cohesion 10000 Pa, friction 0.61 rad (35.0°)\n",
        "pour          truck: 1 m³, 0 s to 2 s, at x 5.00, y 0.00, z 3.00 m\n",
        "hopper        bin: x 8.00 to 9.00, y -1.00 to 1.00, rim at z 2.00 m, all the time\n"})
    EXPECT_NE(out.find(line), std::string::npos) << line << out;
}

}  // namespace earthmoving_input_test
}  // namespace soilvdb::io
