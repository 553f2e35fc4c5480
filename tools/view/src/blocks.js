// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The blocks of one view of the ground: changed ground as meshes. A new message of a block replaces
// its mesh.
import {BufferAttribute, BufferGeometry, Group, Mesh, Sphere, Vector3} from 'three';
import {vertexNormals, writeNormals} from './normals.js';

const kSide = 32;
const kSphere = new Sphere(new Vector3(8192 + 16384, 8192 + 16384, 8192 + 16384), 34 * 1024 * 0.87);

export class Blocks {
  group = new Group();
  /** @type {Map<string, {x: number, y: number, z: number, mesh: ?Mesh, sums: ?Float32Array, border: ?Map}>} */
  #blocks = new Map();
  #unstitched = new Set();
  deepest_m = 0;
  highest_m = 0;
  fromDesign_m = 0;

  /**
   * @param {Object} site @param {number[]} origin of the scene in the world
   * @param {import('three').Material} material
   * @param {import('./chunk_table.js').ChunkTable} table of resident chunks, which this updates
   */
  constructor(site, origin, material, table) {
    Object.assign(this, {site, origin, material, table});
    this.tableChanged = false;
  }

  get count() {
    return this.#blocks.size;
  }
  get unstitched() {
    return this.#unstitched.size > 0;
  }
  get vertices() {
    let sum = 0;
    for (const {mesh} of this.#blocks.values()) sum += mesh?.geometry.attributes.position.count ?? 0;
    return sum;
  }

  /** @param {import('./decode.js').Block} block */
  put(block) {
    const x = block.bx / kSide, y = block.by / kSide, z = block.bz / kSide, key = `${x},${y},${z}`;
    if (this.table.set(x, y, z, block.lo, block.hi)) this.tableChanged = true;
    this.#drop(this.#blocks.get(key));
    const entry = {x, y, z, mesh: null, sums: null, border: null, points: block.points};
    if (block.lo === 0 && block.hi === 0) this.#blocks.delete(key);
    else this.#blocks.set(key, entry);
    if (block.points.length > 0) {
      Object.assign(entry, vertexNormals(block.points, block.index));
      entry.mesh = this.#mesh(entry, block);
      this.group.add(entry.mesh);
      for (const c of block.change) {
        if (c === -32768) continue;
        if (-c > 1000 * this.deepest_m) this.deepest_m = -c / 1000;
        if (c > 1000 * this.highest_m) this.highest_m = c / 1000;
      }
      for (const d of block.design ?? []) {
        if (d !== -32768) this.fromDesign_m = Math.max(this.fromDesign_m, Math.abs(d) / 1000);
      }
    }
    for (let dx = -1; dx <= 1; ++dx) {
      for (let dy = -1; dy <= 1; ++dy) {
        for (let dz = -1; dz <= 1; ++dz) {
          const near = this.#blocks.get(`${x + dx},${y + dy},${z + dz}`);
          if (near?.mesh) this.#unstitched.add(near);
        }
      }
    }
  }

  #mesh(entry, block) {
    const geometry = new BufferGeometry(), n = block.points.length / 3;
    geometry.setIndex(new BufferAttribute(block.index, 1));
    geometry.setAttribute('position', new BufferAttribute(block.points, 3));
    geometry.setAttribute('change', new BufferAttribute(block.change, 1));
    geometry.setAttribute('design', new BufferAttribute(block.design ?? new Int16Array(n).fill(-32768), 1));
    geometry.setAttribute('loose', new BufferAttribute(block.loose, 1, true));
    geometry.setAttribute('facing', new BufferAttribute(new Int8Array(4 * n), 4, true));
    geometry.boundingSphere = kSphere;
    writeNormals(entry, block.points, () => null, geometry.attributes.facing.array);
    const mesh = new Mesh(geometry, this.material), voxel = this.site.voxel_size_m;
    const first = [block.bx, block.by, block.bz];
    mesh.scale.setScalar(voxel / 1024);
    mesh.position.set(...first.map((b, axis) => this.site.origin[axis] + voxel * (b - 8) - this.origin[axis]));
    mesh.matrixAutoUpdate = false;
    mesh.updateMatrix();
    mesh.updateMatrixWorld(true);
    return mesh;
  }

  /** Joins normals at borders of blocks for a limited time. @return {boolean} whether any changed */
  stitch(budget_ms) {
    const end = performance.now() + budget_ms, changed = this.#unstitched.size > 0;
    for (const entry of this.#unstitched) {
      this.#unstitched.delete(entry);
      if (!entry.mesh) continue;
      const facing = entry.mesh.geometry.attributes.facing;
      writeNormals(entry, entry.points, (dx, dy, dz) => {
        const near = this.#blocks.get(`${entry.x + dx},${entry.y + dy},${entry.z + dz}`);
        return near?.mesh ? near : null;
      }, facing.array);
      facing.needsUpdate = true;
      if (performance.now() > end) break;
    }
    return changed;
  }

  #drop(entry) {
    if (!entry?.mesh) return;
    this.#unstitched.delete(entry);
    entry.mesh.removeFromParent();
    entry.mesh.geometry.dispose();
    entry.mesh = null;
  }

  dispose() {
    for (const entry of this.#blocks.values()) this.#drop(entry);
    this.#blocks.clear();
    this.#unstitched.clear();
    this.group.removeFromParent();
  }

  /** Middle (scene) and extent of the changed ground; null without changes. */
  extent() {
    if (this.#blocks.size === 0) return null;
    const low = new Vector3(Infinity, Infinity, Infinity), high = low.clone().negate();
    for (const {mesh} of this.#blocks.values()) {
      if (!mesh) continue;
      low.min(mesh.position);
      high.max(mesh.position);
    }
    const size = kSide * this.site.voxel_size_m;
    return low.x > high.x ? null : {low, high: high.addScalar(size)};
  }
}
