// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The legend: choice of colours, their scale, and the range around zero that counts as no change.
import {h, setText} from './dom.js';
import * as format from './format.js';
import {kModes} from './ground_uniforms.js';
import {gradient} from './ramps.js';
import * as units from './units.js';

const kPlain = {design: 'Grey: there is no design', sigma: 'Plain: not seen as it is now'};
const kNames = {
  change: 'Cut and fill', depth: 'Depth of cut', height: 'Height', loose: 'Loose soil', design: 'Remaining to design', sigma: 'Surveyed, with sigma',
};

export class Legend {
  /**
   * @param {HTMLElement} element @param {Object} site
   * @param {import('./ground_uniforms.js').GroundUniforms} uniforms
   * @param {function()} changed
   */
  constructor(element, site, uniforms, changed) {
    Object.assign(this, {uniforms: uniforms.values, changed});
    this.modes = kModes.filter((mode) => mode !== 'sigma' && (mode !== 'design' || site.design) && (mode !== 'loose' || site.soil));
    this.select = h('select', {'aria-label': 'Colour by', onchange: () => this.#show()},
      ...this.modes.map((mode) => h('option', {value: mode}, kNames[mode])));
    this.least_m = Math.max(5, 5 * Math.round((400 * site.voxel_size_m) / 5)) / 1000;
    this.uniforms.dead_m.value = this.least_m;
    this.band = h('input', {
      type: 'range', id: 'dead-band', min: 0,
      oninput: () => {
        this.uniforms.dead_m.value = units.si('length', this.band.valueAsNumber);
        this.#draw();
        this.changed();
      },
    });
    this.bandText = h('output', {for: 'dead-band'});
    const patterns = h('input', {
      type: 'checkbox', id: 'patterns', onchange: () => {
        this.uniforms.patterns.value = patterns.checked;
        this.#draw();
        this.changed();
      },
    });
    patterns.checked = this.uniforms.patterns.value = true;
    this.bar = h('div', {class: 'legend-bar'});
    this.ticks = h('div', {class: 'ticks'});
    this.names = h('div', {class: 'legend-names'});
    this.unknown = h('p', {class: 'faint'});
    this.bandLabel = h('label', {title: 'Changes smaller than this are shown as ground'}, 'Ignore below', this.band, this.bandText);
    this.patternLabel = h('label', {}, patterns, 'Stripes on cut, dots on fill');
    this.options = h('details', {}, h('summary', {}, 'Options'), this.bandLabel, this.patternLabel);
    element.append(this.select, this.bar, this.ticks, this.names, this.unknown, this.options);
    this.unitsChanged();
  }

  /** Steps are round in the chosen unit. */
  unitsChanged() {
    const step = units.unit('length') === 'm' ? 0.005 : 0.01, most = units.shown('length', Math.max(0.2, 10 * this.least_m));
    this.band.step = step;
    this.band.max = step * Math.ceil(most / step - 1e-6);
    this.band.value = units.shown('length', this.uniforms.dead_m.value);
    this.uniforms.least_sigma_m.value = units.unit('length') === 'm' ? 0.003 : units.si('length', 0.01);
    this.originZ = undefined;   // fits again
    this.#show();
  }

  /** Offers what was surveyed: called once there is something. */
  offerSigmas() {
    if (this.modes.includes('sigma')) return;
    this.modes.push('sigma');
    this.select.append(h('option', {value: 'sigma'}, kNames.sigma));
  }

  /** Switches to the next colour mode. */
  next() {
    this.select.selectedIndex = (this.select.selectedIndex + 1) % this.modes.length;
    this.#show();
  }

  get mode() {
    return this.select.value;
  }
  set mode(mode) {
    this.select.value = mode;
    this.#show();
  }

  /** Fits the scales to the shown ground. */
  fit({deepest_m, highest_m, fromDesign_m, low_m, high_m, originZ}) {
    const u = this.uniforms, shown_m = this.mode === 'design' ? fromDesign_m : Math.max(deepest_m, highest_m);
    const depths = Math.max(shown_m, 2 * u.dead_m.value, 0.1);
    const step = format.stepDown(depths / 1.8);
    const most = step * Math.ceil((depths / step) * (1 - 1e-6));
    const contour = format.stepUp(Math.max(0.1, (high_m - low_m) / 25));
    if (most === u.most_m.value && low_m === u.low_m.value && high_m === u.high_m.value && this.originZ === originZ) return;
    u.most_m.value = most;
    u.step_m.value = step;
    u.low_m.value = low_m;
    u.high_m.value = Math.max(high_m, low_m + 0.1);
    u.contour_m.value = contour;
    this.originZ = originZ;
    this.#draw();
    this.changed();
  }

  #show() {
    this.uniforms.mode.value = kModes.indexOf(this.mode);
    this.#draw();
    this.changed();
  }

