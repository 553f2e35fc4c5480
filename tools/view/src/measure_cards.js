// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Measures as cards beside the picture.
import {$, h, setText, svg} from './dom.js';
import * as format from './format.js';
import {editForm} from './measure_form.js';
import {progressFigures} from './progress.js';
import {sectionChart} from './section_chart.js';
import {hint} from './surroundings.js';

const kTitles = {boundary: 'Boundary', section: 'Section', height: 'Point', distance: 'Distance'};

const value = (name, text, kind = '') => h('div', {class: kind}, h('dt', {}, name), h('dd', {}, text));

function figures(measure) {
  const v = measure.values;
  if (measure.kind === 'boundary') {
    return [
      value('Cut', format.volume(v.cut_m3), 'cut'), value('Fill', format.volume(v.fill_m3), 'fill'),
      value('Net', format.signedVolume(v.net_m3)), value('Area', format.area(v.area_m2)),
      v.off_site_m2 > 0 ? value('Without ground', format.area(v.off_site_m2)) : null,
      v.design_area_m2 < v.area_m2 * (1 - 1e-6) ? value('Design covers', format.area(v.design_area_m2)) : null,
      v.to_cut_m3 === undefined || v.to_cut_m3 === null ? null : value('Still to cut', format.volume(v.to_cut_m3), 'cut'),
      v.to_fill_m3 === undefined || v.to_fill_m3 === null ? null : value('Still to fill', format.volume(v.to_fill_m3), 'fill'),
    ];
  }
  if (measure.kind === 'section') {
    return [
      value('Length', format.length(v.distance_m[v.distance_m.length - 1])),
      value('Cut', format.area(v.cut_m2), 'cut'), value('Fill', format.area(v.fill_m2), 'fill'),
    ];
  }
  if (measure.kind === 'height') {
    const change = v.height_m === null || v.before_m === null ? null : v.height_m - v.before_m;
    const left = v.design_m === undefined || v.design_m === null || v.height_m === null ? null : v.height_m - v.design_m;
    return [
      value('Height', format.height(v.height_m, 3)), value('Before', format.height(v.before_m, 3)),
      value('Change', format.signedLength(change), change < 0 ? 'cut' : change > 0 ? 'fill' : ''),
      left === null ? null : value(left > 0 ? 'Still to cut' : 'Still to fill', format.length(Math.abs(left)), left > 0 ? 'cut' : 'fill'),
    ];
  }
  return [
    value('Level', format.length(v.level_m)), value('Rise', format.signedLength(v.rise_m)),
    value('Along the slope', format.length(v.slope_m)),
    value('Grade', v.rise_m === null || v.level_m === 0 ? format.kNone : format.withUnit((100 * v.rise_m) / v.level_m, '%')),
  ];
}

const icon = (path, ...more) => svg('svg', {viewBox: '0 0 20 20', 'aria-hidden': 'true'}, svg('path', {d: path}), ...more);
const action = (text, act) => h('button', {class: 'link', type: 'button', onclick: (event) => act(event.detail === 0)}, text);
const titleOf = (measure) => `${kTitles[measure.kind]} ${measure.name || measure.letter}`;

export class MeasureCards {
  /**
   * @param {import('./measures.js').Measures} measures @param {boolean} hasDesign
   * @param {function(Object, ?number)} hover along a section @param {function(Object)} goTo
   */
  constructor(measures, hasDesign, hover, goTo) {
    Object.assign(this, {measures, hasDesign, hover, goTo});
    this.cards = new Map();
  }

  update() {
    const {list, named} = this.measures;
    $('measures-empty').hidden = list.length > 0 || named.length > 0;
    const count = list.filter((m) => m.kept === null).length + named.length;
    setText($('measure-count'), count > 0 ? String(count) : '');
    this.#updateNamed();
    const kept = new Set(list.map((m) => m.id));
    for (const [id, card] of this.cards) {
      if (kept.has(id)) continue;
      card.element.remove();
      this.cards.delete(id);
    }
    list.forEach((measure, i) => {
      const card = this.cards.get(measure.id) ?? this.#make(measure);
      const place = $('measure-list');
      if (place.children[i] !== card.element) place.insertBefore(card.element, place.children[i] ?? null);
      card.element.classList.toggle('old', measure.old);
      this.#name(card, measure);
      this.#updateForm(card, measure);
      if (card.progress && card.shown !== measure.progress) {
        card.shown = measure.progress;
        card.progress.replaceChildren(...progressFigures(measure.progress));
      }
      if (card.values === measure.values && card.error === measure.error && card.points === measure.points) return;
      Object.assign(card, {values: measure.values, error: measure.error, points: measure.points});
      if (card.values || card.error !== null) this.#fill(card, measure);
    });
    this.askProgress();
  }

  /** Areas with progress in sight are asked again after a while. */
  askProgress() {
    for (const measure of this.measures.list) {
      if (this.cards.get(measure.id)?.details?.open && this.measures.edited?.measure !== measure) this.measures.askProgress(measure);
    }
  }

