// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The orthophoto or map on the ground, its switch in the legend, and where it holds: only where the
// ground is as it was surveyed, because a photo of the ground before hides a pit.
import {LinearFilter, LinearMipmapNearestFilter, Texture} from 'three';
import * as api from './api.js';
import {$, h} from './dom.js';
import {hint} from './surroundings.js';

export class Drape {
  on = false;

  /** @param {Object} site @param {number[]} origin of the scene @param {import('./ground_uniforms.js').GroundUniforms} uniforms @param {function()} changed */
  constructor(site, origin, uniforms, changed) {
    Object.assign(this, {uniforms: uniforms.values, changed, offered: Boolean(site.drape)});
    if (!this.offered) return;
    const [xmin, ymin, xmax, ymax] = site.drape.bounds;
    this.uniforms.drape_box.value.set(xmin - origin[0], ymax - origin[1], 1 / (xmax - xmin), 1 / (ymax - ymin));
    this.uniforms.undug_m.value = Math.max(0.005, 0.4 * site.voxel_size_m);   // meshes of undug ground are as near
    this.box = h('input', {type: 'checkbox', id: 'drape', 'aria-keyshortcuts': 'o', onchange: () => this.switch(this.box.checked)});
    $('legend').append(h('label', {title: 'Photo or map on ground that is as it was surveyed; ground that was dug has the colours of soil, and a white border (O)'}, this.box, 'Photo on undug ground'));
    this.switch(true);
  }

  switch(on) {
    if (!this.offered) return;
    this.on = this.box.checked = on;
    if (on) this.loading ??= this.#load();
    this.#show();
  }

  #show() {
    this.uniforms.draped.value = this.on && this.uniforms.drape.value !== null;
    this.changed();
  }

  async #load() {
    try {
      const picture = await createImageBitmap(new Blob([await api.getBytes('/drape')], {type: 'image/webp'}), {premultiplyAlpha: 'none', colorSpaceConversion: 'none'});
      const texture = new Texture(picture);
      texture.flipY = false;
      texture.minFilter = LinearMipmapNearestFilter;   // a third of the cost of linear between levels, without a graphics card
      texture.magFilter = LinearFilter;
      texture.needsUpdate = true;
      this.uniforms.drape.value = texture;
    } catch (error) {
      this.loading = null;   // the switch tries again
      this.on = this.box.checked = false;
      hint(`The photo can't be loaded: ${error.message}`, 6);
    }
    this.#show();
  }
}
