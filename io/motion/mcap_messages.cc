// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/mcap_messages.h"

#include <fmt/format.h>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

RosTime read_time(CdrReader& cdr) {
  RosTime time;
  time.sec = cdr.number<std::int32_t>();
  time.nanosec = cdr.number<std::uint32_t>();
  return time;
}

}  // namespace

std::string RosTime::text() const {
  const std::int64_t all = ns(), size = all < 0 ? -all : all;
  return fmt::format("{}{}.{:09}", all < 0 ? "-" : "", size / kNsPerS, size % kNsPerS);
}

double RosTime::seconds() const { return *parse_number(text()); }

void read_message(std::string_view bytes, JointStateMessage& message) {
  CdrReader cdr(bytes);
  message.stamp = read_time(cdr);
  cdr.text();  // frame
  message.names.resize(cdr.count(sizeof(std::uint32_t)));
  for (std::string_view& name : message.names) name = cdr.text();
  message.positions.resize(cdr.count(sizeof(double)));
  for (double& position : message.positions) position = cdr.number<double>();
}

void read_message(std::string_view bytes, PoseMessage& message) {
  CdrReader cdr(bytes);
  message.stamp = read_time(cdr);
  cdr.text();
  for (double& value : message.values) value = cdr.number<double>();
}

void read_message(std::string_view bytes, std::vector<TransformMessage>& transforms) {
  constexpr std::size_t kLeastBytes = 8 + 2 * sizeof(std::uint32_t) + 7 * sizeof(double);
  CdrReader cdr(bytes);
  transforms.resize(cdr.count(kLeastBytes));
  for (TransformMessage& transform : transforms) {
    transform.stamp = read_time(cdr);
    transform.parent = cdr.text();
    transform.child = cdr.text();
    for (double& value : transform.values) value = cdr.number<double>();
  }
}

}  // namespace soilvdb::inline v0::io