  #draw() {
    const {mode} = this, u = this.uniforms, most = u.most_m.value, dead = u.dead_m.value;
    const signed = mode === 'change' || mode === 'design';
    this.bandLabel.hidden = !signed && mode !== 'depth';
    this.patternLabel.hidden = !signed;
    this.options.classList.toggle('empty', !signed && mode !== 'depth');
    const metric = units.unit('length') === 'm';
    this.bandText.textContent = metric ? `${Number((100 * dead).toFixed(1))}\u2009cm` : format.length(dead);
    const span = (ramp, direction, pattern) => h('span', {style: `background:${pattern ? `${pattern},` : ''}${gradient(ramp, direction)}`});
    const stripes = u.patterns.value ? 'repeating-linear-gradient(-45deg, rgb(20 0 0 / 30%) 0 1.5px, transparent 1.5px 6px)' : '';
    const dots = u.patterns.value ? 'radial-gradient(circle, rgb(255 255 255 / 38%) 1.4px, transparent 1.8px) 0 0 / 6px 6px' : '';
    const ticks = [], cm = metric && most < 0.5, unit = cm ? 'cm' : units.symbol('length');
    const number = (m) => (m === 0 ? '0' : String(Number((Math.abs(cm ? 100 * m : units.shown('length', m))).toPrecision(3))));
    if (signed) {
      this.bar.replaceChildren(span('cut', 'to left', stripes), span('fill', 'to right', dots));
      const half = (50 * Math.min(1, dead / most));
      this.bar.append(h('i', {class: 'legend-band', style: `left:${50 - half}%;width:${2 * half}%`}));
      for (const m of [-1, -0.5, 0, 0.5, 1]) ticks.push([(m + 1) / 2, (m < 0 ? '\u2212' : m > 0 ? '+' : '') + number(m * most)]);
      const design = mode === 'design';
      if (design) ticks.forEach((tick) => { tick[1] = tick[1].replace(/^[^0-9]/, ''); });
      this.#name(design ? 'still to cut' : 'cut', design ? 'still to fill' : 'fill', unit);
    } else if (mode === 'depth') {
      this.bar.replaceChildren(span('depth', 'to right'));
      for (const m of [0, 0.5, 1]) ticks.push([m, number(m * most)]);
      this.#name('below the ground before', '', unit);
    } else if (mode === 'height') {
      this.bar.replaceChildren(span('height', 'to right'));
      const low = u.low_m.value + (this.originZ ?? 0), high = u.high_m.value + (this.originZ ?? 0);
      for (const m of [0, 1]) ticks.push([m, format.height(low + m * (high - low), 1)]);
      this.#name(`a line every ${format.step(u.contour_m.value)}`, '');
    } else if (mode === 'sigma') {
      this.bar.replaceChildren(span('sigma', 'to right'));
      const scale = metric ? 1000 : 1, first = scale * units.shown('length', u.least_sigma_m.value);
      [1, 10 / 3, 10, 100 / 3, 100].forEach((times) => ticks.push([Math.log10(times) / 2, String(Number((first * times).toPrecision(1)))]));
      this.#name('standard deviation', '', metric ? 'mm' : units.symbol('length'));
    } else {
      this.bar.replaceChildren(span('loose', 'to right'));
      for (const m of [0, 0.5, 1]) ticks.push([m, format.percent(m)]);
      this.#name('bank', 'loose, as clods');
    }
    const wide = mode === 'height' ? ' wide-ticks' : mode === 'sigma' ? ' many-ticks' : '';
    this.ticks.className = `ticks${wide}`;
    this.ticks.replaceChildren(...ticks.map(([at, text]) => h('span', {style: `left:${100 * at}%`}, text)));
  }

  #name(left, right, unit = '') {
    this.names.replaceChildren(...[left, unit, right].map((text) => h('span', {}, text)));
    this.unknown.hidden = !kPlain[this.mode];
    setText(this.unknown, kPlain[this.mode] ?? '');
  }
}
