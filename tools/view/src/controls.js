// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Input in the picture: tools, clicks that place points, keys, and the camera's buttons.
import {$, h, svg} from './dom.js';
import * as format from './format.js';
import {kTools} from './measures.js';
import {hint} from './surroundings.js';
import * as units from './units.js';

const kIcons = {
  look: 'M3 12s3.5-6 9-6 9 6 9 6-3.5 6-9 6-9-6-9-6zm9-2.5a2.5 2.5 0 1 0 0 5 2.5 2.5 0 1 0 0-5z',
  boundary: 'M5 6l12-2 3 11-9 6-8-6z', section: 'M3 18h4l3-7 4 4 3-9h4M3 21.5h18',
  height: 'M12 21v-9m0 0 4 4m-4-4-4 4M4 4.5h16', distance: 'M4 20 20 4M4 14v6h6M14 4h6v6',
};
const kClick_px = 6, kClick_ms = 600;

export class Controls {
  /** @param {Object} parts sceneView, pick, overlay, measures, origin; fitSite, fitWork, begun, done; more: texts about a place; keys: functions by key */
  constructor(parts) {
    Object.assign(this, parts);
    this.buttons = Object.entries(kTools).map(([tool, {name, key}]) => {
      const button = h('button', {
        type: 'button', role: 'radio', 'data-tool': tool, 'aria-checked': 'false', 'aria-keyshortcuts': key,
        title: `${name} (${key.toUpperCase()})`, onclick: (event) => this.#begin(tool, event.detail === 0),
      }, svg('svg', {viewBox: '0 0 24 24', 'aria-hidden': 'true'}, svg('path', {d: kIcons[tool]})), h('span', {}, name));
      $('tools').append(button);
      return button;
    });
    this.choose('look');
    this.#listenToPointer();
    this.#listenToHandles();
    addEventListener('keydown', (event) => this.#key(event));
    $('north').onclick = () => this.north();
    $('above').onclick = () => this.above();
    $('whole').onclick = () => this.fitSite();
    $('work').onclick = () => this.fitWork();
    const then = (act) => (event) => {
      act();
      if (event.detail === 0 && $('draft').hidden) this.sceneView.canvas.focus();   // the pressed key's button is gone
    };
    $('undo').onclick = then(() => this.measures.undo());
    $('done').onclick = then(() => this.#finish());
  }

  /** On small screens a panel leaves too little of the picture to draw in. */
  #begin(tool, byKeys) {
    this.choose(tool, byKeys);
    if (tool !== 'look') this.begun();
  }

  /** @param {boolean} byKeys then the cross in the middle places points */
  choose(tool, byKeys = false) {
    $('stage').dataset.tool = tool;
    this.measures.choose(tool);
    for (const button of this.buttons) {
      button.setAttribute('aria-checked', String(button.dataset.tool === tool));
      button.tabIndex = 0;
    }
    const words = kTools[tool].hint;
    hint(matchMedia('(pointer: coarse)').matches ? words?.replace('Click', 'Tap') : words);
    if (byKeys && tool !== 'look') this.sceneView.canvas.focus();
    this.hovered = false;
  }

  unitsChanged() {
    this.hovered = false;
  }

  /** Buttons to undo and end an unfinished measure. */
  showDraft() {
    const {draft, tool} = this.measures, {least, most} = kTools[tool];
    if ($('stage').dataset.tool !== tool) return this.choose(tool);
    $('draft').hidden = draft.length === 0;
    $('done').hidden = most !== undefined;
    $('done').disabled = draft.length < least;
    this.hovered = false;
  }

  north() {
    const {sceneView} = this, from = sceneView.camera.position.clone().sub(sceneView.controls.target);
    sceneView.lookAt(sceneView.controls.target, sceneView.distance, {azimuth: 0, elevation: Math.asin(Math.min(1, from.z / from.length()))});
  }

  above() {
    this.sceneView.lookAt(this.sceneView.controls.target, this.sceneView.distance, {azimuth: this.sceneView.azimuth, elevation: 0.499 * Math.PI});
  }

  #world(p) {
    return [p.x + this.origin[0], p.y + this.origin[1], p.z + this.origin[2]];
  }

  #listenToPointer() {
    const {canvas} = this.sceneView;
    let down = null, touches = 0;
    canvas.addEventListener('pointerdown', (event) => {
      touches = event.isPrimary ? 1 : touches + 1;
      down = event.button === 0 && touches === 1 ? {x: event.clientX, y: event.clientY, time: event.timeStamp} : null;
    });
    canvas.addEventListener('pointerup', (event) => {
      if (!down || Math.hypot(event.clientX - down.x, event.clientY - down.y) > kClick_px ||
          event.timeStamp - down.time > kClick_ms) return;
      down = null;
      const [x, y] = this.#pixel(event);
      this.#point(x, y);
    });
    canvas.addEventListener('dblclick', () => this.#finish());
    canvas.addEventListener('pointermove', (event) => {
      this.pointer = event.pointerType === 'touch' ? null : this.#pixel(event);
      this.hovered = false;
      if (this.measures.draft.length > 0) this.sceneView.changed();
    });
    canvas.addEventListener('pointerleave', () => {
      this.pointer = null;
      this.hovered = false;
    });
    for (const type of ['focus', 'blur']) canvas.addEventListener(type, () => { this.hovered = false; });
  }

