// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The arrow of a force, which ends at a bucket's lip and is drawn over all that hides it. Its length
// is by a scale up to a limit; a longer one has two heads.
import {ConeGeometry, CylinderGeometry, Group, Mesh, MeshBasicMaterial, Vector3} from 'three';

const kForce = 0x9347f5, kHalo = 0xffffff;
const kThick = 0.01;        // radius of the shaft, share of the longest arrow
const kLeast_px = 1.5;      // radius in the picture
const kLeast_m = 0.03;      // shorter arrows are not drawn
const kHead = 6, kWide = 2.5;   // length and radius of a head, in radii of the shaft
const kUp = new Vector3(0, 1, 0);

const shaft = new CylinderGeometry(1, 1, 1, 16).translate(0, 0.5, 0);
const head = new ConeGeometry(1, 1, 20).translate(0, 0.5, 0);

export class ForceArrow {
  group = new Group();
  #parts = [];
  #along = new Vector3();

  /** @param {{n_per_m: number, most_m: number}} scale */
  constructor(scale) {
    this.scale = scale;
    for (const [order, color] of [[1, kHalo], [2, kForce]]) {
      const material = new MeshBasicMaterial({color, depthTest: false, transparent: true});
      const parts = [shaft, head, head].map((geometry) => Object.assign(new Mesh(geometry, material), {renderOrder: order}));
      this.group.add(...parts);
      this.#parts.push(parts);
    }
    this.group.visible = false;
  }

  /** @param {?number[]} force in the world, N; null: unknown */
  show(force) {
    this.#along.set(...(force ?? [0, 0, 0])).divideScalar(this.scale.n_per_m);
    this.capped = this.#along.length() > this.scale.most_m;
    this.#along.clampLength(0, this.scale.most_m);
    this.group.visible = this.#along.length() >= kLeast_m;
  }

  /** @param {Vector3} lip in the scene @param {number} pixel_m metres of a pixel there */
  place(lip, pixel_m) {
    if (!this.group.visible) return;
    const length = this.#along.length(), halo = 0.9 * pixel_m;
    this.group.position.copy(lip).sub(this.#along);
    this.group.quaternion.setFromUnitVectors(kUp, this.#along.clone().normalize());
    const thick = Math.min(length / (1.3 * kHead), Math.max(kThick * this.scale.most_m, kLeast_px * pixel_m));
    const begins = length - kHead * thick;
    this.#parts.forEach(([line, ...heads], body) => {
      const more = body === 0 ? halo : 0;
      line.scale.set(thick + more, begins, thick + more);
      heads.forEach((mesh, i) => {
        mesh.visible = i === 0 || this.capped;
        mesh.position.y = begins - 0.7 * i * kHead * thick - more;
        mesh.scale.set(kWide * thick + 1.5 * more, kHead * thick + 3 * more, kWide * thick + 1.5 * more);
      });
    });
  }

  /** From its begin to the lip; null: not drawn. @return {?Vector3} */
  get along() {
    return this.group.visible ? this.#along.clone() : null;
  }
}
