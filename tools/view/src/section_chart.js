// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A section's profile: the ground before and now, cut and fill between them, and the design.
import {h, svg} from './dom.js';
import * as format from './format.js';
import * as units from './units.js';

const kWidth = 320, kHeight = 168, kLeft = 44, kRight = 8, kTop = 10, kFoot = 24;

/** Multiples of a round step between low and high, m; `step` is in the chosen unit. */
function ticksOf(low_m, high_m, about) {
  const low = units.shown('length', low_m), high = units.shown('length', high_m);
  const step = format.roundUp125((high - low) / about), ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k) ticks.push(units.si('length', k * step));
  return {step, ticks};
}

const known = (v) => v !== null && v !== undefined;

/** Points of a line, split where it is unknown. */
function linePath(xs, ys, x, y) {
  let path = '', pen = false;
  for (let i = 0; i < xs.length; ++i) {
    if (!known(ys[i])) {
      pen = false;
      continue;
    }
    path += `${pen ? 'L' : 'M'}${x(xs[i]).toFixed(1)} ${y(ys[i]).toFixed(1)}`;
    pen = true;
  }
  return path;
}

/** The area between two lines where the first is above (`sign` 1) or below (-1) the second. */
function areaPath(xs, low, high, sign, x, y) {
  let path = '';
  for (let i = 0; i + 1 < xs.length; ++i) {
    const all = [low[i], low[i + 1], high[i], high[i + 1]];
    if (!all.every(known)) continue;
    const a = sign * (high[i] - low[i]), b = sign * (high[i + 1] - low[i + 1]);
    if (a <= 0 && b <= 0) continue;
    const clip = (k) => (sign * (high[k] - low[k]) > 0 ? high[k] : low[k]);
    const x0 = x(xs[i]).toFixed(1), x1 = x(xs[i + 1]).toFixed(1);
    path += `M${x0} ${y(low[i]).toFixed(1)}L${x0} ${y(clip(i)).toFixed(1)}L${x1} ${y(clip(i + 1)).toFixed(1)}L${x1} ${y(low[i + 1]).toFixed(1)}Z`;
  }
  return path;
}

/**
 * @param {{distance_m: number[], before_m: ?number[], now_m: ?number[], design_m: ?number[], cut_m2: number, fill_m2: number}} section
 * @param {function(?number)} hover distance along the section that is pointed at
 * @return {HTMLElement}
 */
export function sectionChart(section, hover) {
  const {distance_m, before_m, now_m, design_m, cut_m2, fill_m2} = section;
  const heights = [...before_m, ...now_m, ...(design_m ?? [])].filter(known);
  if (heights.length === 0) return h('p', {class: 'faint'}, 'There is no ground along this line.');
  const total = distance_m[distance_m.length - 1];
  const scale = (kHeight - kTop - kFoot) / (kWidth - kLeft - kRight);
  let low = heights.reduce((a, b) => Math.min(a, b)), high = heights.reduce((a, b) => Math.max(a, b));
  const room = Math.max(high - low, 0.02 * total * scale, 0.05), middle = (low + high) / 2;
  low = middle - 0.56 * room;
  high = middle + 0.56 * room;
  const x = (d) => kLeft + (d / total) * (kWidth - kLeft - kRight);
  const y = (z) => kTop + ((high - z) / (high - low)) * (kHeight - kTop - kFoot);
  const exaggeration = (scale * total) / (high - low);
  const across = ticksOf(0, total, 6), up = ticksOf(low, high, 4);
  const decimals = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const cursor = svg('line', {class: 'cursor', y1: kTop, y2: kHeight - kFoot, visibility: 'hidden'});
  const chart = svg('svg', {
    class: 'chart', viewBox: `0 0 ${kWidth} ${kHeight}`, role: 'img', tabindex: 0,
    'aria-label': `Profile over ${format.length(total)}, heights from ${format.coordinate(Math.min(...heights))} to ${format.height(Math.max(...heights))}; cut ${format.area(cut_m2)}, fill ${format.area(fill_m2)}`,
  },
  ...up.ticks.flatMap((z) => [
    svg('line', {class: 'axis', x1: kLeft, x2: kWidth - kRight, y1: y(z), y2: y(z)}),
    svg('text', {x: kLeft - 5, y: y(z) + 3.5, 'text-anchor': 'end'}, format.coordinate(z, decimals(up.step)))]),
  ...across.ticks.map((d, i) => svg('text', {x: x(d), y: kHeight - 10, 'text-anchor': i === 0 ? 'start' : d > 0.96 * total ? 'end' : 'middle'}, units.shown('length', d).toFixed(decimals(across.step)) + (d > 0.99 * total || i === across.ticks.length - 1 ? `\u2009${units.symbol('length')}` : ''))),
  svg('path', {class: 'cut-area', d: areaPath(distance_m, before_m, now_m, -1, x, y)}),
  svg('path', {class: 'fill-area', d: areaPath(distance_m, before_m, now_m, 1, x, y)}),
  svg('path', {class: 'before', d: linePath(distance_m, before_m, x, y)}),
  design_m ? svg('path', {class: 'design', d: linePath(distance_m, design_m, x, y)}) : null,
  svg('path', {class: 'now', d: linePath(distance_m, now_m, x, y)}), cursor);
  const said = h('p', {class: 'keys', 'aria-live': 'polite'});
  let at = 0;   // the shown point
  const rest = () => {
    cursor.setAttribute('visibility', 'hidden');
    said.replaceChildren(...['— now', '╌ before', design_m ? '⋯ design' : null,
      exaggeration > 1.05 || exaggeration < 0.95 ? `heights × ${format.digits(exaggeration, 2)}` : null].filter(Boolean).map((t) => h('span', {}, t)));
    hover(null);
  };
  const show = (share) => {
    const i = at = Math.round(Math.min(1, Math.max(0, share)) * (distance_m.length - 1));
    cursor.setAttribute('visibility', 'visible');
    cursor.setAttribute('x1', x(distance_m[i]));
    cursor.setAttribute('x2', x(distance_m[i]));
    const change = known(now_m[i]) && known(before_m[i]) ? now_m[i] - before_m[i] : null;
    said.replaceChildren(...[`at ${format.length(distance_m[i])}`, format.height(now_m[i]), change === null ? null : format.signedLength(change)]
      .filter(Boolean).map((t) => h('span', {}, t)));
    hover(distance_m[i]);
  };
  chart.addEventListener('pointermove', (event) => {
    const box = chart.getBoundingClientRect();
    show((((event.clientX - box.left) / box.width) * kWidth - kLeft) / (kWidth - kLeft - kRight));
  });
  chart.addEventListener('keydown', (event) => {
    const by = {ArrowLeft: -0.01, ArrowRight: 0.01}[event.key];
    if (!by) return;
    show(at / (distance_m.length - 1) + by);
    event.preventDefault();
  });
  for (const type of ['pointerleave', 'blur']) chart.addEventListener(type, rest);
  rest();
  return h('div', {}, chart, said);
}
