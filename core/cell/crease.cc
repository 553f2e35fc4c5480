// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cell/crease.h"

#include <bit>

#include "core/cell/plane_mask.h"
#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kCells = 27, kOwn = 13;

using Mask = std::uint64_t;
using Masks = Mask[kCells];

SOILVDB_INLINE Mask joined(BooleanOp op, Mask a, Mask b, Mask c) {
  switch (op) {
    case BooleanOp::kOne:
      return a;
    case BooleanOp::kAnd:
      return a & b;
    case BooleanOp::kOr:
      return a | b;
    case BooleanOp::kAndAnd:
      return a & b & c;
    case BooleanOp::kOrOr:
      return a | b | c;
    case BooleanOp::kAndOr:
      return (a & b) | c;
    case BooleanOp::kOrAnd:
      return (a | b) & c;
  }
  return a;
}

/// Number of samples that a model has wrong, up to `most`.
template <BooleanOp op>
SOILVDB_INLINE int score(const Masks& words, const Masks& a, const Masks& b, const Masks& c,
                         int most) {
  int sum = kPlaneCost * planes_of(op) +
            std::popcount(joined(op, a[kOwn], b[kOwn], c[kOwn]) ^ words[kOwn]);
  for (int k = 0; k < kCells && sum < most; ++k) {
    if (k == kOwn) continue;
    const int wrong = std::popcount(joined(op, a[k], b[k], c[k]) ^ words[k]) - kFreeNeighbourWrong;
    sum += std::min(std::max(wrong, 0), kMaxNeighbourWrong);
  }
  return sum;
}

struct Best {
  int score = 1 << 20;
  BooleanOp op = BooleanOp::kOne;
  int plane[3] = {0, 0, 0};
};

template <BooleanOp op>
SOILVDB_INLINE void attempt(const Masks& words, const Masks* masks, int a, int b, int c,
                            Best& best) {
  const int s = score<op>(words, masks[a], masks[b], masks[c], best.score);
  if (s < best.score) best = {s, op, {a, b, c}};
}

struct Window {
  const CellPoints* points[kCells];
  Masks words;
};

SOILVDB_INLINE void make_masks(const Window& window, const CellPlane& plane, Masks& masks) {
  const float half_range = plane.half_range() + kCellFaceMargin;
  for (int k = 0; k < kCells; ++k) {
    const CellPlane here = plane.from(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1);
    masks[k] = here.d >= half_range    ? ~Mask{0}
               : here.d <= -half_range ? 0
                                       : plane_mask(*window.points[k], here);
  }
}

/// The samples that a combination of masks has wrong.
SOILVDB_INLINE int score_of(BooleanOp op, const Masks& words, const Masks* m) {
  const int planes = planes_of(op);
  const Masks &a = m[0], &b = m[planes > 1 ? 1 : 0], &c = m[planes > 2 ? 2 : 0];
  constexpr int kAny = 1 << 20;
  switch (op) {
    case BooleanOp::kOne:
      return score<BooleanOp::kOne>(words, a, b, c, kAny);
    case BooleanOp::kAnd:
      return score<BooleanOp::kAnd>(words, a, b, c, kAny);
    case BooleanOp::kOr:
      return score<BooleanOp::kOr>(words, a, b, c, kAny);
    case BooleanOp::kAndAnd:
      return score<BooleanOp::kAndAnd>(words, a, b, c, kAny);
    case BooleanOp::kOrOr:
      return score<BooleanOp::kOrOr>(words, a, b, c, kAny);
    case BooleanOp::kAndOr:
      return score<BooleanOp::kAndOr>(words, a, b, c, kAny);
    case BooleanOp::kOrAnd:
      return score<BooleanOp::kOrAnd>(words, a, b, c, kAny);
  }
  return kAny;
}

