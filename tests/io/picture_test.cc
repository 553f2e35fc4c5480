// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/picture.h"

#include <cairo/cairo.h>
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "io/draw/map_parts.h"
#include "io/draw/relief.h"
#include "soilvdb/tracker.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace picture_test {

using test::TempFolder;

/// A PNG as a viewer would show it.
class Picture {
 public:
  explicit Picture(const std::filesystem::path& file)
      : surface_(cairo_image_surface_create_from_png(file.c_str()), cairo_surface_destroy) {
    EXPECT_EQ(cairo_surface_status(surface_.get()), CAIRO_STATUS_SUCCESS) << file;
    cairo_surface_flush(surface_.get());
  }
  int width() const { return cairo_image_surface_get_width(surface_.get()); }
  int height() const { return cairo_image_surface_get_height(surface_.get()); }
  /// Red, green, blue in [0, 255].
  Vec3 at(int x, int y) const {
    const unsigned char* p = cairo_image_surface_get_data(surface_.get()) +
                             y * cairo_image_surface_get_stride(surface_.get()) + 4 * x;
    return {static_cast<double>(p[2]), static_cast<double>(p[1]), static_cast<double>(p[0])};
  }
  /// How much more colour than grey: the earth's tones have little, the depth's have much.
  double vividness(int x, int y) const { return at(x, y).maxCoeff() - at(x, y).minCoeff(); }
  int vivid_pixels(int y0, int y1) const {
    int n = 0;
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < width(); ++x) n += vividness(x, y) > 100 ? 1 : 0;
    }
    return n;
  }

 private:
  std::unique_ptr<cairo_surface_t, void (*)(cairo_surface_t*)> surface_;
};

std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

Ground plane_site(double slope = 0) {
  return Ground(0.05, Vec3::Zero(), make_plane(0, {slope, 0}));
}

/// A trench 2 m long along x through `middle`, 0.6 m wide, 0.4 m deep.
void dig(Ground& ground, const Vec3& middle) {
  Bucket bucket;
  bucket.width_m = 0.6;
  bucket.height_m = 1;
  Tracker tracker(ground, {bucket});
  for (const double x : {-1.0, 1.0}) {
    tracker.update(0, Pose{middle + Vec3(x, 0, -0.4), Eigen::Quaterniond::Identity()});
  }
}

/// The frame of a plan is its longest dark run of pixels: rows and columns found as a reader would.
Eigen::AlignedBox2i frame_of(const Picture& picture) {
  Eigen::AlignedBox2i frame;
  const auto dark = [&](int x, int y) { return picture.at(x, y).maxCoeff() < 110; };
  for (int y = 0; y < picture.height(); ++y) {
    int run = 0;
    for (int x = 0; x < picture.width(); ++x) {
      run = dark(x, y) ? run + 1 : 0;
      if (run < picture.width() / 4) continue;
      frame.extend(Eigen::Vector2i(x, y));
      frame.extend(Eigen::Vector2i(x - run + 1, y));
    }
  }
  return frame;
}

const Caption kCaption{"A site", "cut 0.48 m³, 5 cm voxels"};

TEST(RegionOfInterest, HoldsTheCutWithAMargin) {
  Ground ground = plane_site();
  dig(ground, {5, 3, 0});
  const Eigen::AlignedBox2d box = region_of_interest(ground);
  EXPECT_TRUE(box.contains(Eigen::AlignedBox2d(Vec2(3.7, 2.4), Vec2(6.3, 3.6))));
  EXPECT_LT(box.sizes().maxCoeff(), 6);
}

TEST(RegionOfInterest, IsTheSurroundingsOfTheOriginWhereNothingIsResident) {
  const Ground ground(0.05, {583000, 4431000, 100}, make_plane(0, {0, 0}));
  const Eigen::AlignedBox2d box = region_of_interest(ground);
  EXPECT_EQ(box.center(), Vec2(583000, 4431000));
  EXPECT_EQ(box.sizes(), Vec2(20, 20));
}