  /** Points of the edited measure are dragged, instead of the ground. */
  #listenToHandles() {
    const {canvas} = this.sceneView, {measures} = this;
    let held = -1;
    $('stage').addEventListener('pointerdown', (event) => {
      if (event.target !== canvas || event.button !== 0 || !measures.edited || measures.tool !== 'look') return;
      held = this.overlay.handleAt(...this.#pixel(event));
      if (held < 0) return;
      event.stopPropagation();
      canvas.setPointerCapture(event.pointerId);
    }, {capture: true});
    canvas.addEventListener('pointermove', (event) => {
      if (held < 0 || !measures.edited) return;
      const p = this.pick.atPixel(...this.#pixel(event)), {measure} = measures.edited;
      if (p) measures.move(measure, measure.points.map((old, i) => (i === held ? this.#world(p) : old)), false);
    });
    const drop = () => {
      if (held >= 0 && measures.edited) measures.move(measures.edited.measure, measures.edited.measure.points);
      held = -1;
    };
    for (const type of ['pointerup', 'pointercancel']) canvas.addEventListener(type, drop);
  }

  #pixel(event) {
    const box = this.sceneView.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  #point(x, y) {
    const {measures} = this;
    if (measures.tool === 'look') return;
    if (this.overlay.closes(x, y)) {
      this.#finish();
      return;
    }
    const p = this.pick.atPixel(x, y);
    if (!p) {
      hint('There is no ground here', 2);
      return;
    }
    const last = measures.draft[measures.draft.length - 1], at = this.#world(p);
    if (last && Math.hypot(at[0] - last[0], at[1] - last[1]) < 1e-6) return;   // the second click of a double click
    measures.place(at);
    if (measures.draft.length === 0) this.done();
  }

  /** @return {boolean} whether there were enough points */
  #finish() {
    if (this.measures.tool !== 'boundary' || !this.measures.finish()) return false;
    this.done();
    return true;
  }

  get #crosshair() {
    const {canvas, width, height} = this.sceneView;
    return this.measures.tool !== 'look' && canvas.matches(':focus-visible') ? [width / 2, height / 2] : null;
  }

  /** Updates the place on the ground of the pointer, or of the cross, at most once per frame. */
  hover() {
    const {frames} = this.sceneView, at = this.pointer ?? this.#crosshair;
    if (this.hovered && (this.pointer || !at || this.hoveredFrame === frames)) return;
    this.hovered = true;
    this.hoveredFrame = frames;
    const p = at ? this.pick.atPixel(...at) : null, before = this.overlay.cursor;
    this.overlay.cursor = p;
    const text = p ? ['E ', 'N ', 'height '].map((name, axis) => name + format.coordinate(this.#world(p)[axis])) : [];
    $('position').replaceChildren(...text.flatMap((part, axis) => [h('span', {}, axis < 2 ? part : `${part}\u2009${units.symbol('length')}`), ' ']));
    if (p) $('position').append(...this.more(this.#world(p)).map((part) => h('span', {}, part)));
    if (this.measures.draft.length > 0 && !(p && before?.equals(p)) && p !== before) this.sceneView.changed();
  }

  #key(event) {
    const inField = event.target.closest('input:not([type=checkbox]), select, textarea, dialog');
    if (event.ctrlKey || event.metaKey || event.altKey || inField) return;
    const onCanvas = event.target === this.sceneView.canvas, key = event.key;
    const tool = Object.keys(kTools).find((t) => kTools[t].key === key.toLowerCase());
    if (onCanvas) this.pointer = null;   // keys move the ground below the cross
    if (tool) this.choose(tool, true);
    else if (key === 'Escape') this.measures.draft.length > 0 ? this.measures.choose(this.measures.tool) : this.choose('look');
    else if ((key === 'Enter' || key === ' ') && onCanvas) {
      if (key === ' ' || !this.#finish()) this.#point(this.sceneView.width / 2, this.sceneView.height / 2);
    }
    else if (key === 'Backspace') this.measures.undo();
    else if (key === 'n') this.north();
    else if (key === 't') this.above();
    else if (key === 'f') this.fitSite();
    else if (key === 'g') this.fitWork();
    else if (this.keys[key]) this.keys[key]();
    else return;
    event.preventDefault();
  }
}

/** The scale bar and the compass needle. @param {import('./scene_view.js').SceneView} sceneView */
export function drawScale(sceneView) {
  const about = 90 * sceneView.pixel_m, metres = format.stepDown(about);
  $('scale-bar').style.width = `${(metres / sceneView.pixel_m).toFixed(1)}px`;
  const text = units.unit('length') !== 'm' ? format.step(metres) : metres >= 1000 ? `${metres / 1000}\u2009km` : metres >= 1 ? `${metres}\u2009m` : `${Math.round(100 * metres)}\u2009cm`;
  if ($('scale-text').textContent !== text) $('scale-text').textContent = text;
  $('needle').setAttribute('transform', `rotate(${((-sceneView.azimuth * 180) / Math.PI).toFixed(1)} 12 12)`);
  return metres;
}

