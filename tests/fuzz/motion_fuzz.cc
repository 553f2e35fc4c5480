// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Motions by poses and by joints: read whole, and in parts, which must have the same rows.
#include "soilvdb/io/motion_csv.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

namespace {

Chain two_joints() {
  Chain chain;
  chain.joints = {{"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -1, 1},
                  {"stick", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 2}};
  return chain;
}

void read(const std::filesystem::path& file, const std::optional<Chain>& chain) {
  fuzz::expect_read_or_refused([&] {
    const Motion whole = io::read_motion(file, chain).motion;
    const std::size_t rows = whole.times_s().size();
    for (const std::size_t i : {std::size_t{0}, rows / 2, rows - 1}) {
      const Pose pose = whole.row(i);
      fuzz::require(pose.position.allFinite() && pose.rotation.coeffs().allFinite(),
                    "every pose is finite");
    }
    io::MotionReader reader(file, chain);
    std::size_t seen = 0;
    for (Motion part = reader.next(3); part.times_s().size() > 1; part = reader.next(3)) {
      for (std::size_t i = 0; i < part.times_s().size(); ++i)
        fuzz::require(part.times_s()[i] == whole.times_s()[seen + i],
                      "parts have the whole's rows");
      seen += part.times_s().size() - 1;
    }
    fuzz::require(seen + 1 == rows, "parts make up the whole");
  });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  static const Chain chain = two_joints();
  const auto file = folder.write("motion.csv", fuzz::text(data, size));
  read(file, std::nullopt);
  read(file, chain);
  return 0;
}
