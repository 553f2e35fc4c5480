// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Text of files never reaches a function like printf as its format, here through the program as a
// whole; <kind>_directives does the same for each reader.
#include "tests/support/directives.h"

#include <gtest/gtest.h>

#include "tests/support/program.h"

namespace soilvdb::test {
namespace directives_test {

const std::string kName = "%s%n%s%n%99999$s";

const std::string kMachine = R"(<robot name="%s">
  <material name="grey"><color rgba="0.5 %s%s%s%n%s%s 0.5 1"/></material>
  <link name="base"/><link name="%s%n%s%n%99999$s"/>
  <joint name="%s%n%s%n%99999$s" type="prismatic">
    <parent link="base"/><child link="%s%n%s%n%99999$s"/><origin xyz="1.5 1.5 0" rpy="0 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
</robot>
)";

class Directives : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / (kName + ".urdf"), kMachine);
    write_file(folder() / (kName + ".csv"), "time," + kName + "\n0,0.2\n1,-0.3\n2,0.2\n");
    std::string heights = "ncols 8\nnrows 8\nxllcorner 0\nyllcorner 0\ncellsize 0.5\n";
    for (int i = 0; i < 64; ++i) heights += i % 8 == 7 ? "0\n" : "0 ";
    write_file(folder() / (kName + ".asc"), heights);
    write_file(folder() / (kName + ".prj"),
               "LOCAL_CS[\"" + kName + "\",UNIT[\"metre\",1,AUTHORITY[\"%s%n\",\"%s%n\"]]]");
    write_file(folder() / (kName + ".asc.aux.xml"),
               "<PAMDataset><Metadata><MDI key=\"%s%n\">%s%n%s</MDI></Metadata></PAMDataset>");
    write_file(folder() / "dig.yaml",
               "soilvdb: 1\nname: '" + kName + "'\nvoxel_size: 0.05\nterrain: {raster: '" + kName +
                   ".asc'}\nmachines:\n  - name: '" + kName +
                   "'\n    bucket: {width: 0.5, height: 0.5}\n    motion: '" + kName +
                   ".csv'\n    urdf: '" + kName + ".urdf'\n    lip: {link: '" + kName +
                   "', rpy: [0, -1.5, 0]}\noutput: {mesh: glb, raster: {cell: 0.5}}\n");
  }

  /// Done or refused, in so many words: nothing else may come of an input.
  void expect_no_crash(const std::string& arguments) const {
    const Result result = run(arguments);
    EXPECT_GE(result.status, 0) << arguments;
    EXPECT_LE(result.status, 2) << arguments << ": " << result.err;
  }
};

TEST_F(Directives, AreNamesLikeOthers) {
  const Result dig = run("run dig.yaml --out '" + kName + "'");
  ASSERT_EQ(dig.status, 0) << dig.err;
  EXPECT_NE(dig.out.find(kName), std::string::npos) << dig.out;
  const auto summary = read_json(folder() / kName / "summary.json");
  EXPECT_EQ(summary["machines"][0]["name"], kName);
  EXPECT_GT(summary["volume_m3"]["cut"], 0.05);
  for (const std::string command :
       {"verify 'O'", "resume 'O'", "info 'O/soil_final.vdb'", "info dig.yaml", "info 'N.asc'",
        "export 'O/soil_final.vdb' --to 'O/N.png'", "export 'O/soil_final.vdb' --to 'O/N.vdb'",
        "diff 'O/soil_final.vdb' 'O/soil_final.vdb'"}) {
    std::string named = command;
    for (std::size_t at = 0; (at = named.find_first_of("ON", at)) != named.npos; at += kName.size())
      named.replace(at, 1, kName);
    const Result result = run(named);
    EXPECT_EQ(result.status, 0) << named << ": " << result.err;
  }
}

TEST_F(Directives, InMessagesAreSaidAsTheyStand) {
  for (const auto& [file, content] : std::map<std::string, std::string>{
           {kName + ".urdf", "<robot><%s%n%s/><link name=\"%s%n\"/></robot>"},
           {kName + ".csv", "time," + kName + "\n0,%s%n%s\n1,-0.3\n"},
           {kName + ".asc", "ncols %s%n%s\nnrows 8\n"}}) {
    const std::string good = read_file(folder() / file);
    write_file(folder() / file, content);
    expect_refused("run dig.yaml --out o", "%s%n%s");
    write_file(folder() / file, good);
  }
  expect_refused("run '%s%n%s.yaml'", "%s%n%s.yaml");
  expect_refused("run dig.yaml --'%s%n%s' 1", "%s%n%s");
}

TEST_F(Directives, InTheHeadOfALevelSetAreRefusedOrRead) {
  ASSERT_EQ(run("run dig.yaml --out o").status, 0);
  ASSERT_EQ(run("export o/soil_final.vdb --to closed.vdb --region 1,1,2,2").status, 0);
  const std::string closed = read_file(folder() / "closed.vdb");
  const std::size_t head = 600;  // the file's and the grid's metadata; trees have no text
  const auto read = [&](const std::string& text) {
    write_file(folder() / "closed.vdb", text + closed.substr(head));
    expect_no_crash("info closed.vdb");
  };
  test::with_directives(closed.substr(0, head), read, 4);
}

}  // namespace directives_test
}  // namespace soilvdb::test
