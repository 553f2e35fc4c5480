// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A tile of terrain: its posts' heights as a mesh with a skirt, which hides gaps to coarser
// neighbours. At the site's border the skirt is a wall.
import {BufferAttribute, BufferGeometry, Float32BufferAttribute, Mesh, Sphere, Vector3} from 'three';
import {kNotKnown} from './ground_uniforms.js';

/** Grids and triangles for all tiles of the same size without voids. */
const shared = new Map();

/** Posts of the rim, counter-clockwise from above, as [column, row]. */
function rimOf(nx, ny) {
  const rim = [];
  for (let i = 0; i < nx - 1; ++i) rim.push([i, 0]);
  for (let j = 0; j < ny - 1; ++j) rim.push([nx - 1, j]);
  for (let i = nx - 1; i > 0; --i) rim.push([i, ny - 1]);
  for (let j = ny - 1; j > 0; --j) rim.push([0, j]);
  return rim;
}

/** Vertices: posts row by row, then top and foot of each rim post, with each side's posts separate. */
function topology(nx, ny, isGround) {
  const rim = rimOf(nx, ny), n = nx * ny, sides = rim.length;
  const grid = new Uint16Array(2 * (n + 4 * sides));
  for (let j = 0, k = 0; j < ny; ++j) {
    for (let i = 0; i < nx; ++i) {
      grid[k++] = i;
      grid[k++] = j;
    }
  }
  const index = new Uint32Array(6 * ((nx - 1) * (ny - 1) + sides));
  let used = 0;
  const triangle = (a, b, c) => {
    if (!isGround(a) || !isGround(b) || !isGround(c)) return;
    index[used++] = a;
    index[used++] = b;
    index[used++] = c;
  };
  for (let j = 0; j + 1 < ny; ++j) {
    for (let i = 0; i + 1 < nx; ++i) {
      const a = j * nx + i, b = a + 1, c = a + nx, d = c + 1;
      if (isGround(a) && isGround(d)) {
        triangle(a, b, d);
        triangle(a, d, c);
      } else {
        triangle(a, b, c);
        triangle(b, d, c);
      }
    }
  }
  rim.forEach(([i, j], k) => {
    const [u, v] = rim[(k + 1) % sides], at = n + 4 * k;
    for (const [o, x, y] of [[0, i, j], [1, i, j], [2, u, v], [3, u, v]]) grid.set([x, y], 2 * (at + o));
    if (!isGround(j * nx + i) || !isGround(v * nx + u)) return;
    index.set([at, at + 1, at + 3, at, at + 3, at + 2], used);
    used += 6;
  });
  return {rim, grid: new BufferAttribute(grid, 2), index: new BufferAttribute(index.slice(0, used), 1)};
}

export class TerrainTile {
  /**
   * @param {Object} place level, i, j; nx, ny posts; spacing_m; corner: in the scene; site: whether
   *     each side (south, east, north, west) is the site's border
   * @param {Float32Array} heights above the scene's datum, NaN without ground
   */
  constructor(place, heights, material, footZ) {
    Object.assign(this, place);
    this.heights = heights;
    const {nx, ny} = this, whole = heights.every((z) => !Number.isNaN(z));
    const key = `${nx},${ny}`;
    this.form = whole ? shared.get(key) : undefined;
    if (!this.form) this.form = topology(nx, ny, (v) => !Number.isNaN(heights[v]));
    if (whole) shared.set(key, this.form);
    this.low = Infinity;
    this.high = -Infinity;
    for (const z of heights) {
      if (z < this.low) this.low = z;
      if (z > this.high) this.high = z;
    }
    this.empty = this.low > this.high;
    const vertices = this.form.grid.count;
    const z = new Float32Array(vertices);
    z.set(heights.map((h) => (Number.isNaN(h) ? 0 : h)));
    this.facing = new BufferAttribute(new Int8Array(4 * vertices), 4, true);
    this.form.rim.forEach(([i, j], k) => {
      const [u, v] = this.form.rim[(k + 1) % this.form.rim.length], at = nx * ny + 4 * k;
      const side = j === 0 && v === 0 ? 0 : i === nx - 1 && u === nx - 1 ? 1 : j === ny - 1 && v === ny - 1 ? 2 : 3;
      const foot = (h) => (this.site[side] ? footZ : h - 2 * this.spacing_m);
      const a = heights[j * nx + i], b = heights[v * nx + u];
      z.set([a, foot(a), b, foot(b)].map((h) => (Number.isNaN(h) ? 0 : h)), at);
      const outward = [[0, -127], [127, 0], [0, 127], [-127, 0]][side];
      for (let o = 0; o < 4 && this.site[side]; ++o) this.facing.array.set([...outward, 0, 127], 4 * (at + o));
    });
    const geometry = new BufferGeometry();
    geometry.setIndex(this.form.index);
    geometry.setAttribute('grid', this.form.grid);
    geometry.setAttribute('height', new Float32BufferAttribute(z, 1));
    geometry.setAttribute('facing', this.facing);
    const size = [(nx - 1) * this.spacing_m, (ny - 1) * this.spacing_m];
    const bottom = Math.min(this.low - 2 * this.spacing_m, this.site.includes(true) ? footZ : Infinity);
    geometry.boundingSphere = new Sphere(
      new Vector3(size[0] / 2, size[1] / 2, (bottom + this.high) / 2),
      Math.hypot(size[0], size[1], this.high - bottom) / 2);
    this.mesh = new Mesh(geometry, material);
    this.mesh.position.set(this.corner[0], this.corner[1], 0);
    this.mesh.matrixAutoUpdate = false;
    this.mesh.updateMatrix();
    this.mesh.updateMatrixWorld(true);
    this.mesh.visible = false;
  }

