// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Measures: points that people place, and the server's results. Boundary: cut, fill and net inside;
// section: the profile; height of a point; distance between two points. Those with a name are kept
// by the server, and all who look have them.
import * as api from './api.js';

export const kTools = {
  look: {name: 'Look', key: 'v', hint: ''},
  boundary: {name: 'Boundary', key: 'b', least: 3, hint: 'Click corners on the ground; the first corner again, or Done, closes the boundary'},
  section: {name: 'Section', key: 's', least: 2, most: 2, hint: 'Click where the section begins and where it ends'},
  height: {name: 'Height', key: 'h', least: 1, most: 1, hint: 'Click on the ground'},
  distance: {name: 'Distance', key: 'd', least: 2, most: 2, hint: 'Click two points'},
};
export const kAgainOffline_ms = 2000;   // until what had no connection is asked again
/** What is said of an error. */
export const said = (error) => (error.offline ? `${error.message}; it will be asked again` : error.message);
const kReloaded = 'soilvdb-measures';
const kSectionPoints = 500;
const kAgain_ms = 2000;   // shortest time between queries of live figures
const kProgressAgain_ms = 30000, kProgressWithin_ms = 300000;   // many earlier grounds may have to be dug again

export class Measures {
  tool = 'look';
  /** Points of the unfinished measure, in the world. @type {number[][]} */
  draft = [];
  /** Shown. `kept` is the server's number of a measure with a name.
   * @type {{id: number, letter: string, kind: string, points: number[][], values: ?Object, error: ?string, old: boolean, kept: ?number, name: string, progress: ?Object}[]} */
  list = [];
  /** All with a name. @type {{id: number, kind: string, name: string, points: number[][]}[]} */
  named = [];
  mayChange = false;
  hasNamed = false;   // before the server has sent them
  /** The measure whose points and name are being edited, and its points before. @type {?{measure: Object, before: number[][], moved: boolean}} */
  edited = null;
  #letters = 0;
  #ids = 0;
  #queried = 0;
  #stale = false;

  /**
   * @param {function(): Object} query time and against of the shown ground
   * @param {function()} changed
   */
  constructor(query, changed) {
    Object.assign(this, {query, changed});
  }

  choose(tool) {
    this.tool = tool;
    this.draft = [];
    this.changed();
  }

  /** Called for a placed point. @param {number[]} point in the world */
  place(point) {
    const {most} = kTools[this.tool];
    if (this.tool === 'look') return;
    this.draft.push(point);
    if (this.draft.length === most) this.finish();
    else this.changed();
  }

  undo() {
    this.draft.pop();
    this.changed();
  }

  /** @return {boolean} whether there were enough points */
  finish() {
    if (this.tool === 'look' || this.draft.length < kTools[this.tool].least) return false;
    const number = this.#letters++;
    const letter = String.fromCharCode(65 + (number % 26)) + (number >= 26 ? Math.floor(number / 26) : '');
    this.#show({letter, kind: this.tool, points: this.draft});
    this.draft = [];
    this.changed();
    return true;
  }

