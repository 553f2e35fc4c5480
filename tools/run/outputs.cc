// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/outputs.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include "io/file/text.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/raster.h"
#include "tools/run/text.h"

namespace soilvdb::tools {

namespace fs = std::filesystem;

namespace {

constexpr double kLeastSide_m = 1e-3, kMostSide_m = 1e6;  // of a region

/// Adds a band of sigmas, and one of what scans and surveys saw.
void add_sigmas(const HeightGrid& grid, const Sigmas& sigmas, std::vector<io::RasterBand>& bands) {
  constexpr int kStrip = 64;  // rows that are asked for at once
  std::vector<Vec2> places;
  std::vector<double> sigmas_m, seen;
  io::RasterBand sigma{"sigma", {}}, surveyed{"surveyed", {}, ""};
  for (int low = 0; low < grid.ny; low += kStrip) {
    places.clear();
    for (int y = low; y < std::min(low + kStrip, grid.ny); ++y)
      for (int x = 0; x < grid.nx; ++x)
        places.emplace_back(grid.first + grid.spacing.cwiseProduct(Vec2(x, y)));
    sigmas_m.resize(places.size());
    seen.resize(places.size());
    sigmas(places, sigmas_m, seen);
    sigma.values.insert(sigma.values.end(), sigmas_m.begin(), sigmas_m.end());
    surveyed.values.insert(surveyed.values.end(), seen.begin(), seen.end());
  }
  bands.push_back(std::move(sigma));
  bands.push_back(std::move(surveyed));
}

}  // namespace

Eigen::AlignedBox2d parse_region(const std::string& text) {
  const auto refuse = [&](const char* why) -> io::InputError {
    return io::InputError(
        fmt::format("--region {}: {}; right is XMIN,YMIN,XMAX,YMAX in the "
                    "site's metres, such as 10,20,30.5,40",
                    io::printable(text), why));
  };
  std::vector<double> numbers;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    const auto value = io::parse_number(std::string_view(text).substr(begin, end - begin));
    if (!value || !std::isfinite(*value)) throw refuse("not four numbers");
    numbers.push_back(*value);
    begin = end + 1;
  }
  if (numbers.size() != 4) throw refuse("not four numbers");
  if (!(numbers[0] < numbers[2]) || !(numbers[1] < numbers[3]))
    throw refuse("XMIN must be below XMAX and YMIN below YMAX");
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double side_m = numbers[axis + 2] - numbers[axis];
    if (!(side_m >= kLeastSide_m && side_m <= kMostSide_m))
      throw refuse("its sides must be from 1 mm to 1000 km");
  }
  return {Vec2(numbers[0], numbers[1]), Vec2(numbers[2], numbers[3])};
}

double affordable_cell_m(const Eigen::AlignedBox2d& box, double cell_m, double most_cells) {
  const auto cells = [&](double cell) {
    return (box.sizes().x() / cell + 1) * (box.sizes().y() / cell + 1);
  };
  if (cells(cell_m) <= most_cells) return cell_m;
  for (double power = std::pow(10, std::floor(std::log10(cell_m)));; power *= 10)
    for (const double digit : {1, 2, 5})
      if (digit * power >= cell_m && cells(digit * power) <= most_cells) return digit * power;
}

void write_surface_raster(const fs::path& file, const Ground& ground,
                          const Eigen::AlignedBox2d& box, double cell_m, const std::string& crs_wkt,
                          const Sigmas& sigmas) {
  const double cells = box.sizes().x() / cell_m * (box.sizes().y() / cell_m);
  if (cells > io::kMostRasterCells)
    throw std::runtime_error(fmt::format(
        "{}: cells of {} m would be {:.2g} over the dug ground, "
        "which is too many; cells of {} m would do",
        file.string(), length_text(cell_m), cells, length_text(affordable_cell_m(box, cell_m))));
  io::SurfaceRaster raster = io::rasterise(ground, box, cell_m);
  std::vector<io::RasterBand> bands = {{"surface", std::move(raster.surface)},
                                       {"change", std::move(raster.change)}};
  if (sigmas) add_sigmas(raster.grid, sigmas, bands);
  io::write_geotiff(file, raster.grid, bands, crs_wkt);
}

void check_output(const fs::path& to, const fs::path& input) {
  std::error_code error;
  if (fs::equivalent(to, input, error))
    throw io::InputError(to, "is the input and would be written over; name another file");
  if (fs::is_directory(to, error)) throw io::InputError(to, "is a folder; name a file in it");
  const fs::path folder = to.has_parent_path() ? to.parent_path() : fs::path(".");
  if (!fs::is_directory(folder, error))
    throw io::InputError(to,
                         fmt::format("there is no folder '{}'; make it first", folder.string()));
  if (access(folder.c_str(), W_OK | X_OK) != 0)
    throw io::InputError(
        to, fmt::format("the folder '{}' can't be written to; name another file", folder.string()));
}

}  // namespace soilvdb::tools
