// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The place of a machine's tag: near the machine, in the picture, and beside covering elements.

const kGap = 4;

/**
 * All in pixels, y down; a place is the middle of the tag's lower side.
 * @param {number[]} wanted @param {{width: number, height: number}} size of the tag
 * @param {{width: number, height: number}} picture
 * @param {{left: number, top: number, right: number, bottom: number}[]} over the picture
 * @return {number[]} the nearest place in the picture beside all of them; in the picture if there is none
 */
export function placeTag([x, y], size, picture, over) {
  const half = size.width / 2;
  const inside = (u, v) => [Math.max(half, Math.min(picture.width - half, u)), Math.max(size.height, Math.min(picture.height, v))];
  const covered = ([u, v]) => over.some((box) => u + half > box.left && u - half < box.right && v > box.top && v - size.height < box.bottom);
  const xs = [x, ...over.flatMap((box) => [box.left - kGap - half, box.right + kGap + half])];
  const ys = [y, ...over.flatMap((box) => [box.top - kGap, box.bottom + kGap + size.height])];
  let best = null, least = Infinity;
  for (const u of xs) {
    for (const v of ys) {
      const at = inside(u, v), far = Math.hypot(at[0] - x, at[1] - y);
      if (far >= least || covered(at)) continue;
      [best, least] = [at, far];
    }
  }
  return best ?? inside(x, y);
}
