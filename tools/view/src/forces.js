// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The force of the soil on each bucket, which the server computes while this is switched on: its
// switch in the legend, and a gauge for each machine with the largest force of this and the last
// cycle.
import {$, h, setText, svg} from './dom.js';
import {LargestForce, arrowScale, forceText, kilonewtons, limitText, sizeOf} from './force_values.js';
import {kMachineColors} from './machines.js';
import * as format from './format.js';
import * as units from './units.js';

const kUnseen = 'not seen yet', kWaits = 'asking\u2026';

export class Forces {
  on = false;
  #rows = new Map();
  #past = false;

  /**
   * @param {Object} site @param {function(boolean)} ask tells the server to send forces, or not to
   * @param {function(Map<string, {world_force_n: number[], text: string}>)} show the known forces by machine
   */
  constructor(site, ask, show) {
    Object.assign(this, {ask, show, offered: site.soil !== null && site.machines.length > 0});
    if (!this.offered) return;
    this.scale = arrowScale(site.machines);
    this.most_n = this.scale.n_per_m * this.scale.most_m;
    this.box = h('input', {type: 'checkbox', id: 'force', 'aria-keyshortcuts': 'k', onchange: () => this.switch(this.box.checked)});
    this.key = h('span', {class: 'faint', id: 'force-scale', hidden: true});
    this.said = h('p', {class: 'faint'});
    $('legend').append(h('label', {title: 'Force of the soil on the buckets, by the soil of the scenario (K)'}, this.box, svg('svg', {class: 'force-swatch', viewBox: '0 0 24 10', 'aria-hidden': 'true'}, svg('path', {d: 'M1 5h14M15 1l8 4-8 4z'})), 'Force', this.key));
    $('forces').append(h('h3', {}, 'Force of the soil'), ...site.machines.map((machine, i) => this.#make(machine.name, kMachineColors[i % kMachineColors.length])),
      this.said);
    this.unitsChanged();
  }

  unitsChanged() {
    if (!this.offered) return;
    const one_m = units.si('length', 1);
    setText(this.key, `1\u2009${units.symbol('length')} is ${kilonewtons(this.scale.n_per_m * one_m)}`);
    setText(this.said, `Gauges go to ${kilonewtons(this.most_n)}; arrows to ${format.length(this.scale.most_m)}, with two heads for more. Largest: in this and the last cycle.`);
  }

  #make(name, color) {
    const row = {
      largest: new LargestForce(), cycles: 0, value: h('b'), load: h('span', {class: 'gauge-bar force-load'}), rest: h('span', {class: 'gauge-bar force-rest'}),
      mark: h('i', {hidden: true}), parts: h('small'), most: h('small'), why: h('small', {class: 'force-limit'}),
    };
    row.gauge = h('span', {class: 'gauge', role: 'meter', 'aria-label': `Force on ${name}`, 'aria-valuemin': 0, 'aria-valuemax': this.most_n / 1000}, row.rest, row.load, row.mark);
    row.element = h('div', {class: 'force', 'data-machine': name}, h('span', {class: 'swatch', style: `background:${color}`}), h('span', {class: 'force-name', title: name}, name), row.value,
      row.gauge, row.parts, row.most, row.why);
    this.#rows.set(name, row);
    return row.element;
  }

  switch(on) {
    if (!this.offered) return;
    this.on = this.box.checked = on;
    this.key.hidden = $('forces').hidden = !on;
    this.wait(this.#past);
    this.ask(on);
  }

  /** Asks again after a lost connection, for live machines. */
  again() {
    this.wait(false);
    if (this.on) this.ask(true);
  }

  /** Called when machines of another time are shown; their forces follow. @param {boolean} past not live */
  wait(past) {
    this.#past = past;
    if (!this.offered) return;
    for (const row of this.#rows.values()) this.#fill(row, {why: kWaits});
    this.show(new Map());
  }

  /** Cycles of the live machines. */
  state(state) {
    for (const {name, cycles} of state.machines) if (this.#rows.has(name)) this.#rows.get(name).cycles = cycles;
  }

  /** @param {Object[]} machines from the server: those that were seen */
  take(machines) {
    if (!this.on) return;
    const told = new Map(machines.map((m) => [m.name, m])), shown = new Map();
    for (const [name, row] of this.#rows) {
      const m = told.get(name);
      if (m?.world_force_n && !this.#past) row.largest.add(sizeOf(m.world_force_n), m.limited, row.cycles);
      this.#fill(row, m ?? {why: kUnseen});
      if (m?.world_force_n) shown.set(name, {world_force_n: m.world_force_n, text: row.value.textContent});
    }
    this.show(shown);
  }

  /** @param {{world_force_n: ?number[], world_load_n: ?number[], limited: string, why: string}} told */
  #fill(row, {world_force_n: force, world_load_n: load, limited = '', why}) {
    const known = Boolean(force), largest = this.#past ? null : row.largest.value;
    row.gauge.hidden = row.mark.hidden = !known;
    setText(row.why, known ? limitText(limited) : why);
    if (!known) {
      for (const part of [row.value, row.parts, row.most]) setText(part, '');
      return;
    }
    const size_n = sizeOf(force), load_n = Math.min(size_n, sizeOf(load)), percent = (n) => `${Math.min(100, (100 * n) / this.most_n).toFixed(1)}%`;
    const digging = kilonewtons(sizeOf(force.map((n, axis) => n - load[axis])));
    setText(row.value, forceText(size_n, limited));
    row.load.style.width = percent(load_n);
    row.rest.style.width = percent(size_n);
    row.mark.hidden = largest === null;
    row.mark.style.left = percent(largest?.size_n ?? 0);
    setText(row.parts, `Digging ${digging}, load ${kilonewtons(sizeOf(load))}`);
    setText(row.most, largest ? `Largest ${forceText(largest.size_n, largest.limited)}` : 'Largest: of live forces only');
    row.gauge.setAttribute('aria-valuenow', Math.min(this.most_n, size_n) / 1000);
    row.gauge.setAttribute('aria-valuetext', [row.value, row.most, row.why].map((e) => e.textContent).filter(Boolean).join('. '));
  }
}
