// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Normals of blocks' vertices. A vertex on a block's border also belongs to triangles of its
// neighbours. Its normal is the sum over all of them, so that borders are invisible.

const kSide = 32 * 1024, kZero = 8192;
const kRim = 1100;   // border vertices lie in the outermost cells or beyond

/**
 * Sums of the triangles' area-weighted normals at each vertex, and the vertices on the border.
 * @param {Uint16Array} points @param {Uint16Array|Uint32Array} index
 */
export function vertexNormals(points, index) {
  const n = points.length / 3, sums = new Float32Array(3 * n);
  for (let t = 0; t < index.length; t += 3) {
    const a = 3 * index[t], b = 3 * index[t + 1], c = 3 * index[t + 2];
    const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
    const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    for (const at of [a, b, c]) {
      sums[at] += x;
      sums[at + 1] += y;
      sums[at + 2] += z;
    }
  }
  const border = new Map();
  for (let i = 0; i < n; ++i) {
    if (isRim(points[3 * i]) || isRim(points[3 * i + 1]) || isRim(points[3 * i + 2])) {
      border.set(keyOf(points[3 * i], points[3 * i + 1], points[3 * i + 2]), i);
    }
  }
  return {sums, border};
}

const isRim = (q) => q < kZero + kRim || q > kZero + kSide - kRim;
const keyOf = (x, y, z) => (x * 65536 + y) * 65536 + z;

/**
 * Writes sums as normals of four signed bytes each, with the neighbours' sums at shared vertices.
 * @param {{sums: Float32Array, border: Map<number, number>}} own
 * @param {function(number, number, number): ?{sums: Float32Array, border: Map<number, number>}}
 *     neighbour the block at an offset in blocks
 * @param {Int8Array} out 4 n
 */
export function writeNormals(own, points, neighbour, out) {
  for (let i = 0; i < points.length / 3; ++i) pack(own.sums, i, 0, 0, 0, out);
  for (const i of own.border.values()) {
    let x = 0, y = 0, z = 0;
    const q = [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
    const sides = q.map((v) => (v < kZero + kRim ? [0, -1] : v > kZero + kSide - kRim ? [0, 1] : [0]));
    for (const dx of sides[0]) for (const dy of sides[1]) for (const dz of sides[2]) {
      if (dx === 0 && dy === 0 && dz === 0) continue;
      const other = neighbour(dx, dy, dz);
      const qx = q[0] - kSide * dx, qy = q[1] - kSide * dy, qz = q[2] - kSide * dz;
      if (!other || Math.min(qx, qy, qz) < 0 || Math.max(qx, qy, qz) > 65535) continue;
      const j = other.border.get(keyOf(qx, qy, qz));
      if (j === undefined) continue;
      x += other.sums[3 * j];
      y += other.sums[3 * j + 1];
      z += other.sums[3 * j + 2];
    }
    if (x !== 0 || y !== 0 || z !== 0) pack(own.sums, i, x, y, z, out);
  }
}

function pack(sums, i, dx, dy, dz, out) {
  const x = sums[3 * i] + dx, y = sums[3 * i + 1] + dy, z = sums[3 * i + 2] + dz;
  const scale = 127 / (Math.hypot(x, y, z) || 1);
  out[4 * i] = Math.round(x * scale);
  out[4 * i + 1] = Math.round(y * scale);
  out[4 * i + 2] = Math.round(z * scale);
}
