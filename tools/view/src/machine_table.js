// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The table of machines: load, cut volume, cycles and activity of each.
import {h, setText} from './dom.js';
import * as format from './format.js';
import {kLost, kMachineColors} from './machines.js';
import * as units from './units.js';

const kStates = {working: '● working', idle: '○ idle', unseen: '– not seen yet', lost: kLost};

export class MachineTable {
  #rows = new Map();

  /** @param {HTMLTableElement} table @param {Object} site @param {function(string)} pick a machine was clicked */
  constructor(table, site, pick) {
    this.soils = [['loose', h('small')], ['bank', h('small')], ['loose', h('small')]];   // of the columns with volumes
    const [load, dug, last] = this.soils.map(([, small]) => small);
    table.append(
      h('thead', {}, h('tr', {}, h('th', {scope: 'col'}, 'Machine'), h('th', {scope: 'col'}, 'Load', load),
        h('th', {scope: 'col', title: 'Volume taken out of the ground, counted in place; soil that was dug again counts again'}, 'Dug', dug), h('th', {scope: 'col'}, 'Cycles'), h('th', {scope: 'col'}, 'Last', last))));
    const body = h('tbody');
    site.machines.forEach((machine, i) => {
      const name = h('button', {
        class: 'machine', type: 'button', 'aria-pressed': 'false', title: `${machine.name}: go there and follow; again: stop following`,
        onclick: () => pick(machine.name),
      }, h('span', {class: 'swatch', style: `background:${kMachineColors[i % kMachineColors.length]}`}), h('span', {}, machine.name));
      const row = {
        capacity_m3: machine.capacity_m3, name, state: h('small'), load: h('span'), mass: h('small'), bar: h('span', {class: 'gauge-bar'}),
        dug: h('span'), cycles: h('span'), last: h('span'), lastShare: h('small'),
      };
      row.stateCell = h('td', {}, name, row.state);
      row.gauge = h('span', {class: 'gauge', role: 'img'}, row.bar);
      body.append(h('tr', {}, row.stateCell, h('td', {}, row.load, row.gauge, row.mass), h('td', {}, row.dug),
        h('td', {}, row.cycles), h('td', {}, row.last, row.lastShare)));
      this.#rows.set(machine.name, row);
    });
    table.append(body);
  }

  update(state) {
    for (const [counted, small] of this.soils) setText(small, units.soilOf(counted));
    for (const m of state.machines) {
      const row = this.#rows.get(m.name);
      if (!row) continue;
      const of = row.capacity_m3, fill = m.fill ?? (of ? m.bucket_m3 / of : null);
      const word = m.link === 'lost' ? 'lost' : m.state;   // what it does then is not known
      setText(row.state, kStates[word] ?? word);
      row.stateCell.className = `state-${word}`;
      row.stateCell.parentElement.className = word === 'lost' ? 'lost' : '';
      setText(row.load, format.volume(m.bucket_m3, 'loose'));
      row.gauge.hidden = fill === null;
      row.bar.style.width = `${Math.min(100, 100 * Math.max(0, fill ?? 0))}%`;
      row.gauge.setAttribute('aria-label', `${format.percent(fill)} full`);
      row.gauge.title = `${format.percent(fill)} full`;
      setText(row.mass, m.bucket_kg === null || m.bucket_kg === undefined ? '' : format.mass(m.bucket_kg));
      setText(row.dug, format.volume(m.cut_m3, 'bank'));
      setText(row.cycles, String(m.cycles));
      setText(row.last, format.volume(m.last_load_m3, 'loose'));
      setText(row.lastShare, of && m.last_load_m3 !== null ? format.percent(m.last_load_m3 / of) : '');
    }
  }

  follow(name) {
    for (const [key, row] of this.#rows) row.name.setAttribute('aria-pressed', String(key === name));
  }
}
