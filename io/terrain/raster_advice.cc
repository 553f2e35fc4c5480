// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/raster_advice.h"

#include <fmt/format.h>

#include <utility>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

namespace fs = std::filesystem;

fs::path beside(fs::path file, const std::string& suffix) {
  return file.replace_filename(file.stem().string() + suffix);
}

/// A raster with all voids marked, and the commands that make it.
struct View {
  fs::path file;
  std::string commands;  ///< with a separator for the next command
};

/// The file itself if it marks all voids, else a view of the first band.
View view_of(const KeptHeights& kept, const fs::path& file) {
  std::string options;
  const std::vector<double>& voids = kept.unnamed_voids;
  if (kept.alpha_band != 0) options = fmt::format("-mask {}", kept.alpha_band);
  if (!voids.empty()) options = fmt::format("-a_nodata {}", voids[0]);
  if (options.empty()) return {file, ""};
  View view{beside(file, "_view.vrt"), ""};
  view.commands = fmt::format("gdal_translate -of VRT -b 1 {} {} {} && ", options,
                              shell_quoted(file), shell_quoted(view.file));
  for (std::size_t i = 1; i < voids.size(); ++i) {
    const fs::path next = beside(file, fmt::format("_view{}.vrt", i + 1));
    view.commands += fmt::format("gdalbuildvrt -overwrite -srcnodata {} -vrtnodata {} {} {} && ",
                                 voids[i], voids[0], shell_quoted(next), shell_quoted(view.file));
    view.file = next;
  }
  return view;
}

const char* gdal_type(const KeptHeights& kept) { return kept.wide ? "Float64" : "Float32"; }

}  // namespace

std::string translate_command(const fs::path& file, const std::string& options,
                              const std::string& suffix) {
  return fmt::format("gdal_translate --config GDAL_TIFF_INTERNAL_MASK YES {}{}{} {}", options,
                     options.empty() ? "" : " ", shell_quoted(file),
                     shell_quoted(beside(file, suffix + ".tif")));
}

RasterAdvice::RasterAdvice(fs::path file, Kept kept)
    : file_(std::move(file)), kept_(std::move(kept)) {}

std::string RasterAdvice::to_metres(double metres, const std::string& horizontal) const {
  const KeptHeights kept = kept_(metres);
  const View view = view_of(kept, file_);
  // Two distant values, because gdal_translate takes the scale from their difference.
  const double span = kept.offset == 0 ? 1 : 1e6, zero_m = kept.offset * metres;
  std::string options = fmt::format("-b 1 -ot {} -scale 0 {} {} {}", gdal_type(kept), span, zero_m,
                                    zero_m + span * kept.scale * metres);
  if (kept.scale != 1 || kept.offset != 0) options += " -a_scale 1 -a_offset 0";
  if (kept.nodata || !kept.unnamed_voids.empty()) options += " -a_nodata nan";  // no height is NaN
  if (!horizontal.empty()) options += " -a_srs " + horizontal;
  return fmt::format("{}gdal_translate{} {} {} {}", view.commands,
                     kept.masked ? " --config GDAL_TIFF_INTERNAL_MASK YES" : "", options,
                     shell_quoted(view.file), shell_quoted(beside(file_, "_m.tif")));
}

RasterAdvice RasterAdvice::in_metres() const {
  return {beside(file_, "_m.tif"), [wide = kept_(1).wide](double) {
            KeptHeights kept;
            kept.wide = wide;
            return kept;
          }};
}

std::string RasterAdvice::warp(const std::string& options, const std::string& suffix) const {
  const KeptHeights kept = kept_(1);
  const View view = view_of(kept, file_);
  // Without NODATA gdalwarp fills the area outside the source with 0.
  return fmt::format("{}gdalwarp {}{}-r bilinear -ot {} -dstnodata nan {} {}", view.commands,
                     options, options.empty() ? "" : " ", gdal_type(kept), shell_quoted(view.file),
                     shell_quoted(beside(file_, suffix + ".tif")));
}

std::string RasterAdvice::reproject(int epsg, const std::string& source) const {
  return warp(fmt::format("{}-t_srs EPSG:{} -novshift",
                          source.empty() ? "" : "-s_srs " + source + " ", epsg),
              "_utm");
}

}  // namespace soilvdb::inline v0::io