  /** All with a name, as buttons that show them. */
  #updateNamed() {
    const {list, named} = this.measures, shown = new Map(list.filter((m) => m.kept !== null).map((m) => [m.kept, m]));
    const key = JSON.stringify(named.map(({id, name, kind}) => [id, name, kind, shown.has(id)]));
    if (key === this.namedKey) return;
    this.namedKey = key;
    const focused = $('named').contains(document.activeElement) ? document.activeElement.dataset.id : null;
    $('named').hidden = named.length === 0;
    $('named').replaceChildren(...named.map(({id, name, kind}) => h('li', {},
      h('button', {type: 'button', 'data-id': id, 'aria-pressed': String(shown.has(id)), title: name, onclick: () => this.#toggle(id)},
        h('span', {}, name), h('small', {}, kTitles[kind])))));
    if (focused !== null) $('named').querySelector(`[data-id="${focused}"]`)?.focus();
  }

  #toggle(id) {
    const shown = this.measures.list.find((m) => m.kept === id);
    if (shown) this.measures.remove(shown.id);
    else this.goTo(this.measures.open(id));
  }

  /** Shows all figures again, in other units. */
  refresh() {
    for (const card of this.cards.values()) {
      card.shown = undefined;
      if (card.values !== null) card.values = undefined;
    }
    this.update();
  }

  #make(measure) {
    const body = h('div', {}, h('p', {class: 'faint'}, 'Asking\u2026')), title = h('h3', {}), letter = h('span', {class: 'letter', 'aria-hidden': 'true'}, measure.letter);
    const go = h('button', {class: 'button', type: 'button', title: 'Go there', onclick: () => this.goTo(measure)},
      icon('M10 1v5m0 8v5M1 10h5m8 0h5', svg('circle', {cx: 10, cy: 10, r: 5})));
    const close = h('button', {class: 'button', type: 'button', onclick: () => this.measures.remove(measure.id)}, icon('m5 5 10 10M15 5 5 15'));
    const actions = h('p', {class: 'actions'}), link = h('input', {class: 'field', readonly: true, hidden: true, 'aria-label': 'Link'});
    const element = h('article', {class: 'card', 'data-kind': measure.kind}, h('header', {}, letter, title, go, close), body, actions, link);
    const card = {element, body, title, letter, go, close, actions, link, form: null, values: null, error: null};
    this.cards.set(measure.id, card);
    return card;
  }

  /** What depends on the name, and on whether there is one. */
  #name(card, measure) {
    const key = JSON.stringify([measure.name, measure.kept, this.measures.mayChange]);
    if (key === card.key) return;
    card.key = key;
    const title = titleOf(measure);
    card.letter.hidden = measure.name !== '';
    card.title.replaceChildren(...(measure.name ? [h('span', {title: measure.name}, measure.name), ' ', h('small', {}, kTitles[measure.kind])] : [kTitles[measure.kind]]));
    card.element.setAttribute('aria-label', title);
    card.go.setAttribute('aria-label', `Go to ${title}`);
    card.close.title = measure.kept === null ? 'Remove' : 'Show no longer';
    card.close.setAttribute('aria-label', measure.kept === null ? `Remove ${title}` : `Show ${title} no longer`);
    const {mayChange} = this.measures, edit = (byKeys) => {
      this.measures.edit(measure);
      if (byKeys || measure.kept === null) card.form.querySelector('input').focus();   // else no keyboard covers a phone
    };
    card.actions.replaceChildren(...[
      mayChange ? action(measure.kept === null ? 'Name and keep' : 'Edit', edit) : null,
      measure.kept === null ? null : action('Copy link', () => this.#copyLink(card, measure)),
    ].filter(Boolean));
    if (measure.kept !== null && measure.kind === 'boundary' && this.hasDesign && !card.details) {
      card.progress = h('div', {});
      card.details = h('details', {class: 'progress', ontoggle: () => this.askProgress()}, h('summary', {}, 'Progress to design'), card.progress);
      card.actions.before(card.details);
    }
  }

  async #copyLink(card, measure) {
    const address = this.measures.link(measure);
    const needs = this.measures.linkToken === null ? ' Whoever opens it must add a token.' : '';
    try {
      await navigator.clipboard.writeText(address);
      hint(`The link to ${measure.name} is copied.${needs}`, 4);
    } catch {   // browsers let only pages of https and of this computer do so
      card.link.hidden = false;
      card.link.value = address;
      card.link.select();
      hint(`Copy the link below ${measure.name}.${needs}`, 4);
    }
  }

  /** The form of the measure that is being edited. */
  #updateForm(card, measure) {
    const edits = this.measures.edited?.measure === measure;
    if (edits !== (card.form !== null)) {
      card.form?.remove();
      card.form = edits ? editForm(this.measures, measure) : null;
      card.actions.hidden = edits;
      if (card.form) card.element.querySelector('header').after(card.form);
    }
    if (card.form) card.form.showPoints();
  }

  #fill(card, measure) {
    if (measure.error !== null) {
      card.body.replaceChildren(h('p', {class: 'error'}, measure.error));
      return;
    }
    const focused = card.body.contains(document.activeElement);
    card.body.replaceChildren(h('dl', {class: 'values'}, ...figures(measure)));
    if (measure.kind === 'section') card.body.append(sectionChart(measure.values, (d) => this.hover(measure, d)));
    if (focused) card.body.querySelector('.chart')?.focus();
    if (measure.kind === 'height') {
      const [x, y] = measure.points[0];
      card.body.append(h('p', {class: 'faint'}, `E ${format.coordinate(x)}  N ${format.coordinate(y)}`));
    }
  }
}
