// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground before digging: a quadtree of tiles. The drawn tiles have posts a few pixels apart. A
// tile stays until all its replacements are loaded.
import {Box3, Frustum, Group, Matrix4, Vector3} from 'three';
import {TerrainTile} from './terrain_tile.js';

const kTile = 256;            // posts along a tile, less one
const kPostPx = 2.5;          // a larger spacing on screen loads finer tiles
const kTolerancePx = 0.5;     // of heights, in pixels as they are drawn
const kMostReach = 64;        // of the search for chunks above and below the ground, voxels
const kRequests = 6;          // simultaneous requests
const kKept = 160;            // tiles; the longest unused go first
const kRetry_ms = 1500;

export class Terrain {
  group = new Group();
  /** @type {Map<string, TerrainTile|'loading'|'none'|{retryAt: number}>} */
  #tiles = new Map();
  #drawn = [];
  #wanted = [];
  #loading = 0;
  #frame = 0;
  low = Infinity;
  high = -Infinity;
  showsDesign = false;   // do tiles need heights above the design?
  fromDesign_m = 0;

  /**
   * @param {Object} site from the server
   * @param {function(string): Promise<ArrayBuffer>} fetchBytes
   * @param {number[]} origin of the scene in the world
   * @param {function()} changed called when there is something new to draw
   */
  constructor(site, fetchBytes, origin, uniforms, changed) {
    Object.assign(this, {site, fetchBytes, origin, uniforms, changed});
    this.levels = site.terrain.levels;
    let below = [0, 0];
    this.counts = this.levels.map(({nx, ny}) => {
      below = [nx, ny].map((n, axis) => Math.max(1, Math.ceil((n - 1) / kTile), Math.ceil(below[axis] / 2)));
      return below;
    });
  }

  /** Whether all tiles of the last update() are loaded. */
  get settled() {
    return this.#loading === 0 && this.#wanted.length === 0 && this.#drawn.length > 0;
  }
  get drawnTiles() {
    return this.#drawn.length;
  }
  get drawnTriangles() {
    return this.#drawn.reduce((sum, tile) => sum + tile.mesh.geometry.index.count / 3, 0);
  }

