// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Measures: points that people place, and the server's results. Boundary: cut, fill and net inside;
// section: the profile; height of a point; distance between two points.
import * as api from './api.js';

export const kTools = {
  look: {name: 'Look', key: 'v', hint: ''},
  boundary: {name: 'Boundary', key: 'b', least: 3, hint: 'Click corners on the ground; the first corner again, or Done, closes the boundary'},
  section: {name: 'Section', key: 's', least: 2, most: 2, hint: 'Click where the section begins and where it ends'},
  height: {name: 'Height', key: 'h', least: 1, most: 1, hint: 'Click on the ground'},
  distance: {name: 'Distance', key: 'd', least: 2, most: 2, hint: 'Click two points'},
};
const kSectionPoints = 500;
const kAgain_ms = 2000;   // shortest time between queries of live figures

export class Measures {
  tool = 'look';
  /** Points of the unfinished measure, in the world. @type {number[][]} */
  draft = [];
  /** @type {{id: number, letter: string, kind: string, points: number[][], values: ?Object, error: ?string, old: boolean}[]} */
  list = [];
  #letters = 0;
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
    const measure = {id: number, letter, kind: this.tool, points: this.draft, values: null, error: null, old: false};
    this.list.unshift(measure);
    this.draft = [];
    this.#ask(measure);
    this.changed();
    return true;
  }

  remove(id) {
    this.list = this.list.filter((m) => m.id !== id);
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
      Object.assign(measure, {error: error.message, old: false});
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
