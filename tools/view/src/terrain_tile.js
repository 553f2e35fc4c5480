// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A tile of terrain: as few triangles as show its posts' heights, with skirts, which hide gaps to
// neighbours. At the site's border a skirt is a wall. What varies along the ground - normals,
// heights for colours - is read from textures of the posts, so that triangles don't show.
import {BufferAttribute, BufferGeometry, ByteType, DataTexture, FloatType, LinearFilter, Mesh, RedFormat, RGBAFormat, Sphere, Vector3} from 'three';
import {kNotKnown} from './ground_uniforms.js';
import {TerrainMesh} from './terrain_mesh.js';

const kOutwards = [[0, -127], [127, 0], [0, 127], [-127, 0]];   // from each side

function heightTexture(nx, ny, heights) {
  const texture = new DataTexture(heights.map((h) => (Number.isNaN(h) ? kNotKnown : h)), nx, ny, RedFormat, FloatType);
  texture.needsUpdate = true;
  return texture;
}

function normalTexture(nx, ny) {
  const texture = new DataTexture(new Int8Array(4 * nx * ny), nx, ny, RGBAFormat, ByteType);
  texture.internalFormat = 'RGBA8_SNORM';
  texture.minFilter = texture.magFilter = LinearFilter;
  return texture;
}

export class TerrainTile {
  tolerance_m;   // of its triangles; it has none at first
  #network;

  /**
   * @param {Object} place level, i, j; nx, ny posts; spacing_m; corner: in the scene; site: whether
   *     each side (south, east, north, west) is the site's border
   * @param {Float32Array} heights above the scene's datum, NaN without ground
   */
  constructor(place, heights, material, footZ) {
    Object.assign(this, place, {footZ});
    this.heights = heights;
    this.low = Infinity;
    this.high = -Infinity;
    for (const z of heights) {
      if (z < this.low) this.low = z;
      if (z > this.high) this.high = z;
    }
    this.empty = this.low > this.high;
    this.textures = {normals: normalTexture(this.nx, this.ny), heights: heightTexture(this.nx, this.ny, heights), above: null};
    for (const [name, value] of Object.entries(this.textures)) material.uniforms[name] = {value};
    this.mesh = new Mesh(new BufferGeometry(), material);
    this.mesh.position.set(this.corner[0], this.corner[1], 0);
    this.mesh.matrixAutoUpdate = false;
    this.mesh.updateMatrix();
    this.mesh.updateMatrixWorld(true);
    this.mesh.visible = false;
  }

  /** Draws the ground to a tolerance from now on; returns the largest distance of posts from the triangles. */
  refine(tolerance_m) {
    this.tolerance_m = tolerance_m;
    const {nx, ny, spacing_m, footZ} = this;
    this.#network ??= new TerrainMesh(nx, ny, this.heights);
    const skirt_m = 2 * spacing_m + 3 * tolerance_m;   // neighbours may have twice the tolerance
    const cut = this.#network.cut(tolerance_m, (side, z) => (this.site[side] ? footZ : z - skirt_m));
    const outward = new Int8Array(2 * cut.side.length);
    cut.side.forEach((side, k) => { if (this.site[side]) outward.set(kOutwards[side], 2 * k); });
    const geometry = new BufferGeometry();
    geometry.setIndex(new BufferAttribute(cut.index, 1));
    geometry.setAttribute('grid', new BufferAttribute(cut.grid, 2));
    geometry.setAttribute('height', new BufferAttribute(cut.height, 1));
    geometry.setAttribute('outward', new BufferAttribute(outward, 2, true));
    const size = [(nx - 1) * spacing_m, (ny - 1) * spacing_m];
    const bottom = Math.min(this.low - skirt_m, this.site.includes(true) ? footZ : Infinity);
    geometry.boundingSphere = new Sphere(
      new Vector3(size[0] / 2, size[1] / 2, (bottom + this.high) / 2),
      Math.hypot(size[0], size[1], this.high - bottom) / 2);
    this.mesh.geometry.dispose();
    this.mesh.geometry = geometry;
    return cut.error;
  }

  /**
   * Computes normals of all posts, or only of the rim, from neighbouring posts.
   * @param {function(number, number): number} around height of a post beyond the tile, NaN: unknown
   */
  shade(around, rimOnly = false) {
    const {nx, ny, heights} = this, {normals} = this.textures, out = normals.image.data;
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
    for (let j = 0; j < ny; ++j) {
      const step = rimOnly && j > 0 && j < ny - 1 ? nx - 1 : 1;
      for (let i = 0; i < nx; i += step) shadePost(i, j);
    }
    normals.needsUpdate = true;
  }

  /** @param {Float32Array} heights of the design at the posts, above the scene's datum; NaN: unknown */
  setDesign(heights) {
    const above = this.heights.map((z, k) => z - heights[k]);
    this.fromDesign_m = above.reduce((most, d) => (Math.abs(d) > most ? Math.abs(d) : most), 0);
    this.textures.above?.dispose();
    this.textures.above = this.mesh.material.uniforms.above.value = heightTexture(this.nx, this.ny, above);
    this.mesh.material.uniforms.designed.value = this.designed = true;
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
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
    for (const texture of Object.values(this.textures)) texture?.dispose();
  }
}