TEST(Plan, ShowsTheCutWhereItIsAndNowhereElse) {
  const TempFolder folder;
  Ground ground = plane_site();
  dig(ground, {0, 0.5, 0});
  const Eigen::AlignedBox2d box(Vec2(-2, -2), Vec2(2, 2));
  write_plan(folder / "plan.png", ground, box, kCaption);
  const Picture picture(folder / "plan.png");
  const Eigen::AlignedBox2i frame = frame_of(picture);
  const double px = frame.sizes().x() / 4.0;
  EXPECT_NEAR(frame.sizes().y() / 4.0, px, 1) << "a square site is a square";
  EXPECT_GT(frame.sizes().x(), 800);
  const auto vivid = [&](double x, double y) {
    return picture.vividness(frame.min().x() + static_cast<int>((x + 2) * px),
                             frame.min().y() + static_cast<int>((2 - y) * px)) > 100;
  };
  // Two voxels off the rim, in and out.
  for (double x = -1.95; x < 2; x += 0.1) {
    for (double y = -1.95; y < 2; y += 0.1) {
      const bool inside = std::abs(x) < 0.9 && std::abs(y - 0.5) < 0.2;
      const bool outside = std::abs(x) > 1.1 || std::abs(y - 0.5) > 0.4;
      if (inside || outside) {
        EXPECT_EQ(vivid(x, y), inside) << x << ", " << y;
      }
    }
  }
}

/// A heap of 0.3 m^3 beside a trench.
Ground& dig_and_pour(Ground& ground) {
  dig(ground, {0, 1, 0});
  Earthmoving earthmoving;
  earthmoving.soil =
      SoilProperties{.repose_rad = 0.6, .swell = 0, .cohesion_pa = {}, .friction_rad = {}};
  earthmoving.pours.push_back({"heap", {0, -0.8, 1}, 0, 0, 0.3});
  Tracker(ground, {}, earthmoving).pour(0, 0);
  return ground;
}

TEST(Plan, ShowsCutInRedFillInBlueAndLooseSoilAsClods) {
  const TempFolder folder;
  Ground ground = plane_site();
  write_plan(folder / "plan.png", dig_and_pour(ground), {Vec2(-2, -2), Vec2(2, 2)}, kCaption);
  const Picture picture(folder / "plan.png");
  const Eigen::AlignedBox2i frame = frame_of(picture);
  const double px = frame.sizes().x() / 4.0;
  const auto at = [&](double x, double y) {
    return picture.at(frame.min().x() + static_cast<int>((x + 2) * px),
                      frame.min().y() + static_cast<int>((2 - y) * px));
  };
  // Between the grid's lines. Neighbouring pixels of clods differ; those of a floor hardly do.
  double roughest_floor = 0, roughest_heap = 0;
  for (double u = 0.06; u < 0.2; u += 0.01) {
    const Vec3 floor = at(u, 1.06), heap = at(u, -0.74), untouched = at(u + 1.5, 0.06);
    EXPECT_GT(floor.x(), floor.z() + 40) << "red where it was cut";
    EXPECT_GT(heap.z(), heap.x() + 40) << "blue where it was filled";
    EXPECT_GT(untouched.x(), untouched.z()) << "earth's own colour where it wasn't touched";
    EXPECT_LT(untouched.maxCoeff() - untouched.minCoeff(), 60);
    const auto rough = [&](double x, double y) { return (at(x + 0.01, y) - at(x, y)).norm(); };
    roughest_floor = std::max(roughest_floor, rough(u, 1.06));
    roughest_heap = std::max(roughest_heap, rough(u, -0.74));
  }
  EXPECT_GT(roughest_heap, 5 * std::max(1.0, roughest_floor));
}

TEST(CutAndFill, IsTheNetOfColumns) {
  Ground ground = plane_site();
  const CutAndFill change = cut_and_fill(dig_and_pour(ground));
  const double kTrench_m3 = 2 * 0.6 * 0.4, kSample_m3 = ground.sample_m3();
  EXPECT_NEAR(change.cut_m3, kTrench_m3, 0.01 * kTrench_m3);
  EXPECT_NEAR(change.fill_m3, 0.3, kSample_m3);
  EXPECT_NEAR(change.fill_m3 - change.cut_m3, ground.change_m3(), 1e-9);
}

TEST(ChangeScale, IsAboutAsLightForFillAsForCutAndAsBeforeWithoutFill) {
  const ChangeScale both = ChangeScale::up_to(2, 1, 0.01), cut = ChangeScale::up_to(2, 0, 0.01);
  const auto luma = [](const Rgb& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; };
  double before = 1;
  for (double m = 0.05; m < 2; m += 0.05) {
    const Rgb red = both.color(m), blue = both.color(-m);
    EXPECT_GT(red.r, red.b) << m;
    EXPECT_GT(blue.b, blue.r) << m;
    EXPECT_NEAR(luma(red), luma(blue), 0.15) << m;
    EXPECT_LT(luma(red), before);
    before = luma(red);
  }
  EXPECT_NEAR(cut.color(2).b, 0.631, 1e-9) << "violet";
}

