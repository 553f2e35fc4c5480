// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// MCAP files as motions by joints, poses and transforms: read whole, and in parts, which must have
// the same rows.
#include <algorithm>
#include <memory>

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

void read(const io::MotionSource& source, const std::optional<Chain>& chain) {
  fuzz::expect_read_or_refused([&] {
    const Motion whole = io::read_motion(source, chain).motion;
    const std::vector<double>& times = whole.times_s();
    for (const std::size_t i : {std::size_t{0}, times.size() / 2, times.size() - 1}) {
      const Pose pose = whole.row(i);
      fuzz::require(pose.position.allFinite() && pose.rotation.coeffs().allFinite(),
                    "every pose is finite");
    }
    io::MotionReader reader(source, chain);
    io::RowMark middle;
    std::size_t seen = 0, at_middle = 0;
    while (true) {
      if (seen <= times.size() / 2) {
        middle = reader.mark();
        at_middle = seen;
      }
      const Motion part = reader.next(3);
      if (part.times_s().size() == 1) break;
      fuzz::require(std::equal(part.times_s().begin(), part.times_s().end(),
                               times.begin() + static_cast<std::ptrdiff_t>(seen)),
                    "parts have the whole's rows");
      seen += part.times_s().size() - 1;
    }
    fuzz::require(seen + 1 == times.size(), "parts make up the whole");
    io::MotionReader again(reader.source(), chain);
    again.go_to(middle);
    fuzz::require(again.next(3).begin_s() == times[at_middle], "a mark leads back to its row");
  });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  static const Chain chain = two_joints();
  const auto file = folder.write("motion.mcap", fuzz::text(data, size));
  read({file, {"/j"}}, chain);
  for (const io::McapTopic& base : {io::McapTopic{"/p"}, io::McapTopic{"/tf", "base", "map"}}) {
    io::MotionSource drives(file, {"/j"});
    drives.mcap.base = std::make_shared<io::McapTopic>(base);
    read(drives, chain);
  }
  read({file, {"/p"}}, std::nullopt);
  read({file, {"/tf", "lip"}}, std::nullopt);
  read({file, {"/tf", "lip", "base"}}, std::nullopt);
  return 0;
}
