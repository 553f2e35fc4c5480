// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The shown time: a slider over the recording, with a tick per snapshot, and the time that changes
// refer to.
import {h, setText, svg} from './dom.js';
import * as format from './format.js';

const kMost = 10000;       // positions of the slider
const kWhileMoving_ms = 250;
const kLongestGap_s = 10 * 365.25 * 86400, kDay_s = 86400;

const icon = (d) => svg('svg', {viewBox: '0 0 20 20', 'aria-hidden': 'true'}, svg('path', {d}));

/**
 * Where the slider begins. A clock that was first at 0 and then counts from 1970 would leave all of
 * the work at the slider's end, so it begins after such a gap, or the last day if no time after the
 * gap but the end is known.
 * @param {{from: number, to: number, snapshots: number[]}} times
 */
export function sliderStart({from, to, snapshots}) {
  const all = [from, ...snapshots.filter((t) => t > from && t < to), to];
  const gaps = all.slice(1).map((t, i) => t - all[i]), largest = Math.max(...gaps);
  if (!(largest > kLongestGap_s)) return from;
  const first = all[gaps.indexOf(largest) + 1];
  return first < to ? first : to - kDay_s;
}

export class Timeline {
  times = null;
  time = null;      // null: the newest
  against = null;   // null: before digging
  #asked = 'null;null';
  #askedAt = 0;
  #waiting = false;
  #connected = true;

  /**
   * @param {HTMLElement} element @param {boolean} live whether machines may still move
   * @param {function(?number, ?number): boolean} ask requests the ground at a time, against
   *     another; returns whether an answer will come
   */
  constructor(element, live, ask) {
    Object.assign(this, {element, live, ask});
    const button = (label, content, onclick, keys) => h('button', {
      class: 'button', type: 'button', 'aria-label': label, title: label, 'aria-keyshortcuts': keys, onclick}, content);
    this.input = h('input', {
      type: 'range', min: 0, max: kMost, value: kMost, 'aria-label': 'Time shown',
      oninput: () => this.#moved(false), onchange: () => this.#moved(true),
    });
    this.ticks = h('div', {class: 'slider-ticks', 'aria-hidden': 'true'});
    this.before = button('Previous snapshot', icon('M13 4 7 10l6 6M5 4v12'), () => this.step(-1), '[');
    this.after = button('Next snapshot', icon('m7 4 6 6-6 6M15 4v12'), () => this.step(1), ']');
    this.now = h('output', {id: 'time-now'});
    this.liveButton = button(live ? 'Show the ground as it is now' : 'Show the end', live ? 'Live' : 'End', () => this.show(null), 'l');
    this.compare = button('Changes from this time on', 'Compare', () => this.toggleAgainst(), 'a');
    this.compare.id = 'compare';
    element.replaceChildren(this.before, h('div', {class: 'slider'}, this.input, this.ticks), this.after, this.now, this.compare, this.liveButton);
  }

  /** @param {?{from: number, to: number, snapshots: number[]}} times null: nothing is recorded */
  setTimes(times) {
    this.element.hidden = times === null;
    if (times === null) return;
    const same = this.times && times.from === this.times.from && times.to === this.times.to &&
                 times.snapshots.length === this.times.snapshots.length;
    this.times = times;
    if (same) return;
    this.start = sliderStart(times);
    if (document.activeElement !== this.input || this.time === null) this.#place();
    this.#drawTicks();
  }

  #share(time) {
    const {start, times: {to}} = this;
    return to > start ? Math.min(1, Math.max(0, (time - start) / (to - start))) : 1;
  }

  #drawTicks() {
    const {snapshots} = this.times, most = 200, every = Math.ceil(snapshots.length / most);
    const ticks = snapshots.filter((t, i) => i % every === 0 && t >= this.start).map((t) => h('i', {style: `left:${100 * this.#share(t)}%`}));
    if (this.against !== null) ticks.push(h('b', {style: `left:${100 * this.#share(this.against)}%`}));
    this.ticks.replaceChildren(...ticks);
  }

  #place() {
    if (!this.times) return;
    this.input.value = String(Math.round(kMost * (this.time === null ? 1 : this.#share(this.time))));
    this.#say();
  }

  #say() {
    const shown = this.time ?? this.times.to, text = format.time(shown), clock = format.clock(shown);
    if (this.now.textContent !== text) this.now.replaceChildren(text.slice(0, text.length - clock.length), h('span', {}, clock));
    this.input.setAttribute('aria-valuetext', format.time(shown));
    this.liveButton.setAttribute('aria-pressed', String(this.time === null && this.#connected));
    this.compare.setAttribute('aria-pressed', String(this.against !== null));
    setText(this.compare, this.against === null ? 'Compare' : `Since ${format.timeBeside(this.against, shown)} ×`);
    const label = this.against === null ? 'Changes from this time on' : `Changes are since ${format.time(this.against)}; show all since before digging`;
    this.compare.title = label;
    this.compare.setAttribute('aria-label', label);
  }

  #moved(done) {
    const {start, times: {to}} = this, at = this.input.valueAsNumber / kMost;
    let time = start + at * (to - start);
    const near = this.times.snapshots.find((t) => Math.abs(this.#share(t) - at) < 0.004);   // snapshots load fast
    if (near !== undefined) time = near;
    this.time = at >= 1 ? null : Number(time.toFixed(3));
    this.#say();
    if (done || performance.now() - this.#askedAt > kWhileMoving_ms) this.#request();
  }

  #request() {
    const asked = `${this.time};${this.against}`;
    if (asked === this.#asked || this.#waiting) return;
    this.#asked = asked;
    this.#askedAt = performance.now();
    this.#waiting = this.ask(this.time, this.against);
  }

  /** Without a connection no other time can be shown. */
  setConnected(connected) {
    this.#connected = connected;
    for (const control of this.element.querySelectorAll('button, input')) control.disabled = !connected;
    if (connected) this.#restore();
    else this.#waiting = false;
    this.#place();
  }

  /** Whether an answer is to come. */
  get waits() {
    return this.#waiting;
  }

  /** Called when the server has answered; requests are sent one at a time, and the latest choice is next. */
  answered() {
    this.#waiting = false;
    if (this.times) this.#request();
  }

  /** Shows the ground at a time; null: the newest. */
  show(time) {
    if (!this.#connected) return;
    this.time = time;
    this.#place();
    this.#request();
  }

  /** Goes to the previous or next snapshot. */
  step(direction) {
    if (!this.times) return;
    const shown = this.time ?? this.times.to, {snapshots, to} = this.times;
    const found = direction < 0 ? snapshots.filter((t) => t < shown - 1e-6).pop() : snapshots.find((t) => t > shown + 1e-6);
    if (found !== undefined) this.show(found >= to && direction > 0 ? null : found);
    else if (direction > 0) this.show(null);
  }

  /** Compares with the time shown now; a second call compares with the ground before digging. */
  toggleAgainst() {
    if (!this.times || !this.#connected) return;
    this.against = this.against === null ? (this.time ?? this.times.to) : null;
    this.#drawTicks();
    this.#place();
    this.#request();
  }

  /** Requests the shown time again, unless it is the live view. */
  #restore() {
    this.#asked = 'null;null';
    this.#waiting = false;
    this.#request();
  }
}
