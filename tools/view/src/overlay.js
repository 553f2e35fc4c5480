// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Boundaries, sections and points as lines over the picture, draped on the ground.
import {Vector3} from 'three';
import {svg} from './dom.js';
import * as format from './format.js';
import {boxesOver, boxOf, placeTag} from './tag_place.js';

const kDrape = 24;   // points along each side
const kLetter = {width: 22, height: 22};   // pixels
const kLetter_px = 7, kMostLetters = 24;   // of a name
const kHandle_px = 16, kAbove_px = 10;

export class Overlay {
  #draped = new Map();
  #onGround = new Map();   // heights by place
  cursor = null;   // the pointer's place on the ground, in the scene
  spot = null;     // the place pointed at in a section's chart, in the scene
  letters = [];    // boxes of the measures' letters, pixels

  /** @param {SVGElement} element @param {import('./scene_view.js').SceneView} sceneView @param {import('./ground_pick.js').GroundPick} pick */
  constructor(element, sceneView, pick, measures, origin) {
    Object.assign(this, {element, sceneView, pick, measures, origin});
  }

  /** In the scene; a point without a height is on the ground. */
  local(p) {
    const x = p[0] - this.origin[0], y = p[1] - this.origin[1];
    if (p.length > 2) return new Vector3(x, y, p[2] - this.origin[2]);
    const key = p.join();
    if (!this.#onGround.has(key)) {
      const {low, high} = this.pick.terrain, z = this.pick.heightAt(x, y);
      if (z === null) return new Vector3(x, y, Number.isFinite(low) ? (low + high) / 2 : 0);
      this.#onGround.set(key, z);
    }
    return new Vector3(x, y, this.#onGround.get(key));
  }

  /** Called when the ground has changed, so that lines follow it. */
  drapeAgain() {
    this.#draped.clear();
    this.#onGround.clear();
  }

  /** Points on the ground along the lines between places. */
  #drape(points, closed) {
    const key = points.map((p) => p.join()).join(';') + closed;
    const known = this.#draped.get(key);
    if (known) return known;
    const out = [], ends = points.map((p) => this.local(p));
    if (closed) ends.push(ends[0]);
    for (let i = 0; i + 1 < ends.length; ++i) {
      for (let k = 0; k < kDrape; ++k) {
        const p = ends[i].clone().lerp(ends[i + 1], k / kDrape);
        p.z = this.pick.heightAt(p.x, p.y) ?? p.z;
        out.push(p);
      }
    }
    const last = ends[ends.length - 1].clone();
    last.z = this.pick.heightAt(last.x, last.y) ?? last.z;
    out.push(last);
    this.#draped.set(key, out);
    return out;
  }

  #path(points) {
    let path = '', pen = false;
    for (const p of points) {
      const px = this.sceneView.project(p);
      if (px) path += `${pen ? 'L' : 'M'}${px[0].toFixed(1)} ${px[1].toFixed(1)}`;
      pen = px !== null;
    }
    return path;
  }

  #shape(points, closed, letter, handles = false) {
    const line = this.#path(points.length > 1 ? this.#drape(points, closed) : []);
    const parts = [svg('path', {class: 'mark-halo', d: line}), svg('path', {class: 'mark-line', d: line})];
    if (closed) parts.unshift(svg('path', {class: 'mark-area', d: line}));
    points.forEach((p, i) => {
      const px = this.sceneView.project(this.local(p));
      if (!px) return;
      parts.push(svg('circle', {class: 'mark-dot', cx: px[0], cy: px[1], r: handles ? 8 : 4}));
      if (i === 0 && letter) parts.push(...this.#letter(px, letter));
    });
    return parts;
  }

  /** A letter or name on the measure's first point, or beside what is there. */
  #letter([x, y], words) {
    const {width, height} = this.sceneView, half = kLetter.height / 2;
    if (x < 0 || y < 0 || x > width || y > height) return [];
    const letters = [...words], text = letters.length > kMostLetters ? `${letters.slice(0, kMostLetters - 1).join('')}\u2026` : words;
    const size = {width: letters.length > 2 ? 16 + kLetter_px * Math.min(letters.length, kMostLetters) : kLetter.width, height: kLetter.height};
    const wanted = letters.length > 2 ? [x, y - kAbove_px] : [x, y + half];   // a name leaves the point to be seen
    const place = placeTag(wanted, size, this.sceneView, [...this.over, ...this.letters]);
    if (!place) return [];
    this.letters.push(boxOf(place, size));
    const at = [place[0], place[1] - half];
    return [svg('path', {class: 'mark-line', d: `M${x} ${y}L${at}`}),
      svg('rect', {class: 'mark-dot', x: at[0] - size.width / 2 + 2, y: at[1] - 9, width: size.width - 4, height: 18, rx: 9}),
      svg('text', {class: 'mark-letter', x: at[0], y: at[1]}, text)];
  }

  /** Redraws everything after each picture. */
  draw() {
    const {list, draft, tool} = this.measures;
    this.letters = [];
    if (list.length === 0 && draft.length === 0 && !this.spot && this.element.childElementCount === 0) return;
    const parts = [];
    this.over = boxesOver();
    for (const m of [...list].reverse()) {
      parts.push(...this.#shape(m.points, m.kind === 'boundary', m.name || m.letter, this.measures.edited?.measure === m));
    }
    if (draft.length > 0) {
      parts.push(...this.#shape(draft, false, ''));
      if (this.cursor) {
        const from = this.local(draft[draft.length - 1]), line = this.#path([from, this.cursor]);
        parts.push(svg('path', {class: 'mark-halo', d: line}), svg('path', {class: 'mark-line', d: line, 'stroke-dasharray': '5 4'}));
        const px = this.sceneView.project(this.cursor);
        if (px && tool !== 'boundary') {
          const level = Math.hypot(this.cursor.x - from.x, this.cursor.y - from.y);
          parts.push(svg('text', {class: 'mark-text', x: px[0], y: px[1] - 14}, format.length(level)));
        }
      }
    }
    if (this.spot) {
      const px = this.sceneView.project(this.spot);
      if (px) parts.push(svg('circle', {class: 'mark-dot', cx: px[0], cy: px[1], r: 6}));
    }
    this.element.replaceChildren(...parts);
  }

  /** Marks a place at a distance along a section; null: no mark. */
  pointAt(measure, distance_m) {
    if (distance_m === null) {
      this.spot = null;
    } else {
      const [a, b] = measure.points.map((p) => this.local(p));
      const p = a.clone().lerp(b, distance_m / Math.hypot(b.x - a.x, b.y - a.y));
      p.z = this.pick.heightAt(p.x, p.y) ?? p.z;
      this.spot = p;
    }
    this.sceneView.changed();
  }

  /** The index of the edited measure's point at a pixel, or -1. */
  handleAt(x, y) {
    let nearest = -1, least = kHandle_px;
    this.measures.edited?.measure.points.forEach((p, i) => {
      const px = this.sceneView.project(this.local(p)), far = px ? Math.hypot(px[0] - x, px[1] - y) : Infinity;
      if (far < least) [nearest, least] = [i, far];
    });
    return nearest;
  }

  /** Whether a pixel is on the draft's first point, where a click closes a boundary. */
  closes(x, y) {
    const {draft, tool} = this.measures;
    if (tool !== 'boundary' || draft.length < 3) return false;
    const px = this.sceneView.project(this.local(draft[0]));
    return px !== null && Math.hypot(px[0] - x, px[1] - y) < 14;
  }
}
