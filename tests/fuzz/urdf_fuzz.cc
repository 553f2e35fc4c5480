// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Machines, by the chain to a link named bucket.
#include "soilvdb/io/urdf.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  const auto file = folder.write("machine.urdf", fuzz::text(data, size));
  fuzz::expect_read_or_refused([&] {
    try {
      const Chain chain = io::read_chain(file, "bucket");
      const std::vector<double> values(chain.movable().size(), 0.5);
      const Pose pose = chain.world_from_bucket(values);
      fuzz::require(pose.rotation.coeffs().allFinite(), "the bucket has a direction");
      for (const PlacedBoxes& body : chain.placed_bodies(values))
        for (const auto& box : body.boxes_m)
          fuzz::require(!box.isEmpty() && (body.world_from_boxes * box.center()).allFinite(),
                        "a link's shape is somewhere");
    } catch (const std::invalid_argument& no_such_link) {
      fuzz::check_message(no_such_link);
    }
  });
  return 0;
}
