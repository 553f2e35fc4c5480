// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Standard deviations of the heights that scans or surveys saw, as a picture on the ground. They are
// asked for while they are chosen as colours, and again when scans or work may have changed them.
import {DataTexture, FloatType, NearestFilter, RedFormat} from 'three';
import * as api from './api.js';
import {decodeSigmas} from './decode.js';
import {hint} from './surroundings.js';

const kRest_ms = 2000;   // between two questions, and longer after answers that the server took long for
const kRests = 9;        // times as long

export class SigmaLayer {
  map = null;   // of decodeSigmas()
  #wanted = null;
  #shown = null;
  #loading = false;
  #rest = null;

  /**
   * @param {number[]} origin of the scene @param {import('./ground_uniforms.js').GroundUniforms} uniforms
   * @param {function()} changed called when there is something new to draw
   * @param {function()} again called when want() may ask again
   */
  constructor(origin, uniforms, changed, again) {
    Object.assign(this, {origin, uniforms: uniforms.values, changed, again});
  }

  /** Whether what was last wanted is shown. */
  get settled() {
    return this.#wanted === this.#shown;
  }

  /** @param {?number} time null: live @param {string} version of the ground then and of what is known of it */
  want(time, version) {
    if (time !== this.time) this.#rest = clearTimeout(this.#rest) ?? null;
    this.time = time;
    this.#wanted = `${time} ${version}`;
    this.#ask();
  }

  async #ask() {
    if (this.#loading || this.#rest !== null || this.settled) return;
    this.#loading = true;
    const asked = this.#wanted, {time} = this, begin = performance.now();
    try {
      this.#take(decodeSigmas(await api.getBytes('/sigmas', {time})));
      this.#shown = asked;
    } catch (error) {
      hint(`The sigmas did not come: ${error.message}`, 6);
    }
    this.#loading = false;
    const rest_ms = time === this.time ? Math.max(kRest_ms, kRests * (performance.now() - begin)) : 0;
    this.#rest = setTimeout(() => { this.#rest = null; this.again(); }, rest_ms);
    this.changed();
  }

  #take(map) {
    this.map = map;
    const {sigmas: texture, sigma_box: box} = this.uniforms, {west, south, cell_m, nx, ny, sigmas_m} = map;
    texture.value?.dispose();
    texture.value = new DataTexture(nx > 0 ? sigmas_m : new Float32Array([-1]), nx || 1, ny || 1, RedFormat, FloatType);
    texture.value.minFilter = texture.value.magFilter = NearestFilter;
    texture.value.needsUpdate = true;
    box.value.set(west - this.origin[0], south - this.origin[1], 1 / (nx * cell_m || 1), 1 / (ny * cell_m || 1));
  }

  /** Of the column at a place in the world, m; null if it was not seen. */
  at(x, y) {
    if (!this.map) return null;
    const {west, south, cell_m, nx, ny, sigmas_m} = this.map;
    const i = Math.floor((x - west) / cell_m), j = Math.floor((y - south) / cell_m);
    const sigma_m = i >= 0 && j >= 0 && i < nx && j < ny ? sigmas_m[j * nx + i] : -1;
    return sigma_m < 0 ? null : sigma_m;
  }
}
