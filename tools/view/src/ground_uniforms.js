// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Uniforms that all materials of the ground share: colours and resident chunks.
import {DataTexture, FrontSide, DoubleSide, IntType, LinearFilter, LinearMipmapLinearFilter, NearestFilter, RedFormat, RepeatWrapping, RGBAFormat, RGBAIntegerFormat, ShaderMaterial, Vector2, Vector3, Vector4} from 'three';
import {kBlockFragment, kBlockVertex, kTerrainFragment, kTerrainVertex} from './ground_shader.js';
import {clodTexels, kClodTexels, kRampRows, kRampWidth, rampTexels} from './ramps.js';

/** A height of tiles, in the scene or above the design, where it is unknown. */
export const kNotKnown = -1e9;

/** The colour modes; an index in this list is `mode` in the shaders. */
export const kModes = ['change', 'depth', 'height', 'loose', 'design', 'sigma'];

function rampTexture() {
  const texture = new DataTexture(rampTexels(), kRampWidth, kRampRows.length, RGBAFormat);
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

function clodTexture() {
  const texture = new DataTexture(clodTexels(), kClodTexels, kClodTexels, RedFormat);
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.magFilter = LinearFilter;
  texture.minFilter = LinearMipmapLinearFilter;
  texture.generateMipmaps = true;
  texture.anisotropy = 4;
  texture.needsUpdate = true;
  return texture;
}

function chunkTexture(table) {
  const texture = new DataTexture(table.data, table.width, table.rows, RGBAIntegerFormat, IntType);
  texture.internalFormat = 'RGBA32I';
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.unpackAlignment = 4;
  texture.needsUpdate = true;
  return texture;
}

export class GroundUniforms {
  values = {
    mode: {value: 0}, ramps: {value: rampTexture()}, clod_light: {value: clodTexture()}, patterns: {value: false},
    most_m: {value: 1}, dead_m: {value: 0.02}, step_m: {value: 0.5},
    low_m: {value: 0}, high_m: {value: 1}, contour_m: {value: 1}, grid_m: {value: 10}, grid_from_m: {value: new Vector2()},
    drape: {value: null}, draped: {value: false}, drape_box: {value: new Vector4()}, compares: {value: false}, undug_m: {value: 0},
    sigmas: {value: null}, sigma_box: {value: new Vector4()}, least_sigma_m: {value: 0.003},
    clod_m: {value: 0.1}, exposure: {value: 1}, pixel_ratio: {value: 1}, voxel_m: {value: 0.05},
    sun: {value: new Vector3(-0.48, 0.31, 0.82).normalize()},
    chunks: {value: null}, slot_mask: {value: 0}, probes: {value: 0},
    low_block: {value: new Int32Array([1, 1, 1])}, high_block: {value: new Int32Array(3)},
  };

  /** The material of all blocks. */
  blockMaterial = new ShaderMaterial({
    uniforms: this.values, vertexShader: kBlockVertex, fragmentShader: kBlockFragment, side: DoubleSide,
  });

  /** A material per tile; all use one program. */
  terrainMaterial(own) {
    return new ShaderMaterial({
      uniforms: {...this.values, ...own}, vertexShader: kTerrainVertex, fragmentShader: kTerrainFragment, side: FrontSide,
    });
  }

  /** @param {import('./chunk_table.js').ChunkTable} table rebuilt just before */
  setChunks(table) {
    const {chunks, slot_mask, probes, low_block, high_block} = this.values;
    if (chunks.value?.image.data === table.data) {
      chunks.value.needsUpdate = true;
    } else {
      chunks.value?.dispose();
      chunks.value = chunkTexture(table);
    }
    slot_mask.value = table.slots - 1;
    probes.value = table.probes;
    low_block.value.set(table.low);
    high_block.value.set(table.high);
  }
}
