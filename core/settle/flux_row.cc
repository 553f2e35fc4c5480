// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/flux_row.h"

#include <algorithm>
#include <cstring>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/lanes.h"

namespace soilvdb::inline v0 {
namespace {

SOILVDB_INLINE void store(float* to, Lanes v) { std::memcpy(to, &v, sizeof(v)); }

SOILVDB_INLINE bool any(LaneMask mask) {
  using Quarters = std::uint64_t __attribute__((vector_size(sizeof(LaneMask))));
  const Quarters q = reinterpret_cast<Quarters>(mask);
  return (q[0] | q[1] | q[2] | q[3]) != 0;
}

/// Drops from eight columns to their neighbours, in the order of FluxRow::out, and squares of those
/// that go down.
struct Drops {
  Lanes by[4], down2[4];
};

SOILVDB_INLINE Drops drops(const FluxRow& r, int x) {
  Drops d;
  const Lanes top = lanes_at(r.top + x);
  const std::ptrdiff_t to[4] = {1, -1, r.stride, -r.stride};
  for (int n = 0; n < 4; ++n) {
    d.by[n] = top - lanes_at(r.top + x + to[n]);
    const Lanes down = max(d.by[n], Lanes{});
    d.down2[n] = down * down;
  }
  return d;
}

/// What columns have to give down a quadrant, as a drop: what lies on support that is steeper than
/// repose goes the quicker the more it is.
SOILVDB_INLINE Lanes spare(const FluxRow& r, int x, int t) {
  const Lanes held = max(lanes_at(r.brink[t & 1] + x), lanes_at(r.brink[2 + (t >> 1)] + x));
  return kDrainFactor * (lanes_at(r.depth + x) - held);
}

/// Steps a quadrant's pair of fluxes. @return the drop that is allowed: repose, or what there is
/// less what is to go, so that soil on steep support goes and the support stays
SOILVDB_INLINE Lanes step(const FluxRow& r, const Drops& d, int column, int t, Lanes& x, Lanes& y) {
  const int nx = t & 1, ny = 2 + (t >> 1);
  const Lanes steep2 = d.down2[nx] + d.down2[ny], limit = all_lanes(r.limit);
  Lanes allowed = limit;
  if (any(steep2 > limit * limit)) allowed = max(limit, sqrt(steep2) - spare(r, column, t));
  x = max(x + kFluxStep * d.by[nx], Lanes{});
  y = max(y + kFluxStep * d.by[ny], Lanes{});
  const Lanes size = sqrt(x * x + y * y);  // 0: less than nothing is kept
  const Lanes keep = max(1 - kFluxStep * allowed / size, Lanes{});
  x *= keep;
  y *= keep;
  return allowed;
}

/// Flags of eight columns and of those beside them, in one.
SOILVDB_INLINE int any_near(const std::uint8_t* flags, const FluxRow& r, int x) {
  const std::uint8_t* here = flags + x / kChunkSide;
  const std::ptrdiff_t above = r.stride / kChunkSide;
  return here[0] | here[-1] | here[1] | here[-above] | here[above];
}

/// Nothing flows nor will: most columns, most of the time.
SOILVDB_INLINE bool at_rest(const FluxRow& r, const Drops& d, int x) {
  if (r.flows[x / kChunkSide] > 1) return false;
  const Lanes steepest2 = max(d.down2[0], d.down2[1]) + max(d.down2[2], d.down2[3]);
  return !any(steepest2 > r.limit * r.limit);
}

/// Steps quadrant `t` of eight columns. @return whether anything flows in it
template <int t>
SOILVDB_INLINE bool push_lanes(const FluxRow& r, const Drops& d, int x, float momentum,
                               Lanes& uphill, Lanes* out) {
  constexpr int kAlong[2] = {t & 1, 2 + (t >> 1)};
  float* const flux[2] = {r.flux[2 * t] + x, r.flux[2 * t + 1] + x};
  float* const ahead[2] = {r.ahead[2 * t] + x, r.ahead[2 * t + 1] + x};
  const Lanes was[2] = {lanes_at(flux[0]), lanes_at(flux[1])};
  const Lanes from[2] = {lanes_at(ahead[0]), lanes_at(ahead[1])};
  const LaneMask flowed = (was[0] != 0) | (was[1] != 0) | (from[0] != 0) | (from[1] != 0);
  // Surely less steep than what would start to flow.
  const Lanes steep2 = d.down2[kAlong[0]] + d.down2[kAlong[1]];
  if (!any(flowed | (steep2 > kStillShare * r.limit * r.limit))) return false;
  Lanes to[2] = {from[0], from[1]};
  // What slides down steep support goes one way only: momentum would let it run away.
  const Lanes allowed = step(r, d, x, t, to[0], to[1]);
  LaneMask flows = {};
  for (int c = 0; c < 2; ++c) {
    const Lanes change = to[c] - was[c];
    const Lanes next = to[c] + (allowed > r.limit ? Lanes{} : momentum * change);
    uphill += (from[c] - to[c]) * change;
    store(flux[c], to[c]);
    store(ahead[c], next);
    flows |= (to[c] != 0) | (next != 0);
    out[kAlong[c]] += next;
  }
  return any(flows);
}

}  // namespace

SOILVDB_FOR_CPUS void push(const FluxRow& r, float momentum, float uphill_by[kChunkSide]) {
  Lanes uphill{};
  for (int x = 0; x < r.columns; x += kChunkSide) {
    if (r.awake[x / kChunkSide] == 0) continue;
    std::uint8_t& flows = r.flows[x / kChunkSide];
    if ((flows | any_near(r.moved, r, x)) == 0) continue;
    const Drops d = drops(r, x);
    if (at_rest(r, d, x)) {
      flows = 0;
      continue;
    }
    Lanes out[4] = {};
    bool any_flows = push_lanes<0>(r, d, x, momentum, uphill, out);
    any_flows |= push_lanes<1>(r, d, x, momentum, uphill, out);
    any_flows |= push_lanes<2>(r, d, x, momentum, uphill, out);
    any_flows |= push_lanes<3>(r, d, x, momentum, uphill, out);
    for (int n = 0; n < 4; ++n) store(r.out[n] + x, out[n]);
    flows = any_flows ? 2 : 1;
  }
  store(uphill_by, uphill);
}

// Sums of two and of two such: grids that are mirrored or turned have the same bits.
SOILVDB_FOR_CPUS void settle(const FluxRow& r) {
  const float shrunk = 1 - 1 / r.swell;
  for (int x = 0; x < r.columns; x += kChunkSide) {
    const bool moves = any_near(r.flows, r, x) != 0;
    r.moved[x / kChunkSide] = moves;
    if (!moves) continue;
    const Lanes out = (lanes_at(r.out[0] + x) + lanes_at(r.out[1] + x)) +
                      (lanes_at(r.out[2] + x) + lanes_at(r.out[3] + x));
    const Lanes in = (lanes_at(r.out[0] + x - 1) + lanes_at(r.out[1] + x + 1)) +
                     (lanes_at(r.out[2] + x - r.stride) + lanes_at(r.out[3] + x + r.stride));
    const Lanes soil = lanes_at(r.soil + x) + (in - out);
    const Lanes depth = soil - shrunk * min(soil, lanes_at(r.bank + x));
    store(r.depth + x, depth);
    store(r.top + x, lanes_at(r.base + x) + depth);
  }
}

SOILVDB_FOR_CPUS Unrest unrest(const FluxRow& r) {
  Lanes steep{}, off{}, hollow{};
  for (int x = 0; x < r.columns; x += kChunkSide) {
    if (r.awake[x / kChunkSide] == 0) continue;
    const Drops d = drops(r, x);
    if (at_rest(r, d, x)) continue;  // and no less deep than at first
    const Lanes lack = -lanes_at(r.depth + x);
    hollow = max(hollow, lanes_at(r.soil + x) < 0 ? Lanes{} : lack);
    for (int t = 0; t < 4; ++t) {
      const Lanes from[2] = {lanes_at(r.flux[2 * t] + x), lanes_at(r.flux[2 * t + 1] + x)};
      Lanes to[2] = {from[0], from[1]};
      const LaneMask slides = step(r, d, x, t, to[0], to[1]) > r.limit;
      const Lanes beyond = sqrt(d.down2[t & 1] + d.down2[2 + (t >> 1)]) - r.limit;
      steep = max(steep, min(beyond, spare(r, x, t) - kDrainFactor * kFilmDepth));
      for (int c = 0; c < 2; ++c) off = max(off, slides ? Lanes{} : abs(to[c] - from[c]));
    }
  }
  return {largest(steep), largest(off) / kFluxStep, largest(hollow)};
}

}  // namespace soilvdb::inline v0
