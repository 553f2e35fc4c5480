// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A hash table of the resident chunks, which fragment shaders can read, too: they hide terrain
// where blocks draw the ground.

const kRowSlots = 128;   // slots in a row of the texture, two texels each: key, mask

/** As in ground_shader.js. */
function hash(x, y, z) {
  let h = Math.imul(x, 73856093) ^ Math.imul(y, 19349663) ^ Math.imul(z, 83492791);
  h = Math.imul(h ^ (h >>> 15), 0x85ebca77);
  return (h ^ (h >>> 13)) >>> 0;
}

export class ChunkTable {
  /** Blocks by key, as [x, y, z, lo, hi] in units of blocks. */
  #blocks = new Map();
  /** Slots of [x, y, z, 1, lo, hi, 0, 0]; a key whose fourth number is 0 is free. */
  data = new Int32Array(kRowSlots * 8);
  slots = kRowSlots;
  probes = 0;
  low = [1, 1, 1];   // of blocks; low > high while the table is empty
  high = [0, 0, 0];

  /** @return {boolean} whether anything changed */
  set(x, y, z, lo, hi) {
    const key = `${x},${y},${z}`, before = this.#blocks.get(key);
    if (lo === 0 && hi === 0) return this.#blocks.delete(key);
    if (before && before[3] === lo && before[4] === hi) return false;
    this.#blocks.set(key, [x, y, z, lo, hi]);
    return true;
  }

  clear() {
    this.#blocks.clear();
  }

  /** Whether a chunk is resident; coordinates in units of chunks. */
  has(x, y, z) {
    const block = this.#blocks.get(`${x >> 2},${y >> 2},${z >> 2}`);
    if (!block) return false;
    const bit = ((x & 3) * 4 + (y & 3)) * 4 + (z & 3);
    return ((block[3 + (bit >> 5)] >>> (bit & 31)) & 1) === 1;
  }

  /** Rebuilds `data`. */
  build() {
    while (this.slots < 2 * this.#blocks.size) this.slots *= 2;
    if (this.data.length !== 8 * this.slots) this.data = new Int32Array(8 * this.slots);
    else this.data.fill(0);
    this.probes = 0;
    this.low = [1, 1, 1];
    this.high = [0, 0, 0];
    let first = true;
    for (const block of this.#blocks.values()) {
      let slot = hash(block[0], block[1], block[2]) & (this.slots - 1), tries = 1;
      while (this.data[8 * slot + 3] !== 0) {
        slot = (slot + 1) & (this.slots - 1);
        ++tries;
      }
      this.data.set([block[0], block[1], block[2], 1, block[3] | 0, block[4] | 0, 0, 0], 8 * slot);
      this.probes = Math.max(this.probes, tries);
      for (let axis = 0; axis < 3; ++axis) {
        this.low[axis] = first ? block[axis] : Math.min(this.low[axis], block[axis]);
        this.high[axis] = first ? block[axis] : Math.max(this.high[axis], block[axis]);
      }
      first = false;
    }
  }

  get width() {
    return 2 * kRowSlots;
  }
  get rows() {
    return this.slots / kRowSlots;
  }
  get size() {
    return this.#blocks.size;
  }
}