  /**
   * Computes normals of all posts, or only of the rim, from neighbouring posts.
   * @param {function(number, number): number} around height of a post beyond the tile, NaN: unknown
   */
  shade(around, rimOnly = false) {
    const {nx, ny, heights} = this, out = this.facing.array;
    const at = (i, j) => (i >= 0 && j >= 0 && i < nx && j < ny ? heights[j * nx + i] : around(i, j));
    const slope = (low, here, high) =>
      Number.isNaN(low) ? (Number.isNaN(high) ? 0 : high - here) : Number.isNaN(high) ? here - low : (high - low) / 2;
    const shadePost = (i, j) => {
      const here = heights[j * nx + i];
      const x = -slope(at(i - 1, j), here, at(i + 1, j)) / this.spacing_m;
      const y = -slope(at(i, j - 1), here, at(i, j + 1)) / this.spacing_m;
      const scale = 127 / Math.hypot(x, y, 1), k = 4 * (j * nx + i);
      out[k] = Math.round(x * scale);
      out[k + 1] = Math.round(y * scale);
      out[k + 2] = Math.round(scale);
    };
    if (!rimOnly) for (let j = 0; j < ny; ++j) for (let i = 0; i < nx; ++i) shadePost(i, j);
    const {rim} = this.form;
    for (const [i, j] of rim) shadePost(i, j);
    rim.forEach(([i, j], k) => {   // skirts are lit like the ground above them
      const [u, v] = rim[(k + 1) % rim.length], to = 4 * (nx * ny + 4 * k);
      for (const [o, x, y] of [[0, i, j], [1, i, j], [2, u, v], [3, u, v]]) {
        if (out[to + 4 * o + 3] === 0) out.copyWithin(to + 4 * o, 4 * (y * nx + x), 4 * (y * nx + x) + 3);
      }
    });
    this.facing.needsUpdate = true;
  }

  /** @param {Float32Array} heights of the design at the posts, above the scene's datum; NaN: unknown */
  setDesign(heights) {
    const {nx, ny} = this, {rim, grid} = this.form, above = new Float32Array(grid.count);
    this.fromDesign_m = 0;
    for (let k = 0; k < nx * ny; ++k) {
      const d = this.heights[k] - heights[k];
      above[k] = Number.isNaN(d) ? kNotKnown : d;
      if (Math.abs(d) > this.fromDesign_m) this.fromDesign_m = Math.abs(d);
    }
    rim.forEach(([i, j], k) => {
      const [u, v] = rim[(k + 1) % rim.length], a = above[j * nx + i], b = above[v * nx + u];
      above.set([a, a, b, b], nx * ny + 4 * k);
    });
    this.mesh.geometry.setAttribute('above', new Float32BufferAttribute(above, 1));
    this.designed = true;
  }

  /** Height at a place in the scene, bilinear; NaN without ground. */
  heightAt(x, y) {
    const u = (x - this.corner[0]) / this.spacing_m, v = (y - this.corner[1]) / this.spacing_m;
    const i = Math.min(this.nx - 2, Math.floor(u)), j = Math.min(this.ny - 2, Math.floor(v));
    if (i < 0 || j < 0 || u > this.nx - 1 || v > this.ny - 1) return NaN;
    const k = j * this.nx + i, s = u - i, t = v - j, h = this.heights;
    return (1 - t) * ((1 - s) * h[k] + s * h[k + 1]) + t * ((1 - s) * h[k + this.nx] + s * h[k + this.nx + 1]);
  }

  dispose() {
    this.mesh.removeFromParent();
    this.mesh.geometry.deleteAttribute('grid');   // shared by tiles
    this.mesh.geometry.setIndex(null);
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}
