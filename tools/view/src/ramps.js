// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Colours of the ground. Cut and fill as in soilvdb's pictures: amber to dark red, and light to
// dark blue. Colour-blind people can tell them apart, also by their lightness.

const rgb = (hex) => [parseInt(hex.slice(1, 3), 16), parseInt(hex.slice(3, 5), 16), parseInt(hex.slice(5, 7), 16)];

/** From least to most. Depth is plasma without its ends, height is cividis without its dark end, and
 * sigma like mako: pale is well known. */
export const kRamps = {
  cut: ['#f9cc6b', '#f49a4c', '#d6583b', '#a61426', '#61001c'],
  fill: ['#bfdeed', '#80badb', '#3b85bd', '#1c5499', '#05265c'],
  depth: ['#fdc527', '#f89540', '#e56b5d', '#cc4778', '#a92395', '#7e03a8', '#4c02a1'],
  height: ['#3b496c', '#575d6d', '#707173', '#8a8678', '#a59c74', '#c3b369', '#e1cc55', '#fee838'],
  sigma: ['#c8f0dc', '#78d6ae', '#38aaac', '#357ba3', '#413d7b', '#2e1e3c'],
  loose: ['#d8c8a8', '#c7a877', '#b0854f', '#96662f', '#7a4a1a'],
};

/** Rows of the texture, in this order. */
export const kRampRows = ['cut', 'fill', 'depth', 'height', 'loose', 'sigma'];
export const kRampWidth = 256;

/** @return {number[]} r, g, b from 0 to 255 */
export function along(name, share) {
  const colors = kRamps[name];
  const at = Math.min(1, Math.max(0, share)) * (colors.length - 1);
  const i = Math.min(colors.length - 2, Math.floor(at)), t = at - i;
  const a = rgb(colors[i]), b = rgb(colors[i + 1]);
  return a.map((v, c) => v + (b[c] - v) * t);
}

/** All ramps, a row each, RGBA. */
export function rampTexels() {
  const texels = new Uint8Array(4 * kRampWidth * kRampRows.length);
  kRampRows.forEach((name, row) => {
    for (let i = 0; i < kRampWidth; ++i) {
      texels.set([...along(name, i / (kRampWidth - 1)).map(Math.round), 255], 4 * (row * kRampWidth + i));
    }
  });
  return texels;
}

/** A CSS gradient of a ramp. */
export function gradient(name, direction) {
  return `linear-gradient(${direction}, ${kRamps[name].join(', ')})`;
}

export const kClodTexels = 256;

/** Lightness of 16 x 16 clods of loose soil, tileable; 128 is the ground's own. */
export function clodTexels() {
  const n = 16, size = kClodTexels, texels = new Uint8Array(size * size);
  let seed = 1;
  const random = () => (seed = (Math.imul(seed, 48271) >>> 0) % 2147483647) / 2147483647;
  const middles = Array.from({length: n * n}, () => [random(), random(), random()]);
  for (let v = 0; v < size; ++v) {
    for (let u = 0; u < size; ++u) {
      const x = (n * (u + 0.5)) / size, y = (n * (v + 0.5)) / size;
      let nearest = 9, second = 9, tone = 0, lit = 0;
      for (let k = 0; k < 9; ++k) {
        const i = Math.floor(x) + (k % 3) - 1, j = Math.floor(y) + Math.floor(k / 3) - 1;
        const middle = middles[((j + n) % n) * n + ((i + n) % n)];
        const dx = x - i - middle[0], dy = y - j - middle[1], d = Math.hypot(dx, dy);
        if (d < nearest) {
          second = nearest;
          nearest = d;
          tone = middle[2];
          lit = 0.7 * (dy - dx);
        } else if (d < second) {
          second = d;
        }
      }
      const gap = Math.min(1, (second - nearest) / 0.22);
      texels[v * size + u] = 128 + 256 * (-0.1 + 0.16 * tone + 0.2 * lit - 0.2 * (1 - gap));
    }
  }
  return texels;
}
