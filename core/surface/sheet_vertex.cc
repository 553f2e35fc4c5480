// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface/sheet_vertex.h"

#include <algorithm>
#include <cmath>

#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

/// Eigenvalues and eigenvectors of a symmetric matrix by Jacobi's rotations.
void eigen(float a[3][3], float v[3][3]) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) v[i][j] = i == j ? 1.0f : 0.0f;
  }
  for (int sweep = 0; sweep < kJacobiSweeps; ++sweep) {
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        if (std::abs(a[p][q]) < kMinJacobiEntry) continue;
        const float theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
        const float t =
            (theta < 0 ? -1.0f : 1.0f) / (std::abs(theta) + std::sqrt(theta * theta + 1));
        const float c = 1 / std::sqrt(t * t + 1), s = t * c;
        const auto rotate = [&](float& x, float& y) {
          const float before = x;
          x = c * before - s * y;
          y = s * before + c * y;
        };
        for (int k = 0; k < 3; ++k) rotate(a[k][p], a[k][q]);
        for (int k = 0; k < 3; ++k) rotate(a[p][k], a[q][k]);
        for (int k = 0; k < 3; ++k) rotate(v[k][p], v[k][q]);
      }
    }
  }
}

}  // namespace

void place_vertex(const Crossing* crossings, int count, float* at) {
  float m[3] = {0, 0, 0}, n[3] = {0, 0, 0};
  for (int k = 0; k < count; ++k) {
    for (int a = 0; a < 3; ++a) {
      m[a] += crossings[k].p[a];
      n[a] += crossings[k].n[a];
    }
  }
  const float share = 1 / static_cast<float>(count);
  for (float& v : m) v *= share;
  const float square = n[0] * n[0] + (n[1] * n[1] + n[2] * n[2]);
  const float scale = square > 0 ? 1 / std::sqrt(square) : 0;
  for (float& v : n) v *= scale;
  float cosine = 1, gap[12], mean = 0;
  for (int k = 0; k < count; ++k) {
    const Crossing& c = crossings[k];
    cosine = std::min(cosine, c.n[0] * n[0] + (c.n[1] * n[1] + c.n[2] * n[2]));
    gap[k] = c.n[0] * (c.p[0] - m[0]) + (c.n[1] * (c.p[1] - m[1]) + c.n[2] * (c.p[2] - m[2]));
    mean += gap[k];
  }
  float x[3];
  if (cosine > kSmoothCosine) {
    for (int a = 0; a < 3; ++a) x[a] = m[a] + kCurvedVertexShare * share * mean * n[a];
  } else {
    float A[3][3] = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}, b[3] = {0, 0, 0}, v[3][3];
    for (int k = 0; k < count; ++k) {
      const float* const c = crossings[k].n;
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) A[i][j] += c[i] * c[j];
        b[i] += c[i] * gap[k];
      }
    }
    eigen(A, v);
    const float most = std::max({A[0][0], A[1][1], A[2][2]});
    const auto solve = [&](float least) {
      for (int a = 0; a < 3; ++a) x[a] = m[a];
      for (int e = 0; e < 3; ++e) {
        if (A[e][e] < least) continue;
        const float s = (v[0][e] * b[0] + (v[1][e] * b[1] + v[2][e] * b[2])) / A[e][e];
        for (int a = 0; a < 3; ++a) x[a] += s * v[a][e];
      }
    };
    const auto outside = [&] {
      float far = 0;
      for (const float c : x) far = std::max({far, -c, c - 1});
      return far;
    };
    solve(kMinEigenvalueShare * most);
    if (outside() > kMaxVertexOutside) {
      const float middle =
          A[0][0] + A[1][1] + A[2][2] - most - std::min({A[0][0], A[1][1], A[2][2]});
      solve(std::max(middle, kMinEigenvalueShare * most));
    }
    if (outside() > kMaxVertexOutside) solve(most);
    if (outside() <= kMaxVertexOutside) {
      for (int a = 0; a < 3; ++a) at[a] = x[a];
      return;
    }
  }
  for (int a = 0; a < 3; ++a) at[a] = std::min(std::max(x[a], kVertexInset), 1 - kVertexInset);
}

}  // namespace soilvdb::inline v0
