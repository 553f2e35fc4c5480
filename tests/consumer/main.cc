// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Another project's program: drags a bucket 1 m wide through flat ground, 0.2 m deep, for 2 m, by a
// tracker, by a site without files and by a session.
#include <soilvdb/session.h>
#include <soilvdb/site.h>
#include <soilvdb/tracker.h>

#include <cstdio>
#include <memory>

int main() {
  const soilvdb::Bucket bucket = {.width_m = 1.0, .height_m = 0.5};
  soilvdb::Ground ground(0.05, {0, 0, 0}, soilvdb::make_plane(0, {0, 0}));
  soilvdb::Tracker tracker(ground, {bucket});
  soilvdb::Site site(std::make_shared<soilvdb::Ground>(0.05, soilvdb::Vec3::Zero(),
                                                       soilvdb::make_plane(0, {0, 0})),
                     {{{"digger", bucket}}});
  soilvdb::Session session({.voxel_size_m = 0.05, .machines = {{"digger", bucket}}});
  double load_m3 = 0;
  for (int i = 0; i <= 20; ++i) {
    const soilvdb::Pose world_from_bucket{{0.1 * i, 0, -0.2}};
    load_m3 = tracker.update(0, world_from_bucket).bucket_m3;
    if (site.update({.pose = world_from_bucket}).update.bucket_m3 != load_m3) return 1;
    if (session.update({.pose = world_from_bucket}).update.bucket_m3 != load_m3) return 1;
  }
  std::printf("load %.3f m3\n", load_m3);
}