TEST(Plan, IsTheSameBytesWithOneAndTwoThreads) {
  const TempFolder folder;
  Ground ground = plane_site(0.1);
  dig(ground, {0, 0, 0});
  for (const int threads : {1, 2}) {
    tbb::task_arena(threads).execute([&] {
      write_plan(folder / ("plan" + std::to_string(threads)), ground, region_of_interest(ground),
                 kCaption);
    });
  }
  EXPECT_EQ(bytes_of(folder / "plan1"), bytes_of(folder / "plan2"));
}

/// Hills in memory, with a corner that is not known.
struct Hills : HeightSource {
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int j = y0; j < y0 + ny; ++j) {
      for (int i = x0; i < x0 + nx; ++i) {
        *out++ = i > 80 && j > 80 ? std::numeric_limits<float>::quiet_NaN()
                                  : 300 + 8 * std::sin(static_cast<float>(i) / 9) *
                                              std::cos(static_cast<float>(j) / 12);
      }
    }
  }
};

TEST(Plan, IsDrawnOfAnySizeAndShape) {
  const TempFolder folder;
  const HeightGrid grid{101, 101, {583000, 4431000}, {10, 10}};
  const Ground ground(0.05, {583000, 4431000, 0},
                      make_height_field(grid, std::make_shared<Hills>()));
  const Vec2 low(583000, 4431000);
  for (const Vec2& size :
       {Vec2(1000, 1000), Vec2(1000, 30), Vec2(20, 1000), Vec2(0.01, 0.01), Vec2(1400, 1400)}) {
    write_plan(folder / "plan.png", ground, {low, low + size}, kCaption);
    const Picture picture(folder / "plan.png");
    EXPECT_GE(picture.width(), 760) << size;
    EXPECT_LE(picture.width(), 1600) << size;
    EXPECT_LE(picture.height(), 1300) << size;
    EXPECT_EQ(picture.vivid_pixels(0, picture.height()), 0) << size << ": nothing was cut";
  }
}

TEST(View, ShowsTheCutInItsDepthsColoursTheSameWithOneAndTwoThreads) {
  const TempFolder folder;
  Ground ground = plane_site();
  dig(ground, {0, 0, 0});
  for (const int threads : {1, 2}) {
    tbb::task_arena(threads).execute([&] {
      write_view(folder / ("view" + std::to_string(threads)), ground, {Vec2(-2, -2), Vec2(2, 2)},
                 kCaption);
    });
  }
  EXPECT_EQ(bytes_of(folder / "view1"), bytes_of(folder / "view2"));
  const Picture picture(folder / "view2");
  EXPECT_EQ(picture.width(), 1600);
  // The trench is 7.5 % of the site, which fills about half of the picture.
  constexpr int kLegendHeight = 90;
  const int vivid = picture.vivid_pixels(0, picture.height() - kLegendHeight);
  EXPECT_GT(vivid, picture.width() * picture.height() / 100);
  EXPECT_LT(vivid, picture.width() * picture.height() / 10);
}

TEST(View, IsDrawnOfASiteFarLargerThanItsVoxelsAndOfOneWithoutGround) {
  const TempFolder folder;
  const HeightGrid grid{101, 101, {583000, 4431000}, {10, 10}};
  const Ground ground(0.05, {583000, 4431000, 0},
                      make_height_field(grid, std::make_shared<Hills>()));
  const Vec2 low(583000, 4431000);
  write_view(folder / "site.png", ground, {low, low + Vec2(1000, 1000)}, kCaption);
  const Picture site(folder / "site.png");
  EXPECT_EQ(site.width(), 1600);
  EXPECT_EQ(site.vivid_pixels(0, site.height()), 0) << "nothing was cut";
  const Vec2 corner = low + Vec2(900, 900);
  write_view(folder / "rim.png", ground, {corner - Vec2(105, 5), corner}, kCaption);
  EXPECT_EQ(Picture(folder / "rim.png").width(), 1600);
  write_view(folder / "none.png", ground, {corner, corner + Vec2(10, 10)}, kCaption);
  EXPECT_EQ(Picture(folder / "none.png").width(), 1600);
}

