// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The place of a tag of a machine or measure: near it, in the picture, and beside what is there.

const kGap = 4;

/**
 * All in pixels, y down; a place is the middle of the tag's lower side.
 * @param {number[]} wanted @param {{width: number, height: number}} size of the tag
 * @param {{width: number, height: number}} picture
 * @param {{left: number, top: number, right: number, bottom: number}[]} over the picture
 * @return {?number[]} the nearest place in the picture beside all of them; null if there is none
 */
export function placeTag([x, y], size, picture, over) {
  const half = size.width / 2;
  const inside = (u, v) => [Math.max(half, Math.min(picture.width - half, u)), Math.max(size.height, Math.min(picture.height, v))];
  const covered = ([u, v]) => over.some((box) => u + half > box.left && u - half < box.right && v > box.top && v - size.height < box.bottom);
  const nearest = (places, to) => places.sort((a, b) => Math.abs(a - to) - Math.abs(b - to));
  const xs = nearest([x, ...over.flatMap((box) => [box.left - kGap - half, box.right + kGap + half])].map((u) => inside(u, 0)[0]), x);
  const ys = nearest([y, ...over.flatMap((box) => [box.top - kGap, box.bottom + kGap + size.height])].map((v) => inside(0, v)[1]), y);
  let best = null, least = Infinity;
  for (const u of xs) {
    if (Math.abs(u - x) >= least) break;
    for (const v of ys) {
      const far = Math.hypot(u - x, v - y);
      if (far >= least) break;
      if (!covered([u, v])) [best, least] = [[u, v], far];
    }
  }
  return best;
}

/** The largest box of a picture beside what is over it. */
export function freeBox({width, height}, over) {
  const edges = (low, high, most) => [0, most, ...over.flatMap((box) => [box[low], box[high]])].filter((v, i, all) => v >= 0 && v <= most && all.indexOf(v) === i);
  const xs = edges('left', 'right', width), ys = edges('top', 'bottom', height);
  let best = null, most = 0;
  for (const left of xs) for (const right of xs) for (const top of ys) for (const bottom of ys) {
    const area = (right - left) * (bottom - top);
    if (right <= left || area <= most || over.some((box) => left < box.right && right > box.left && top < box.bottom && bottom > box.top)) continue;
    [best, most] = [{left, top, right, bottom}, area];
  }
  return best;
}

/** The box of a placed tag. */
export function boxOf([x, y], {width, height}) {
  return {left: x - width / 2, top: y - height, right: x + width / 2, bottom: y};
}

/** The box of a line between two places. */
export function boxAround([x, y], [u, v], margin) {
  return {left: Math.min(x, u) - margin, top: Math.min(y, v) - margin, right: Math.max(x, u) + margin, bottom: Math.max(y, v) + margin};
}

/** Boxes of the elements over the picture, in its pixels. */
export function boxesOver() {
  const picture = document.getElementById('stage').getBoundingClientRect();
  return ['tools', 'camera', 'notice', 'alarms', 'hint', 'legend', 'readout', 'crosshair']
    .map((id) => document.getElementById(id)).filter((e) => e.offsetWidth > 0)
    .map((e) => e.getBoundingClientRect())
    .map(({left, top, right, bottom}) => ({left: left - picture.left, top: top - picture.top, right: right - picture.left, bottom: bottom - picture.top}));
}
