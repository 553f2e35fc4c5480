// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Measures as cards beside the picture.
import {$, h, setText, svg} from './dom.js';
import * as format from './format.js';
import {sectionAreas, sectionChart} from './section_chart.js';

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
    const {cut_m2, fill_m2} = sectionAreas(v);
    return [
      value('Length', format.length(v.distance_m[v.distance_m.length - 1])),
      value('Cut', format.area(cut_m2), 'cut'), value('Fill', format.area(fill_m2), 'fill'),
    ];
  }
  if (measure.kind === 'height') {
    const change = v.height_m === null || v.before_m === null ? null : v.height_m - v.before_m;
    const left = v.design_m === undefined || v.design_m === null || v.height_m === null ? null : v.height_m - v.design_m;
    return [
      value('Height', `${format.coordinate(v.height_m, 3)}\u2009m`), value('Before', `${format.coordinate(v.before_m, 3)}\u2009m`),
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

export class MeasureCards {
  /** @param {import('./measures.js').Measures} measures @param {function(Object, ?number)} hover along a section @param {function(Object)} goTo */
  constructor(measures, hover, goTo) {
    Object.assign(this, {measures, hover, goTo});
    this.cards = new Map();
  }

  update() {
    const {list} = this.measures;
    $('measures-empty').hidden = list.length > 0;
    setText($('measure-count'), list.length > 0 ? String(list.length) : '');
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
      if (card.values === measure.values && card.error === measure.error) return;
      card.values = measure.values;
      card.error = measure.error;
      this.#fill(card, measure);
    });
  }

  #make(measure) {
    const body = h('div', {}, h('p', {class: 'faint'}, 'Asking\u2026'));
    const name = `${kTitles[measure.kind]} ${measure.letter}`;
    const element = h('article', {class: 'card', 'aria-label': name, 'data-kind': measure.kind},
      h('header', {}, h('span', {class: 'letter', 'aria-hidden': 'true'}, measure.letter), h('h3', {}, kTitles[measure.kind]),
        h('button', {class: 'button', type: 'button', title: 'Go there', 'aria-label': `Go to ${name}`, onclick: () => this.goTo(measure)},
          svg('svg', {viewBox: '0 0 20 20', 'aria-hidden': 'true'}, svg('circle', {cx: 10, cy: 10, r: 5}), svg('path', {d: 'M10 1v5m0 8v5M1 10h5m8 0h5'}))),
        h('button', {class: 'button', type: 'button', title: 'Remove', 'aria-label': `Remove ${name}`, onclick: () => this.measures.remove(measure.id)},
          svg('svg', {viewBox: '0 0 20 20', 'aria-hidden': 'true'}, svg('path', {d: 'm5 5 10 10M15 5 5 15'})))),
      body);
    const card = {element, body, values: null, error: null};
    this.cards.set(measure.id, card);
    return card;
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
