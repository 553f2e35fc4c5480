// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scenarios, beside a motion and a machine that they may refer to.
#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  static const bool ready = [] {
    folder.write("motion.csv", "time,x,y,z,turn\n0,0,0,0,0\n1,1,0,-0.2,0.5\n");
    folder.write("hills.tif", "");
    folder.write("joints.csv", "time,turn\n0,0\n1,0.5\n");
    folder.write("machine.urdf", R"(<robot name="m"><link name="a"/><link name="b"/>
        <joint name="turn" type="continuous"><parent link="a"/><child link="b"/></joint></robot>)");
    return true;
  }();
  static_cast<void>(ready);
  const auto file = folder.write("scenario.yaml", fuzz::text(data, size));
  fuzz::expect_read_or_refused([&] {
    const io::Scenario scenario = io::read_scenario(file);
    fuzz::require(
        scenario.voxel_size_m > 0 && !(scenario.machines.empty() && scenario.pours.empty()),
        "a usable scenario");
    // Are the pours and machines on it?
    if (std::holds_alternative<io::PlaneTerrain>(scenario.terrain)) io::open_site(scenario);
  });
  return 0;
}
