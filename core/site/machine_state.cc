// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine as bytes and back. Numbers as they are in memory: little-endian on all that we run on.
#include <cstring>
#include <stdexcept>
#include <type_traits>

#include "core/site/machine.h"

namespace soilvdb::inline v0 {
namespace {

template <typename T>
requires std::is_arithmetic_v<T>
void put(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof(value));
}
void put(std::string& out, const Pose& pose) {
  for (const double v : pose.position) put(out, v);
  for (const double v : pose.rotation.coeffs()) put(out, v);
}

template <typename T>
requires std::is_arithmetic_v<T>
void take(std::string_view& in, T& value) {
  if (in.size() < sizeof(value)) throw std::invalid_argument("the state ends too early");
  std::memcpy(&value, in.data(), sizeof(value));
  in.remove_prefix(sizeof(value));
}
void take(std::string_view& in, bool& value) {
  std::uint8_t byte = 0;
  take(in, byte);
  value = byte != 0;
}
void take(std::string_view& in, Pose& pose) {
  for (double& v : pose.position) take(in, v);
  for (double& v : pose.rotation.coeffs()) take(in, v);
}

}  // namespace

void Machine::save(std::string& out) const {
  put(out, bucket_.width_m);
  put(out, bucket_.height_m);
  put(out, std::uint64_t{bucket_.profile.size()});
  put(out, ledger_.captured);
  put(out, ledger_.displaced);
  put(out, ledger_.dumped);
  put(out, placed_);
  put(out, current_);
}

void Machine::load(std::string_view& in) {
  double width = 0, height = 0;
  std::uint64_t count = 0;
  take(in, width);
  take(in, height);
  take(in, count);
  if (width != bucket_.width_m || height != bucket_.height_m || count != bucket_.profile.size())
    throw std::invalid_argument("the state is of another bucket");
  take(in, ledger_.captured);
  take(in, ledger_.displaced);
  take(in, ledger_.dumped);
  take(in, placed_);
  take(in, current_);
}

}  // namespace soilvdb::inline v0