TEST(Shade, IsThatOfGroundTurnedHalfRoundAndUpsideDown) {
  Relief ground{.nx = 40, .ny = 30, .box = {Vec2(0, 0), Vec2(40, 30)}, .height = {}, .depth = {}};
  std::mt19937 random(1);
  for (int i = 0; i < ground.nx * ground.ny; ++i)
    ground.height.push_back(static_cast<float>(random() % 2000) / 1000);
  ground.depth.assign(ground.height.size(), 0);
  Relief turned = ground;
  std::reverse(turned.height.begin(), turned.height.end());
  for (float& height : turned.height) height = -height;
  const PlanStyle style{.voxel_size_m = 8, .scale = {}};
  std::vector<std::uint32_t> pixels = shade(turned, style);
  std::reverse(pixels.begin(), pixels.end());
  EXPECT_EQ(pixels, shade(ground, style));
}

TEST(Picture, NamesTheFileThatCantBeWritten) {
  const TempFolder folder;
  const Ground ground = plane_site();
  const Eigen::AlignedBox2d box(Vec2(-1, -1), Vec2(1, 1));
  EXPECT_NE(message_of(folder, [&] { write_plan(folder / "no/plan.png", ground, box, kCaption); })
                .find("no/plan.png"),
            std::string::npos);
  EXPECT_THROW(write_plan(folder / "no/plan.png", ground, box, kCaption), std::runtime_error);
}

TEST(Picture, RefusesARegionWithoutArea) {
  const TempFolder folder;
  const Ground ground = plane_site();
  EXPECT_THROW(write_plan(folder / "plan.png", ground, Eigen::AlignedBox2d(), kCaption),
               std::invalid_argument);
  EXPECT_THROW(write_view(folder / "view.png", ground, Eigen::AlignedBox2d(), kCaption),
               std::invalid_argument);
  EXPECT_FALSE(std::filesystem::exists(folder / "plan.png"));
}

TEST(Picture, TakesAnyBytesAsCaption) {
  const TempFolder folder;
  const Ground ground = plane_site();
  const Caption odd{"\xff\xfe\n" + std::string(500, 'W') + "\xc3",
                    std::string("\xed\xa0\x80\0x", 5)};
  write_plan(folder / "plan.png", ground, {Vec2(-1, -1), Vec2(1, 1)}, odd);
  EXPECT_GT(Picture(folder / "plan.png").width(), 0);
}

TEST(Number, HasTheDecimalsOfItsStep) {
  EXPECT_EQ(number(0.3, 0.1), "0.3");
  EXPECT_EQ(number(100.025, 0.025), "100.025");
  EXPECT_EQ(number(-0.0001, 0.5), "0.0");
  EXPECT_EQ(number(-2, 1), "\u22122");
  EXPECT_EQ(number(4431000, 200), "4\u2009431\u2009000");
  EXPECT_EQ(number(1234, 1), "1234");
}

TEST(RoundDown125, GivesOneTwoOrFiveTimesAPowerOfTen) {
  EXPECT_DOUBLE_EQ(round_down_125(0.19), 0.1);
  EXPECT_DOUBLE_EQ(round_down_125(0.2), 0.2);
  EXPECT_DOUBLE_EQ(round_down_125(7), 5);
  EXPECT_DOUBLE_EQ(round_down_125(1000), 1000);
}

TEST(ChangeScale, EndsOnTicksNotAboveTheDeepestAndTheHighest) {
  for (const double deepest : {0.0, 0.013, 0.25, 0.99, 1.01, 7.3, 42.0}) {
    for (const double highest : {0.0, 0.3, 2.0}) {
      const ChangeScale scale = ChangeScale::up_to(deepest, highest, 0.001);
      for (const auto& [end, most] : {std::pair(scale.cut_m, deepest), {scale.fill_m, highest}}) {
        EXPECT_GE(end, most * (1 - 1e-5));
        if (most == 0) {
          EXPECT_EQ(end, 0);
          continue;
        }
        EXPECT_LT(end - scale.tick_m, most);
        const double ticks = end / scale.tick_m;
        EXPECT_NEAR(ticks, std::round(ticks), 1e-9);
      }
    }
  }
  EXPECT_TRUE(ChangeScale::up_to(0.001, 0.005, 0.01).empty());
}

}  // namespace picture_test
}  // namespace soilvdb::io
