// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The page around the picture: connection, totals, downloads, notices, panels of narrow screens.
import {alarmLines} from './alarms.js';
import {address} from './api.js';
import {$, h, setText} from './dom.js';
import * as format from './format.js';
import * as units from './units.js';

const kDownloads = [
  ['machines.csv', 'Machines', 'CSV'], ['surface.tif', 'Surface', 'GeoTIFF'], ['soil.vdb', 'Ground', 'OpenVDB'],
  ['mesh.glb', 'Mesh', 'GLB'], ['summary.json', 'Summary', 'JSON'], ['measures.csv', 'Measures', 'CSV'],
];

/** @param {'wait'|'live'|'past'|'lost'} state @param {string} text @param {string} time shown */
export function showConnection(state, text, time = '') {
  $('connection').dataset.state = state;
  setText($('connection-text'), text);
  setText($('connection-time'), time);
}

/** Shows a notice until it is cleared with null. @param {?function()} retry */
export function notice(text, retry = null) {
  $('notice').hidden = text === null;
  if (text === null) return;
  setText($('notice-text'), text);
  $('notice-do').hidden = retry === null;
  $('notice-do').onclick = retry;
}

let allAlarms = false;   // are to be seen, not the first ones

/** Shows what must be known now. @param {{kind: string, machine: ?string, text: string, by_m: number=}[]} alarms */
export function showAlarms(alarms) {
  const {lines, more} = alarmLines(alarms, allAlarms);
  if (alarms.length === 0) allAlarms = false;
  $('alarms').hidden = lines.length === 0;
  const key = JSON.stringify([lines, more, allAlarms]);
  if (key === $('alarms').dataset.lines) return;
  $('alarms').dataset.lines = key;
  const focused = $('alarms').contains(document.activeElement), button = h('button', {
    class: 'link', type: 'button', 'aria-expanded': String(allAlarms), onclick: () => {
      allAlarms = !allAlarms;
      showAlarms(alarms);
    }}, allAlarms ? 'Fewer' : `+${more} more`);
  $('alarms').replaceChildren(
    ...lines.map(({machine, text}) => h('li', {}, machine ? h('span', {class: 'alarm-name', title: machine}, machine) : null, machine ? ': ' : '', text)),
    ...(more > 0 || (allAlarms && alarmLines(alarms, false).more > 0) ? [h('li', {class: 'more'}, button)] : []));
  if (focused) button.focus();
}

let lasting = '', hintTimer = null;

function showHint(text) {
  $('hint').hidden = !text;
  setText($('hint-text'), text);
  $('hint-text').className = text === lasting ? 'lasting' : '';
}

/** Shows a hint. @param {number} seconds after which the last hint without a limit is back; 0: no limit */
export function hint(text, seconds = 0) {
  clearTimeout(hintTimer);
  if (seconds > 0) hintTimer = setTimeout(() => showHint(lasting), 1000 * seconds);
  else lasting = text;
  showHint(text);
}

/** @param {Object} state from the server */
export function showTotals(state) {
  const sum = (of) => state.machines.reduce((a, m) => a + (of(m) ?? 0), 0);
  const named = (name, counted) => (units.unit('soil') === 'counted' || !units.soilOf(counted) ? name : `${name}, ${units.soilOf(counted)}`);
  const surveyed = state.surveyed_m3 ?? null;
  const parts = [['Net', format.signedVolume(state.change_m3), '', 'Volume of the ground now minus before digging'],
    ...(surveyed === null ? [] : [['surveyed', format.signedVolume(surveyed), '', 'The part of Net that surveys and scans added, less what they removed']]),
    [named('Dug', 'bank'), format.volume(state.cut_m3, 'bank'), '', 'Volume that machines took out of the ground, counted in place; soil that was dug again counts again'],
    [named('Put down', 'loose'), format.volume(state.spilled_m3, 'loose'), '', 'Volume that left the buckets, counted loose; soil that was put down again counts again'],
    [named('In buckets', 'loose'), format.volume(sum((m) => m.bucket_m3), 'loose'), 'less', 'Present load of all buckets'],
    ['Working', `${state.machines.filter((m) => m.state === 'working' && m.link !== 'lost').length} of ${state.machines.length}`, 'less', '']];
  const key = parts.flat().join();
  if ($('totals').dataset.key === key) return;
  $('totals').dataset.key = key;
  for (const list of document.querySelectorAll('.totals')) {
    list.replaceChildren(...parts.map(([name, text, kind, title]) => h('div', {class: kind, title}, h('dt', {}, name), h('dd', {}, text))));
  }
}

/** A menu closes when people click beside it, or press Escape. @param {function()} opened */
export function startMenu(menu, opened = () => {}) {
  menu.addEventListener('toggle', () => { if (menu.open) opened(); });
  document.addEventListener('pointerdown', (event) => { if (!menu.contains(event.target)) menu.open = false; });
  menu.addEventListener('keydown', (event) => {
    if (event.key !== 'Escape' || !menu.open) return;
    menu.open = false;
    menu.querySelector('summary').focus();
    event.stopPropagation();
  });
}

/** Makes addresses when the list is opened, for the time shown then. */
export function startDownloads(timeShown) {
  startMenu($('downloads'), () => {
    const time = timeShown();
    $('download-list').replaceChildren(...kDownloads.map(([file, name, kind]) =>
      h('a', {href: address(`/${file}`, {time}), download: file}, name, h('small', {}, `${kind}, ${file}`))),
      h('a', {href: address('/measures.geojson'), download: 'measures.geojson'}, 'Measures', h('small', {}, 'GeoJSON, with names')),
      h('a', {href: address('/report', {units: units.text()}), target: '_blank'}, 'Report', h('small', {}, 'page to print, CSV')),
      h('p', {}, time === null ? 'As of now.' : `As of ${format.time(time)}.`));
  });
  $('download-list').addEventListener('click', () => { $('downloads').open = false; });
}

/** Tabs open the panels of narrow screens. */
export function openPanel(name, toggle = false) {
  const panel = $('panel'), closed = toggle && panel.dataset.open === name;
  if (closed || name === null) delete panel.dataset.open;
  else panel.dataset.open = name;
  for (const tab of document.querySelectorAll('[data-tab]')) {
    tab.setAttribute('aria-pressed', String(panel.dataset.open === tab.dataset.tab));
  }
}

export function startPanels() {
  for (const tab of document.querySelectorAll('[data-tab]')) {
    tab.addEventListener('click', () => openPanel(tab.dataset.tab, true));
  }
}
