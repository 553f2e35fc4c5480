// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Another project's program: drags a bucket 1 m wide through flat ground, 0.2 m deep, for 2 m.
#include <soilvdb/tracker.h>

#include <cstdio>

int main() {
  soilvdb::Soil soil(0.05, {0, 0, 0}, soilvdb::make_plane(0, {0, 0}));
  soilvdb::Tracker tracker(soil, {{.width_m = 1.0, .height_m = 0.5}});
  double load_m3 = 0;
  for (int i = 0; i <= 20; ++i)
    load_m3 = tracker.update(0, soilvdb::Pose{{0.1 * i, 0, -0.2}}).bucket_m3;
  std::printf("load %.3f m3\n", load_m3);
}