  /** What is shown and what is being drawn, for this page when it is loaded again. */
  keepForReload() {
    const shown = this.list.map(({letter, kind, points, kept, name}) => ({letter, kind, points, kept, name}));
    try {
      sessionStorage.setItem(kReloaded, JSON.stringify({shown, letters: this.#letters, tool: this.tool, draft: this.draft}));
    } catch { /* some browser settings forbid storage */ }
  }

  restore() {
    let of = null;
    try {
      of = JSON.parse(sessionStorage.getItem(kReloaded));
      sessionStorage.removeItem(kReloaded);
    } catch { /* as above */ }
    if (!of) return;
    this.#letters = of.letters;
    for (const measure of of.shown.reverse()) this.#show(measure);
    this.choose(of.tool);
    this.draft = of.draft;
    this.changed();
  }

  #show(of) {
    const measure = {id: this.#ids++, letter: '', kept: null, name: '', values: null, error: null, old: false, progress: null, ...of};
    this.list.unshift(measure);
    this.#ask(measure);
    return measure;
  }

  /** Shows it no longer. One with a name stays on the server. */
  remove(id) {
    if (this.edited?.measure.id === id) this.edited = null;
    this.list = this.list.filter((m) => m.id !== id);
    this.changed();
  }

  /** The server's list. */
  takeNamed({measures, may_change: mayChange, link_token: linkToken}) {
    Object.assign(this, {named: measures, mayChange, linkToken, hasNamed: true});
    for (const measure of this.list.filter((m) => m.kept !== null)) {
      const now = measures.find((m) => m.id === measure.kept);
      if (!now) this.remove(measure.id);
      else this.#renew(measure, now);
    }
    this.changed();
  }

  #renew(measure, {name, points}) {
    measure.name = name;
    const edits = this.edited?.measure === measure, old = edits ? this.edited.before : measure.points;
    if (old.length === points.length && old.every((p, i) => p[0] === points[i][0] && p[1] === points[i][1])) return;
    if (edits) this.edited.before = points;   // what is being edited stays as it is
    else this.move(measure, points);
  }

  /** Shows a measure with a name. @return {?Object} null if there is none with this number */
  open(number) {
    const shown = this.list.find((m) => m.kept === number), of = this.named.find((m) => m.id === number);
    if (shown || !of) return shown ?? null;
    const measure = this.#show({kind: of.kind, points: of.points, kept: of.id, name: of.name});
    this.changed();
    return measure;
  }

  edit(measure) {
    this.cancelEdit();
    this.edited = {measure, before: measure.points, moved: false};
    this.tool = 'look';   // so that clicks take its points
    this.draft = [];
    this.changed();
  }

  cancelEdit() {
    if (!this.edited) return;
    const {measure, before} = this.edited;
    this.edited = null;
    if (measure.points !== before) this.move(measure, before);
    this.changed();
  }

  /** @param {boolean} ask for its figures, too */
  move(measure, points, ask = true) {
    if (this.edited?.measure === measure) this.edited.moved = true;
    measure.points = points;
    measure.progress = null;
    measure.old = true;
    if (ask) this.#ask(measure);
    this.changed();
  }

  /** Keeps what was edited. A measure without a name stays on this page only. */
  async endEdit(name) {
    const {measure, moved} = this.edited, points = measure.points.map((p) => [p[0], p[1]]);
    if (measure.kept !== null) {
      await api.postJson('/measures', {change: {id: measure.kept, name, ...(moved ? {points} : {})}});
    } else if (name) {   // an answer to the first attempt may have been lost
      const made = this.named.find((m) => m.kind === measure.kind && m.name === name && JSON.stringify(m.points) === JSON.stringify(points));
      measure.kept = (made ?? await api.postJson('/measures', {add: {kind: measure.kind, name, points}})).id;
    }
    const before = this.edited?.before;
    Object.assign(measure, {name});
    this.edited = null;
    if (!moved && before && before !== measure.points) this.move(measure, before);   // somebody else moved it
    this.changed();
  }

  /** Removes a measure with a name for all who look. */
  async discard(measure) {
    await api.postJson('/measures', {remove: measure.kept});
    this.remove(measure.id);
  }

  /** The address of the page with this measure. */
  link(measure) {
    const url = new URL(location.href), hash = new URLSearchParams({measure: measure.kept});
    if (this.linkToken) hash.set('token', this.linkToken);
    url.hash = hash;
    return url.href;
  }

  /** Asks how far an area is, unless the answer is new enough. */
  async askProgress(measure) {
    const {progress} = measure;
    if (progress?.asking || performance.now() - (progress?.asked ?? -Infinity) < kProgressAgain_ms) return;
    const mine = (measure.progress = {...progress, asking: true, asked: performance.now()});
    let answer;
    try {
      const [area] = (await api.getJson('/progress', {measure: measure.kept}, kProgressWithin_ms)).areas;
      answer = {area, error: area.error ?? null};
    } catch (error) {
      answer = {area: null, error: said(error), asked: error.offline ? performance.now() - kProgressAgain_ms + kAgainOffline_ms / 2 : mine.asked};
      if (error.offline) setTimeout(this.changed, kAgainOffline_ms);   // asks for what is in sight
    }
    if (measure.progress !== mine) return;   // its points were moved
    measure.progress = {...mine, ...answer, asking: false};
    this.changed();
  }

  /** Called when other ground is shown. @param {boolean} fade whether figures are out of date */
  again(fade = true) {
    for (const measure of this.list) {
      measure.old ||= fade;
      this.#ask(measure);
    }
    this.#queried = performance.now();
    this.#stale = false;
    this.changed();
  }

  /** Called when live ground has changed; repeats the queries at a limited rate. */
  groundChanged() {
    this.#stale = true;
    const wait = this.#queried + kAgain_ms - performance.now();
    if (wait > 0) {
      if (!this.timer) this.timer = setTimeout(() => { this.timer = null; if (this.#stale) this.again(false); }, wait);
    } else if (this.list.length > 0) {
      this.again(false);
    }
  }

  async #ask(measure) {
    const asked = (measure.asked = {});   // only the answer to the latest query counts
    try {
      const values = await this.#values(measure);
      if (measure.asked !== asked) return;
      Object.assign(measure, {values, error: null, old: false});
    } catch (error) {
      if (measure.asked !== asked) return;
      Object.assign(measure, {error: said(error), old: false});
      if (error.offline) setTimeout(() => { if (measure.asked === asked && this.list.includes(measure)) this.#ask(measure); }, kAgainOffline_ms);
    }
    this.changed();
  }

  async #values({kind, points}) {
    const query = this.query(), xy = (p) => `${p[0].toFixed(4)},${p[1].toFixed(4)}`;
    if (kind === 'boundary') return api.getJson('/volume', {boundary: points.map(xy).join(','), ...query});
    if (kind === 'section') {
      return api.getJson('/section', {from: xy(points[0]), to: xy(points[1]), points: kSectionPoints, ...query});
    }
    const heights = await Promise.all(points.map((p) =>
      api.getJson('/height', {x: p[0].toFixed(4), y: p[1].toFixed(4), time: query.time, against: query.against})));
    if (kind === 'height') return heights[0];
    const [a, b] = points, [za, zb] = heights.map((v) => v.height_m);
    const level_m = Math.hypot(b[0] - a[0], b[1] - a[1]), rise_m = za === null || zb === null ? null : zb - za;
    return {level_m, rise_m, slope_m: rise_m === null ? null : Math.hypot(level_m, rise_m)};
  }
}
