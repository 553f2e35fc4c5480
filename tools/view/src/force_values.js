// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Forces for people: text, reasons why they are bounds, the largest lately, and the arrows' scale.
import * as format from './format.js';

/** Words of `limited` for a rough estimate, or one that is too high; others are for a force that is too low. */
const kRough = ['steep blade', 'heel', 'lifts'];

const wordsOf = (limited) => (limited === '' ? [] : limited.split(', '));
const isRough = (word) => kRough.includes(word);
const roughText = (word) => (word === 'lifts' ? 'lifts (too high)' : word);

export const sizeOf = (force) => Math.hypot(...force);

/** Two digits: forces are hardly known that well. */
export const kilonewtons = (size_n) => format.withUnit(size_n / 1000, 'kN', 2);

/** "12 kN", with ≈ before a rough estimate and ≥ before a force that is too low. */
export function forceText(size_n, limited) {
  const words = wordsOf(limited), sign = words.some(isRough) ? '≈\u2009' : words.length > 0 ? '≥\u2009' : '';
  return sign + kilonewtons(size_n);
}

/** Why a force is a bound: "Rough estimate: steep blade. Too low: ground ends ahead". */
export function limitText(limited) {
  const words = wordsOf(limited), part = (name, list) => (list.length > 0 ? [`${name}: ${list.join(', ')}`] : []);
  return [...part('Rough estimate', words.filter(isRough).map(roughText)), ...part('Too low', words.filter((word) => !isRough(word)))].join('. ');
}

/** The scale of arrows that suits the largest bucket, and the longest arrow. @param {Object[]} machines */
export function arrowScale(machines) {
  const height = (m) => m.height_m ?? 0.7 * m.width_m, most = (of) => Math.max(...machines.map(of));
  return {n_per_m: 1000 * format.roundUp125(6 * most((m) => m.width_m * height(m))), most_m: Math.max(1, Math.round(4 * most(height)))};
}

/** The largest force of a machine's present and last cycle. */
export class LargestForce {
  #cycle = null;
  #now = null;
  #last = null;

  add(size_n, limited, cycle) {
    if (cycle !== this.#cycle) [this.#cycle, this.#last, this.#now] = [cycle, this.#now, null];
    if (!(size_n <= this.#now?.size_n)) this.#now = {size_n, limited};
  }

  /** @return {?{size_n: number, limited: string}} null before the first */
  get value() {
    return this.#last?.size_n > this.#now?.size_n ? this.#last : this.#now;
  }
}
