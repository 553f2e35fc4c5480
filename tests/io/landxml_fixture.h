// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A LandXML file around what a test puts into it.
#pragma once

#include <string>

namespace soilvdb::test {

inline constexpr const char* kMetric = "<Units><Metric linearUnit='meter'/></Units>";

inline std::string landxml(const std::string& inside, const std::string& head = kMetric) {
  return "<?xml version='1.0'?>\n<LandXML xmlns='http://www.landxml.org/schema/LandXML-1.2' "
         "version='1.2'>\n" +
         head + inside + "</LandXML>\n";
}

}  // namespace soilvdb::test
