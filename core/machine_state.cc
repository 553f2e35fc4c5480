// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine as bytes and back. Numbers as they are in memory: little-endian on all that we run on.
#include <cstring>
#include <stdexcept>
#include <type_traits>

#include "core/machine.h"

namespace soilvdb {
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
void put(std::string& out, const Corners& corners) {
  for (const Vec3& corner : corners) {
    for (const double v : corner) put(out, v);
  }
}
void put(std::string& out, const Coord3& c) {
  for (const int v : c) put(out, v);
}
template <typename T>
void put(std::string& out, std::span<const T> values) {
  put(out, std::uint64_t{values.size()});
  for (const T& value : values) put(out, value);
}
template <typename T>
void put(std::string& out, const std::vector<T>& values) {
  put(out, std::span<const T>(values));
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
void take(std::string_view& in, Corners& corners) {
  for (Vec3& corner : corners) {
    for (double& v : corner) take(in, v);
  }
}
void take(std::string_view& in, Coord3& c) {
  for (int& v : c) take(in, v);
}
template <typename T>
void take(std::string_view& in, std::vector<T>& values) {
  std::uint64_t size = 0;
  take(in, size);
  if (size > in.size()) throw std::invalid_argument("the state ends too early");
  values.resize(size);
  for (T& value : values) take(in, value);
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
  put(out, kept_);
  put(out, between_);
  put(out, std::uint64_t{fresh_});
  put(out, begins_);
  put(out, mouth_cut_);
  put(out, body_cut_);
  put(out, mouth_stood_);
  put(out, moved_m_);
  put(out, carving_.has_value());
  if (carving_) {
    put(out, carved_.path);
    put(out, std::uint64_t{carved_.fresh});
    put(out, carved_.begins);
    put(out, carved_.mouth);
    put(out, carved_.body);
    put(out, carving_->pending());
    put(out, std::uint64_t{carving_chunks_});
  }
  put(out, std::uint64_t{ahead_.size()});
  for (const Before& before : ahead_) {
    put(out, before.origin);
    put(out, before.resident);
    put(out, before.air);
    put(out, static_cast<bool>(before.phi));
    if (before.phi) {
      Phi phi;
      before.phi.expand(phi);
      for (const std::int16_t v : phi) put(out, v);
    }
  }
}

void Machine::load(std::string_view& in, const Soil& soil) {
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
  take(in, kept_);
  take(in, between_);
  at_ = mouth_corners(bucket_, current_);
  if (!kept_.empty()) kept_at_ = mouth_corners(bucket_, kept_.back());
  take(in, count);
  fresh_ = count;
  take(in, begins_);
  take(in, mouth_cut_);
  take(in, body_cut_);
  take(in, mouth_stood_);
  take(in, moved_m_);
  if (fresh_ > kept_.size()) throw std::invalid_argument("the state contradicts itself");
  bool there = false;
  take(in, there);
  if (there) {
    take(in, carved_.path);
    take(in, count);
    carved_.fresh = count;
    take(in, carved_.begins);
    take(in, carved_.mouth);
    take(in, carved_.body);
    std::vector<Coord3> pending;
    take(in, pending);
    take(in, count);
    if (carved_.path.empty() || carved_.fresh >= carved_.path.size())
      throw std::invalid_argument("the state contradicts itself");
    carving_.emplace(
        soil, bucket_,
        SweepWindow{carved_.path, carved_.fresh, carved_.begins, carved_.mouth, carved_.body},
        std::move(pending));
    carving_chunks_ = count;
  }
  take(in, count);
  for (std::uint64_t i = 0; i < count; ++i) {
    Before& before = ahead_.emplace_back();
    take(in, before.origin);
    take(in, before.resident);
    take(in, before.air);
    take(in, there);
    if (!there) continue;
    Phi phi;
    for (std::int16_t& v : phi) take(in, v);
    before.phi.assign(phi);
  }
}

}  // namespace soilvdb
