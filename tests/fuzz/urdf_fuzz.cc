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
      const Pose pose = chain.world_from_bucket(std::vector<double>(chain.movable().size(), 0.5));
      fuzz::require(pose.rotation.coeffs().allFinite(), "the bucket has a direction");
    } catch (const std::invalid_argument& no_such_link) {
      fuzz::check_message(no_such_link);
    }
  });
  return 0;
}
