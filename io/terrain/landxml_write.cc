// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "io/file/atomic_file.h"
#include "io/file/text.h"
#include "io/terrain/crs.h"
#include "io/terrain/tin.h"
#include "soilvdb/version.h"

namespace soilvdb::inline v0::io {
namespace {

/// Text of an attribute.
std::string xml_quoted(std::string_view text) {
  return '"' + markup_text(one_line(std::string(text), ' ')) + '"';
}

}  // namespace

void write_landxml(const std::filesystem::path& file, const HeightGrid& grid,
                   const std::vector<float>& heights, const std::string& name,
                   const std::string& crs_wkt) {
  const auto at = [&](int i, int j) {
    return std::size_t(j) * std::size_t(grid.nx) + std::size_t(i);
  };
  const std::time_t now = std::time(nullptr);
  std::string text = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<LandXML xmlns=\"http://www.landxml.org/schema/LandXML-1.2\" version=\"1.2\" "
      "date=\"{0:%Y-%m-%d}\" time=\"{0:%H:%M:%S}\" language=\"English\" readOnly=\"false\">\n"
      "<Units><Metric areaUnit=\"squareMeter\" linearUnit=\"meter\" volumeUnit=\"cubicMeter\" "
      "temperatureUnit=\"celsius\" pressureUnit=\"HPA\"/></Units>\n",
      fmt::gmtime(now));
  auto out = std::back_inserter(text);
  if (!crs_wkt.empty()) {
    const std::string label = crs_label(crs_wkt), code = label.substr(label.find(':') + 1);
    text += "<CoordinateSystem desc=" + xml_quoted(label);
    if (label == "EPSG:" + code) text += " epsgCode=" + xml_quoted(code);
    text += " ogcWktCode=" + xml_quoted(crs_wkt) + "/>\n";
  }
  text += "<Application name=\"soilvdb\" version=" + xml_quoted(SOILVDB_VERSION) + "/>\n";
  text +=
      "<Surfaces><Surface name=" + xml_quoted(name) + "><Definition surfType=\"TIN\">\n<Pnts>\n";
  std::vector<std::uint32_t> ids(heights.size());  // 0: no height
  std::uint32_t points = 0;
  for (int j = 0; j < grid.ny; ++j) {
    for (int i = 0; i < grid.nx; ++i) {
      const float z = heights[at(i, j)];
      if (std::isnan(z)) continue;
      ids[at(i, j)] = ++points;
      fmt::format_to(out, "<P id=\"{}\">{:.5f} {:.5f} {:.5f}</P>\n", points,
                     grid.first.y() + j * grid.spacing.y(), grid.first.x() + i * grid.spacing.x(),
                     z);
    }
  }
  text += "</Pnts>\n<Faces>\n";
  const auto face = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (a != 0 && b != 0 && c != 0) fmt::format_to(out, "<F>{} {} {}</F>\n", a, b, c);
  };
  for (int j = 0; j + 1 < grid.ny; ++j) {
    for (int i = 0; i + 1 < grid.nx; ++i) {
      const std::size_t a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
      // All diagonals go the same way, so each post stands for as much area: the volume of the
      // surface is that of the ledger. Another way leaves a triangle where a corner has no height.
      if (ids[a] != 0 && ids[c] != 0) {
        face(ids[a], ids[b], ids[c]);
        face(ids[a], ids[c], ids[d]);
      } else {
        face(ids[a], ids[b], ids[d]);
        face(ids[b], ids[c], ids[d]);
      }
    }
  }
  text += "</Faces>\n</Definition></Surface></Surfaces>\n</LandXML>\n";
  write_atomically(file, text);
}

}  // namespace soilvdb::inline v0::io