  /**
   * Chooses the tiles to draw from here, and requests missing ones.
   * @param {number} heightPx of the picture on the page, which all that is loaded depends on
   * @param {number} drawnPx the same as it is drawn now
   */
  update(camera, heightPx, drawnPx) {
    ++this.#frame;
    const frustum = new Frustum().setFromProjectionMatrix(
      new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    const size = 2 * Math.tan((camera.fov * Math.PI) / 360), view = {frustum, eye: camera.position, pixel: size / heightPx};
    for (const tile of this.#drawn) tile.mesh.visible = false;
    this.#drawn = [];
    this.#wanted = [];
    const top = this.levels.length - 1;
    for (let j = 0; j < this.counts[top][1]; ++j) {
      for (let i = 0; i < this.counts[top][0]; ++i) this.#visit(top, i, j, view);
    }
    this.#refine(camera, size / drawnPx);
    for (const tile of this.#drawn) tile.mesh.visible = true;
    if (this.showsDesign) {
      for (const tile of this.#drawn) {
        if (!tile.designed) this.#wanted.push({key: tile.key, place: tile, level: -1, distance: 0});
      }
    }
    this.#wanted.sort((a, b) => b.level - a.level || a.distance - b.distance);
    this.#request();
    this.#forget();
  }

  #visit(level, i, j, view) {
    const key = `${level}/${i}/${j}`, tile = this.#tiles.get(key);
    const place = this.#place(level, i, j);
    const box = this.#box(place, tile);
    const distance = box.distanceToPoint(view.eye);
    if (tile instanceof TerrainTile) tile.used = this.#frame;
    const finer = level > 0 && place.spacing_m > kPostPx * view.pixel * Math.max(distance, 1e-3);
    const seen = view.frustum.intersectsBox(box);
    if (!tile && place.nx > 1 && place.ny > 1 && (seen || level === this.levels.length - 1)) {
      this.#wanted.push({key, place, level, distance});
    }
    const ready = tile instanceof TerrainTile && !tile.empty;
    if ((finer && seen) || tile === 'none' || place.nx < 2 || place.ny < 2) {
      const children = this.#children(level, i, j);
      if (!ready || children.every((c) => this.#hasGround(...c))) {
        children.forEach((c) => this.#visit(...c, view));
        return;
      }
      children.forEach((c) => this.#want(...c, view));
    }
    if (ready && seen) this.#drawn.push(tile);
  }

  #refine(camera, pixel) {
    const voxel_m = this.site.voxel_size_m;
    for (const tile of this.#drawn) {
      const distance = Math.max(camera.near, this.#box(tile, tile).distanceToPoint(camera.position));
      // A power of two, so that triangles change only if the distance does much.
      const tolerance_m = 2 ** Math.floor(Math.log2(kTolerancePx * pixel * distance));
      if (tile.tolerance_m === tolerance_m) continue;
      const error_m = tile.refine(tolerance_m), between_m = tile.level === 0 ? 0 : 0.35 * tile.spacing_m;
      tile.mesh.material.uniforms.reach.value = Math.min(kMostReach, Math.max(2, between_m / voxel_m) + error_m / voxel_m);
    }
  }

  #children(level, i, j) {
    const children = [];
    if (level === 0) return children;
    const [columns, rows] = this.counts[level - 1];
    for (const [u, v] of [[2 * i, 2 * j], [2 * i + 1, 2 * j], [2 * i, 2 * j + 1], [2 * i + 1, 2 * j + 1]]) {
      if (u < columns && v < rows) children.push([level - 1, u, v]);
    }
    return children;
  }

  #hasGround(level, i, j) {
    const tile = this.#tiles.get(`${level}/${i}/${j}`);
    return tile instanceof TerrainTile || tile === 'none';
  }

  #want(level, i, j, view) {
    const key = `${level}/${i}/${j}`;
    if (this.#tiles.has(key)) return;
    const place = this.#place(level, i, j);
    const box = this.#box(place);
    this.#wanted.push({key, place, level, distance: box.distanceToPoint(view.eye)});
  }

  #place(level, i, j) {
    const {spacing_m, nx, ny} = this.levels[level], [xmin, ymin] = this.site.terrain.bounds;
    const count = (n, k) => Math.max(0, Math.min(kTile, n - 1 - k * kTile)) + 1;
    const columns = count(nx, i), rows = count(ny, j);
    return {
      level, i, j, spacing_m, nx: columns, ny: rows,
      corner: [xmin + i * kTile * spacing_m - this.origin[0], ymin + j * kTile * spacing_m - this.origin[1]],
      site: [j === 0, i * kTile + columns === nx, j * kTile + rows === ny, i === 0],
    };
  }

  #box(place, tile) {
    const [x, y] = place.corner, low = Number.isFinite(this.low) ? this.low : -1e4;
    const high = Number.isFinite(this.high) ? this.high : 1e4, known = tile instanceof TerrainTile && !tile.empty;
    return new Box3(
      new Vector3(x, y, known ? Math.min(tile.low, this.footZ) : low),
      new Vector3(x + (place.nx - 1) * place.spacing_m, y + (place.ny - 1) * place.spacing_m, known ? tile.high : high));
  }

  #request() {
    while (this.#loading < kRequests && this.#wanted.length > 0) {
      const {key, place} = this.#wanted.shift(), design = place instanceof TerrainTile;
      if (design ? place.designed : this.#tiles.has(key)) continue;
      if (design) place.designed = true;
      else this.#tiles.set(key, 'loading');
      ++this.#loading;
      (design ? this.#loadDesign(place) : this.#load(key, place)).finally(() => {
        --this.#loading;
        this.changed();
      });
    }
  }

