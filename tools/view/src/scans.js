// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// When each sensor scanned last, and how far scans find each machine's lip from where it is told to be.
import {$, h} from './dom.js';
import * as format from './format.js';
import {kMachineColors} from './machines.js';

const row = (name, value, swatch = null) => h('div', {class: 'scan'}, swatch, h('span', {title: name}, name), h('b', {}, value));

/** @param {Object} state from the server, live or of another time @param {Object} site @param {?number} time_s shown */
export function showScans(state, site, time_s) {
  const {scans = [], scanned_s: last_s} = state, lips = state.machines.filter((m) => m.lip_error_m);
  const line = (when_s, ago_s) => [when_s === null ? '' : format.timeBeside(when_s, time_s), format.ago(ago_s)].filter(Boolean).join(' \u00b7 ');
  const rows = scans.map((scan) => row(scan.sensor, line(scan.time_s, scan.heard_s_ago)));
  if (rows.length === 0 && (last_s ?? null) !== null) rows.push(row('Last', line(last_s, time_s - last_s)));
  const heights = lips.map(({name, lip_error_m: {mean, sigma}}) =>
    row(name, format.estimate(mean, sigma), h('i', {class: 'swatch', style: `background:${kMachineColors[site.machines.findIndex((m) => m.name === name) % kMachineColors.length]}`})));
  $('scans').hidden = rows.length + heights.length === 0;
  const key = JSON.stringify([...rows, ...heights].map((r) => r.textContent));
  if ($('scans').dataset.key === key) return;
  $('scans').dataset.key = key;
  $('scans').replaceChildren(h('h3', {}, 'Scans'), ...rows,
    ...(heights.length > 0 ? [h('p', {class: 'faint', title: 'Height of the lip as told, less as it is, as scans know it, with its standard deviation'}, 'Lip told too high by'), ...heights] : []));
}
