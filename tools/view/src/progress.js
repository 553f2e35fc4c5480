// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Progress of an area to the design: what is left over time, the rate, and the expected end.
import {h, svg} from './dom.js';
import * as format from './format.js';
import * as units from './units.js';

const kWidth = 320, kHeight = 150, kLeft = 62, kRight = 8, kTop = 10, kFoot = 22;
const kMostAhead = 2;   // of the time so far, to which the way to the end is drawn

const value = (name, text, title = null) => h('div', {title}, h('dt', {}, name), h('dd', {}, text));

/** @param {?{area: ?Object, error: ?string, asking: boolean}} progress @return {HTMLElement[]} */
export function progressFigures(progress) {
  if (progress?.error) return [h('p', {class: 'error'}, progress.error)];
  if (!progress?.area) return [h('p', {class: 'faint'}, 'Looking at the ground at earlier times\u2026')];
  const {area} = progress, {time_s} = area.over_time;
  const note = area.note ? `${area.note[0].toUpperCase()}${area.note.slice(1)}.` : '';
  return [
    h('dl', {class: 'values'},
      value('Done', format.percent(area.done), 'Of what was to cut and to fill at the start'),
      value('Rate', format.rate(area.rate_m3_per_h), `Over the last ${format.hours(area.rate_over_h)} of work`),
      area.left_h === null ? null : value('Work left', format.hours(area.left_h)),
      area.end_s === null ? null : value('Expected end', format.moment(area.end_s))),
    time_s.length > 1 && time_s[time_s.length - 1] > time_s[0] ? chart(area) : null,
    h('p', {class: 'faint'}, note, time_s.length > 0 ? ` As of ${format.moment(time_s[time_s.length - 1])}.` : ''),
  ].filter(Boolean);
}

function chart({over_time: {time_s, to_cut_m3, to_fill_m3}, end_s}) {
  const first = time_s[0], now = time_s[time_s.length - 1];
  const ahead = end_s !== null && end_s - now <= kMostAhead * (now - first), last = ahead ? end_s : now;
  const most = Math.max(...to_cut_m3, ...to_fill_m3, 1e-3), step = units.si('volume', format.roundUp125(units.shown('volume', most / 3))), top = step * Math.ceil(most / step - 1e-9);
  const x = (t) => kLeft + ((t - first) / (last - first)) * (kWidth - kLeft - kRight);
  const y = (v) => kTop + (1 - v / top) * (kHeight - kTop - kFoot);
  const way = (values) => values.map((v, i) => `${i === 0 ? 'M' : 'L'}${x(time_s[i]).toFixed(1)} ${y(v).toFixed(1)}`).join('');
  const ticks = Array.from({length: Math.round(top / step) + 1}, (_, k) => k * step);
  const series = [['cut', 'Still to cut', to_cut_m3], ['fill', 'Still to fill', to_fill_m3]];
  const drawn = svg('svg', {
    class: 'chart', viewBox: `0 0 ${kWidth} ${kHeight}`, role: 'img',
    'aria-label': series.map(([, name, values]) => `${name} from ${format.volume(values[0])} to ${format.volume(values[values.length - 1])}`).join('; '),
  },
  ...ticks.flatMap((v) => [
    svg('line', {class: 'axis', x1: kLeft, x2: kWidth - kRight, y1: y(v), y2: y(v)}),
    svg('text', {x: kLeft - 5, y: y(v) + 3.5, 'text-anchor': 'end'}, format.volume(v))]),
  svg('text', {x: kLeft, y: kHeight - 8}, format.moment(first)), svg('text', {x: kWidth - kRight, y: kHeight - 8, 'text-anchor': 'end'}, format.moment(last)),
  ...series.flatMap(([kind, , values]) => [
    svg('path', {class: `${kind}-line`, d: way(values)}),
    ahead && values[values.length - 1] > 0 ? svg('path', {class: `${kind}-line ahead`, d: `M${x(now).toFixed(1)} ${y(values[values.length - 1]).toFixed(1)}L${x(end_s).toFixed(1)} ${y(0).toFixed(1)}`}) : null]));
  return h('div', {}, drawn, h('p', {class: 'keys'}, ...series.map(([kind, name]) => h('span', {}, h('i', {class: `${kind}-key`}), name)), ahead ? h('span', {}, '\u254c expected') : null));
}