/// One Gauss-Newton step of all planes together.
SOILVDB_INLINE CellModel refitted(const CellModel& model, const Masks* masks,
                                  const Window& window) {
  struct Sums {
    float more = 0, x = 0, y = 0, z = 0;  // of wrong samples: soil less air, and its moments
    float a[6] = {0, 0, 0, 0, 0, 0};
  } sums[3];
  const int planes = model.planes();
  const float half_range[3] = {model.plane[0].half_range(), model.plane[1].half_range(),
                               model.plane[2].half_range()};
  const Tangents tangents[3] = {Tangents(model.plane[0]), Tangents(model.plane[1]),
                                Tangents(model.plane[2])};
  for (int k = 0; k < kCells; ++k) {
    const float x = static_cast<float>(k / 9 - 1), y = static_cast<float>(k / 3 % 3 - 1),
                z = static_cast<float>(k % 3 - 1);
    bool near = false;
    for (int p = 0; p < planes; ++p) {
      const CellPlane& plane = model.plane[p];
      const float s = plane.signed_distance(x, y, z);
      if (std::abs(s) >= half_range[p]) continue;
      near = true;
      const float fx = x - s * plane.nx, fy = y - s * plane.ny, fz = z - s * plane.nz;
      if (model.at(fx, fy, fz).plane != p) continue;
      const Tangents& t = tangents[p];
      const float u = t.u[0] * fx + (t.u[1] * fy + t.u[2] * fz);
      const float v = t.v[0] * fx + (t.v[1] * fy + t.v[2] * fz);
      Sums& sum = sums[p];
      sum.a[0] += 1;
      sum.a[1] += u;
      sum.a[2] += v;
      sum.a[3] += u * u;
      sum.a[4] += u * v;
      sum.a[5] += v * v;
    }
    if (!near) continue;
    const Mask all =
        joined(model.op, masks[0][k], planes > 1 ? masks[1][k] : 0, planes > 2 ? masks[2][k] : 0);
    Mask wrong = all ^ window.words[k];
    if (std::popcount(wrong) > kMaxNeighbourWrong) continue;  // of another surface
    for (; wrong != 0; wrong &= wrong - 1) {
      const int i = std::countr_zero(wrong);
      const CellPoints& points = *window.points[k];
      const float px = x + points.x[i] - 0.5f, py = y + points.y[i] - 0.5f,
                  pz = z + points.z[i] - 0.5f;
      const ActivePlane active = model.at(px, py, pz);
      if (std::abs(active.signed_distance) > kCreaseFitReach) continue;
      const float sign = window.words[k] >> i & 1 ? 1.0f : -1.0f;
      Sums& sum = sums[active.plane];
      sum.more += sign;
      sum.x += sign * px;
      sum.y += sign * py;
      sum.z += sign * pz;
    }
  }
  CellModel moved = model;
  for (int p = 0; p < planes; ++p) {
    float* const a = sums[p].a;
    const Tangents& t = tangents[p];
    const auto along = [&](const float* e) {
      return e[0] * sums[p].x + (e[1] * sums[p].y + e[2] * sums[p].z);
    };
    const float b[3] = {sums[p].more, along(t.u), along(t.v)};
    a[0] += kShiftStiffness;
    a[3] += kTiltStiffness;
    a[5] += kTiltStiffness;
    displace(moved.plane[p], t, a, b, kMaxCreaseFitStep);
  }
  return moved;
}

SOILVDB_FOR_CPUS void solve(const Window& window, std::span<const CellPlane> planes,
                            CellModel& model) {
  const int n = static_cast<int>(planes.size());
  Masks masks[kMaxCandidates];
  for (int p = 0; p < n; ++p) make_masks(window, planes[static_cast<std::size_t>(p)], masks[p]);
  Best best;
  const Masks& words = window.words;
  for (int a = 0; a < n; ++a) attempt<BooleanOp::kOne>(words, masks, a, a, a, best);
  for (int a = 0; a < n; ++a) {
    for (int b = a + 1; b < n; ++b) {
      attempt<BooleanOp::kAnd>(words, masks, a, b, a, best);
      attempt<BooleanOp::kOr>(words, masks, a, b, a, best);
    }
  }
  if (best.score - kPlaneCost * planes_of(best.op) > kGoodPairWrong) {
    for (int a = 0; a < n; ++a) {
      for (int b = a + 1; b < n; ++b) {
        for (int c = b + 1; c < n; ++c) {
          attempt<BooleanOp::kAndAnd>(words, masks, a, b, c, best);
          attempt<BooleanOp::kOrOr>(words, masks, a, b, c, best);
          attempt<BooleanOp::kAndOr>(words, masks, a, b, c, best);
          attempt<BooleanOp::kAndOr>(words, masks, a, c, b, best);
          attempt<BooleanOp::kAndOr>(words, masks, b, c, a, best);
          attempt<BooleanOp::kOrAnd>(words, masks, a, b, c, best);
          attempt<BooleanOp::kOrAnd>(words, masks, a, c, b, best);
          attempt<BooleanOp::kOrAnd>(words, masks, b, c, a, best);
        }
      }
    }
  }
  model.op = best.op;
  Masks fitted[2][3];
  for (int p = 0; p < 3; ++p) {
    model.plane[p] = planes[static_cast<std::size_t>(best.plane[p])];
    std::copy_n(masks[best.plane[p]], kCells, fitted[0][p]);
  }
  for (int k = 0; k < kCreaseFitSteps; ++k) {
    const CellModel moved = refitted(model, fitted[k & 1], window);
    Masks* const then = fitted[1 - (k & 1)];
    for (int p = 0; p < moved.planes(); ++p) make_masks(window, moved.plane[p], then[p]);
    const int s = score_of(moved.op, words, then);
    if (s > best.score) break;
    best.score = s;
    model = moved;
  }
  model.wrong = best.score - kPlaneCost * planes_of(best.op);
  model.solved = best.score < kUnsolvedScore;
}

}  // namespace

void Candidates::add(const CellPlane& plane) {
  if (full() || std::abs(plane.d) > plane.half_range() + kCandidateReach) return;
  for (int k = 0; k < size_; ++k) {
    const CellPlane& other = planes_[k];
    if (plane.along(other.nx, other.ny, other.nz) > kSamePlaneCosine &&
        std::abs(plane.d - other.d) < kSamePlaneGap) {
      return;
    }
  }
  planes_[size_++] = plane;
}

CellModel solve_crease(const CellGrid& grid, int id, const Candidates& candidates) {
  CellModel model;
  if (candidates.planes().empty()) return model;
  Window window;
  for (int k = 0; k < kCells; ++k) {
    const int at = grid.beside(id, k);
    window.words[k] = grid.word(at);
    window.points[k] = &grid.points(at);
  }
  solve(window, candidates.planes(), model);
  return model;
}

}  // namespace soilvdb::inline v0
