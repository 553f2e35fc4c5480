// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The choice of units: kept in this browser, and in the page's address (#units=ft,yd3), which can be
// passed on. An address wins, but is not kept for other visits.
import {$, h, setText} from './dom.js';
import {hint, startMenu} from './surroundings.js';
import * as units from './units.js';

const kKey = 'soilvdb-units';
const kNames = {length: 'Lengths', volume: 'Volumes', mass: 'Masses', soil: 'Soil'};

const kept = () => {
  try {
    return localStorage.getItem(kKey) ?? '';
  } catch {   // some browser settings forbid storage
    return '';
  }
};
const keep = (text) => {
  try {
    localStorage.setItem(kKey, text);
  } catch { /* it lasts as long as the page */ }
};
const parts = () => location.hash.slice(1).split('&').filter((part) => part !== '');
const inAddress = () => {
  const part = parts().find((p) => p.startsWith('units='));
  return part === undefined ? null : decodeURIComponent(part.slice('units='.length));
};

export class UnitsMenu {
  /** @param {Object} site @param {function()} changed */
  constructor(site, changed) {
    this.changed = changed;
    this.selects = Object.fromEntries(Object.entries(units.kUnits).filter(([kind]) => kind !== 'soil' || site.soil).map(([kind, all]) =>
      [kind, h('select', {'aria-label': kNames[kind], onchange: () => this.#chosen()}, ...Object.entries(all).map(([word, [name]]) => h('option', {value: word}, name)))]));
    $('unit-list').replaceChildren(
      ...Object.entries(this.selects).map(([kind, select]) => h('label', {}, kNames[kind], select)),
      h('p', {}, site.soil ? 'Volumes of soil: loads are counted loose, dug soil in place as bank. Boundaries and sections measure geometry, in place.' : 'On this page and in the report. Files for other programs are in m, m³ and kg.'));
    startMenu($('units'));
    units.setSwell(site.soil?.swell ?? null);
    this.#read();
    addEventListener('hashchange', () => { if (inAddress() !== null) this.#read(); });
  }

  /** Takes the units of the address, else those kept here. */
  #read() {
    for (const text of [inAddress(), kept(), '']) {
      if (text === null) continue;
      try {
        units.choose(units.parsed(text));
        break;
      } catch (error) {
        hint(error.message, 8);
      }
    }
    this.#show();
  }

  #chosen() {
    units.choose({soil: units.unit('soil'), ...Object.fromEntries(Object.entries(this.selects).map(([kind, select]) => [kind, select.value]))});
    keep(units.text(true));
    const address = [...parts().filter((part) => !part.startsWith('units=')), `units=${units.text()}`];
    history.replaceState(history.state, '', `#${address.join('&')}`);
    this.#show();
  }

  #show() {
    for (const [kind, select] of Object.entries(this.selects)) select.value = units.unit(kind);
    const said = `Units: ${['length', 'volume'].map(units.symbol).join(', ')}`;
    setText($('unit-text'), said.slice('Units: '.length));
    $('units').querySelector('summary').setAttribute('aria-label', said);
    this.changed();
  }
}
