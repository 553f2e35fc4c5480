// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Decodes a block of surface: a zlib stream of arrays, mostly of differences, with all low bytes of
// an array before its high bytes. And sigmas of heights, which are plain numbers.

/**
 * @typedef {Object} Block
 * @property {number} bx first voxel of the block, a multiple of 32; likewise by, bz
 * @property {number} by
 * @property {number} bz
 * @property {number} view which view it belongs to; 0 is the live one
 * @property {number} lo which of its 4 x 4 x 4 chunks are resident, bits 0..31
 * @property {number} hi bits 32..63
 * @property {Uint16Array} points 3 n: (q - 8192) / 1024 voxels from the block's first voxel
 * @property {Int16Array} change n, mm above (+) or below (-) the reference; -32768: there is none
 * @property {Int16Array|null} design n, mm above the design; -32768: there is none
 * @property {Uint16Array} loose n, share of loose soil, of 65535
 * @property {Uint16Array|Uint32Array} index 3 m, counter-clockwise seen from the air
 */

export const kNoValue = -32768;
const kHeadBytes = 36;

/** Inflates a message of the server. */
export async function inflate(buffer) {
  const stream = new Blob([buffer]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Response(stream).arrayBuffer();
}

/** Sums 16-bit differences, with low bytes from `at` on, into every `stride`-th element of `out`. */
function accumulate(bytes, at, count, out, first, stride) {
  for (let i = 0, o = first, value = 0; i < count; ++i, o += stride) {
    value = (value + (bytes[at + i] | (bytes[at + count + i] << 8))) & 0xffff;
    out[o] = value;
  }
  return at + 2 * count;
}

/** Decodes triangles' corners: 0 is the next vertex; other numbers count back from it. */
function readCorners(bytes, at, planes, index, n) {
  const count = index.length;
  let next = 0;
  for (let i = 0; i < count; ++i) {
    let back = bytes[at + i] | (bytes[at + count + i] << 8);
    if (planes === 4) back = (back | (bytes[at + 2 * count + i] << 16) | (bytes[at + 3 * count + i] << 24)) >>> 0;
    index[i] = next - back;
    if (back > next || (back === 0 && next >= n)) throw new Error(`a block of ${n} vertices has a corner ${back} before vertex ${next}`);
    if (back === 0) ++next;
  }
}

/**
 * @param {ArrayBuffer} buffer result of inflate()
 * @return {Block}
 * @throws {Error} if its length is wrong, or a corner is beyond its vertices
 */
export function decodeBlock(buffer) {
  if (buffer.byteLength < kHeadBytes) throw new Error(`a block of ${buffer.byteLength} bytes has no head`);
  const head = new DataView(buffer, 0, kHeadBytes);
  const n = head.getUint32(24, true), m = head.getUint32(28, true), flags = head.getUint32(32, true);
  const wide = n > 65535, designed = (flags & 1) !== 0;
  const expected = kHeadBytes + 2 * n * (designed ? 6 : 5) + 3 * m * (wide ? 4 : 2);
  if (buffer.byteLength !== expected) {
    throw new Error(`a block of ${n} vertices and ${m} triangles has ${buffer.byteLength} bytes, not ${expected}`);
  }
  const bytes = new Uint8Array(buffer);
  const points = new Uint16Array(3 * n), change = new Int16Array(n), loose = new Uint16Array(n);
  const design = designed ? new Int16Array(n) : null;
  const index = wide ? new Uint32Array(3 * m) : new Uint16Array(3 * m);
  let at = kHeadBytes;
  for (let axis = 0; axis < 3; ++axis) at = accumulate(bytes, at, n, points, axis, 3);
  at = accumulate(bytes, at, n, change, 0, 1);
  if (design) at = accumulate(bytes, at, n, design, 0, 1);
  at = accumulate(bytes, at, n, loose, 0, 1);
  readCorners(bytes, at, wide ? 4 : 2, index, n);
  return {
    bx: head.getInt32(0, true), by: head.getInt32(4, true), bz: head.getInt32(8, true),
    view: head.getUint32(12, true), lo: head.getUint32(16, true), hi: head.getUint32(20, true),
    points, change, design, loose, index,
  };
}

export const blockKey = (b) => `${b.bx},${b.by},${b.bz}`;

const kSigmaHeadBytes = 32, kNotSeen = 65535, kSigmaUnit_m = 1e-4;

/**
 * @param {ArrayBuffer} buffer answer to /sigmas
 * @return {{west: number, south: number, cell_m: number, nx: number, ny: number, sigmas_m: Float32Array}}
 *     row by row from the south; negative: not seen
 * @throws {Error} if its length is wrong
 */
export function decodeSigmas(buffer) {
  if (buffer.byteLength < kSigmaHeadBytes) throw new Error(`sigmas of ${buffer.byteLength} bytes have no head`);
  const head = new DataView(buffer), [west, south, cell_m] = [0, 8, 16].map((at) => head.getFloat64(at, true));
  const nx = head.getUint32(24, true), ny = head.getUint32(28, true);
  if (buffer.byteLength !== kSigmaHeadBytes + 2 * nx * ny) throw new Error(`sigmas of ${nx} x ${ny} cells have ${buffer.byteLength} bytes`);
  const sigmas_m = Float32Array.from(new Uint16Array(buffer, kSigmaHeadBytes), (v) => (v === kNotSeen ? -1 : kSigmaUnit_m * v));
  return {west, south, cell_m, nx, ny, sigmas_m};
}