  async #heights(place, more = '') {
    const bytes = await this.fetchBytes(`/terrain?level=${place.level}&tile=${place.i},${place.j}${more}`);
    const heights = new Float32Array(bytes);
    if (heights.length !== place.nx * place.ny) {
      throw new Error(`a terrain tile has ${heights.length} heights, not ${place.nx} x ${place.ny}`);
    }
    if (this.origin[2] !== 0) heights.forEach((z, k) => { heights[k] = z - this.origin[2]; });
    return heights;
  }

  async #loadDesign(tile) {
    try {
      tile.setDesign(await this.#heights(tile, '&surface=design'));
      this.fromDesign_m = Math.max(this.fromDesign_m, tile.fromDesign_m);
    } catch {   // requested again later
      setTimeout(() => { tile.designed = false; this.changed(); }, kRetry_ms);
    }
  }

  async #load(key, place) {
    try {
      this.#add(key, place, await this.#heights(place));
    } catch (error) {   // requested again later, when it is needed
      if (error.status === 404) this.#tiles.set(key, 'none');
      else setTimeout(() => { this.#tiles.delete(key); this.changed(); }, kRetry_ms);
    }
  }

  #add(key, place, heights) {
    if (this.footZ === undefined) {
      const [xmin, ymin, xmax, ymax] = this.site.terrain.bounds;
      const low = heights.reduce((a, z) => (z < a ? z : a), Infinity);
      this.footZ = (low < Infinity ? low : 0) - 0.05 * Math.hypot(xmax - xmin, ymax - ymin);
    }
    const voxel_m = this.site.voxel_size_m, corner = [...place.corner, 0];
    const voxels = corner.map((c, axis) => (c + this.origin[axis] - this.site.origin[axis]) / voxel_m);
    const material = this.uniforms.terrainMaterial({
      spacing_m: {value: place.spacing_m},
      tile_voxel: {value: new Int32Array(voxels.map(Math.floor))},
      tile_fraction: {value: new Vector3(...voxels.map((v) => v - Math.floor(v)))},
      reach: {value: 0},
      designed: {value: false},
    });
    const tile = new TerrainTile(place, heights, material, this.footZ);
    tile.key = key;
    this.#tiles.set(key, tile);
    this.low = Math.min(this.low, tile.low);
    this.high = Math.max(this.high, tile.high);
    this.group.add(tile.mesh);
    this.#shade(tile, false);
    for (let v = -1; v <= 1; ++v) {
      for (let u = -1; u <= 1; ++u) {
        const other = this.#tiles.get(`${tile.level}/${tile.i + u}/${tile.j + v}`);
        if ((u !== 0 || v !== 0) && other instanceof TerrainTile) this.#shade(other, true);
      }
    }
  }

  #shade(tile, rimOnly) {
    tile.shade((i, j) => {
      const u = i < 0 ? -1 : i >= tile.nx ? 1 : 0, v = j < 0 ? -1 : j >= tile.ny ? 1 : 0;
      const other = this.#tiles.get(`${tile.level}/${tile.i + u}/${tile.j + v}`);
      if (!(other instanceof TerrainTile)) return NaN;
      const x = i - u * kTile, y = j - v * kTile;
      return x >= 0 && y >= 0 && x < other.nx && y < other.ny ? other.heights[y * other.nx + x] : NaN;
    }, rimOnly);
  }

  #forget() {
    const tiles = [...this.#tiles].filter(([, tile]) => tile instanceof TerrainTile);
    if (tiles.length <= kKept) return;
    tiles.sort((a, b) => (a[1].used ?? 0) - (b[1].used ?? 0));
    for (const [key, tile] of tiles.slice(0, tiles.length - kKept)) {
      if (tile.used === this.#frame || tile.level === this.levels.length - 1) continue;
      tile.dispose();
      this.#tiles.delete(key);
    }
  }

  /** Height in the scene from the finest loaded tile; NaN without one. */
  heightAt(x, y) {
    for (let level = 0; level < this.levels.length; ++level) {
      const [xmin, ymin] = this.site.terrain.bounds, size = kTile * this.levels[level].spacing_m;
      const at = (v, low, axis) => Math.min(this.counts[level][axis] - 1, Math.floor(v / size));
      const i = at(x + this.origin[0] - xmin, 0, 0), j = at(y + this.origin[1] - ymin, 0, 1);
      const tile = this.#tiles.get(`${level}/${i}/${j}`);
      if (!(tile instanceof TerrainTile)) continue;
      const z = tile.heightAt(x, y);
      if (!Number.isNaN(z)) return z;
    }
    return NaN;
  }

  /**
   * The first intersection of a ray with the drawn terrain, or null.
   * @param {import('three').Ray} ray in the scene
   * @param {function(number, number, number): boolean} hidden whether a place is in a resident
   *     chunk
   */
  raycast(ray, hidden) {
    let best = null, bestT = Infinity;
    const entry = new Vector3(), at = new Vector3();
    for (const tile of this.#drawn) {
      const box = this.#box(tile, tile);
      box.min.z = tile.low - 0.01;
      box.max.z = tile.high + 0.01;
      if (!box.containsPoint(ray.origin)) {
        if (!ray.intersectBox(box, entry)) continue;
      } else {
        entry.copy(ray.origin);
      }
      let t = entry.distanceTo(ray.origin);
      if (t > bestT) continue;
      const level = Math.hypot(ray.direction.x, ray.direction.y);
      const step = (0.5 * tile.spacing_m) / Math.max(level, 0.05);
      const above = (s) => {
        ray.at(s, at);
        return at.z - tile.heightAt(at.x, at.y);
      };
      let before = above(t);
      for (let n = 0; n < 3000; ++n) {
        const next = t + step, after = above(next);
        if (before >= 0 && after < 0) {
          let a = t, b = next;
          for (let k = 0; k < 24; ++k) {
            const mid = (a + b) / 2;
            if (above(mid) >= 0) a = mid;
            else b = mid;
          }
          ray.at(b, at);
          if (!hidden(at.x, at.y, at.z)) {
            if (b < bestT) {
              bestT = b;
              best = at.clone();
            }
            break;
          }
        }
        if (next > bestT || at.z < box.min.z - 1 || (Number.isNaN(after) && !Number.isNaN(before) && n > 2)) break;
        t = next;
        before = after;
      }
    }
    return best;
  }
}
