// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The point of the ground at a pixel, and the height of the drawn ground.
import {Raycaster, Vector3} from 'three';

/** Finds points of the drawn ground along a ray, or straight below a place. */
export class GroundPick {
  /** @param {SceneView} sceneView @param {import('./terrain.js').Terrain} terrain @param {import('./views.js').Views} views */
  constructor(sceneView, terrain, views) {
    Object.assign(this, {sceneView, terrain, views});
  }

  /** @return {?Vector3} in the scene */
  atPixel(x, y) {
    return this.#first(this.sceneView.rayAt(x, y));
  }

  /** The ground's height at a place in the scene, or null. */
  heightAt(x, y) {
    const down = (dx, dy) => this.#first(new Raycaster(new Vector3(x + dx, y + dy, 20000), new Vector3(0, 0, -1)), true);
    return (down(0, 0) ?? down(1e-4, 1.7e-4))?.z ?? null;   // a ray exactly on an edge may miss both triangles
  }

  #first(caster, below = false) {
    const hits = caster.intersectObject(this.views.shown.blocks.group, true);
    const block = hits.length > 0 ? hits[0].point : null;
    let ground = null;
    if (below) {
      const {x, y} = caster.ray.origin, z = this.terrain.heightAt(x, y);
      if (!Number.isNaN(z) && !this.views.covers(x, y, z)) ground = new Vector3(x, y, z);
    } else {
      ground = this.terrain.raycast(caster.ray, (x, y, z) => this.views.covers(x, y, z));
    }
    if (!block || !ground) return block ?? ground;
    const from = caster.ray.origin;
    return block.distanceTo(from) <= ground.distanceTo(from) ? block : ground;
  }
}
