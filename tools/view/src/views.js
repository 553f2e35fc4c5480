// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The shown ground: live, at another time, or compared with another time. A new view replaces the
// last when it is complete; the first is shown at once.
import {blockKey, decodeBlock, inflate} from './decode.js';
import {Blocks} from './blocks.js';
import {ChunkTable} from './chunk_table.js';

const kBudget_ms = 7;   // of decoding at a time

export class Views {
  /** Newest message by view and block, in order of arrival. */
  #queue = new Map();
  #sequence = new Map();
  #inflating = 0;
  #counter = 0;
  #whole = new Set();
  #scheduled = false;
  #changed = false;
  /** @type {?{id: number, blocks: Blocks}} */
  coming = null;
  rejected = 0;

  /** @param {Object} scene needs of blocks: site, origin, uniforms, parent @param {function()} changed */
  constructor(scene, changed) {
    this.scene = scene;
    this.changed = changed;
    this.shown = this.#fresh(0);
    this.#attach(this.shown);
  }

  #fresh(id) {
    const {site, origin, uniforms} = this.scene;
    return {id, blocks: new Blocks(site, origin, uniforms.blockMaterial, new ChunkTable()), seen: false};
  }

  #attach(view) {
    this.scene.parent.add(view.blocks.group);
    this.#showTable(view.blocks);
  }

  #showTable(blocks) {
    blocks.table.build();
    this.scene.uniforms.setChunks(blocks.table);
    blocks.tableChanged = false;
  }

  /** Starts a view whose blocks follow; it is shown when it is complete. */
  expect(id) {
    this.coming?.blocks.dispose();
    this.coming = null;
    this.#whole.clear();
    this.#queue.clear();
    if (this.shown.blocks.count === 0 && !this.shown.seen) this.shown.id = id;
    else this.coming = this.#fresh(id);
  }

  /** Called when all blocks of the view were sent. */
  whole(id) {
    this.#whole.add(id);
    this.#schedule();
  }

  /** Takes a binary message. */
  async receive(buffer) {
    const number = ++this.#counter;
    ++this.#inflating;
    try {
      const bytes = await inflate(buffer);
      const head = new DataView(bytes);
      const key = `${head.getUint32(12, true)}:${blockKey({
        bx: head.getInt32(0, true), by: head.getInt32(4, true), bz: head.getInt32(8, true)})}`;
      if ((this.#sequence.get(key) ?? 0) > number) return;
      this.#sequence.set(key, number);
      this.#queue.delete(key);
      this.#queue.set(key, bytes);
    } catch (error) {
      this.#reject(error);
    } finally {
      --this.#inflating;
      this.#schedule();
    }
  }

  #reject(error) {
    ++this.rejected;
    this.lastError = error.message;
  }

  /** @return {boolean} whether the picture changed since the last call */
  takeChange() {
    const changed = this.#changed;
    this.#changed = false;
    return changed;
  }

  /** Decodes independently of drawing, which is slow without a graphics card. */
  #schedule() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    setTimeout(() => {
      this.#scheduled = false;
      if (this.#work()) this.#changed = true;
      this.changed();
      if (this.#queue.size > 0 || this.shown.blocks.unstitched) this.#schedule();
    });
  }

  /** Decodes messages for some milliseconds. @return {boolean} whether the picture changed */
  #work() {
    const end = performance.now() + kBudget_ms;
    let changed = false;
    for (const [key, bytes] of this.#queue) {
      this.#queue.delete(key);
      try {
        const block = decodeBlock(bytes);
        const view = [this.coming, this.shown].find((v) => v?.id === block.view);
        if (view) {
          view.blocks.put(block);
          view.seen = true;
          changed ||= view === this.shown;
        }
      } catch (error) {
        this.#reject(error);
      }
      if (performance.now() > end) break;
    }
    if (this.#queue.size === 0 && this.#inflating === 0) {
      this.#sequence.clear();
      if (this.coming && this.#whole.has(this.coming.id)) {
        this.shown.blocks.dispose();
        this.shown = this.coming;
        this.coming = null;
        this.shown.seen = true;
        this.#attach(this.shown);
        changed = true;
      }
    }
    const {blocks} = this.shown;
    if (blocks.tableChanged) this.#showTable(blocks);
    return blocks.stitch(kBudget_ms) || changed;
  }

  get busy() {
    return this.#queue.size > 0 || this.#inflating > 0;
  }

  /** Whether the shown view is complete. */
  get settled() {
    return !this.busy && this.coming === null && this.#whole.has(this.shown.id);
  }

  /** Whether a place in the scene lies in a resident chunk. */
  covers(x, y, z) {
    const {site, origin} = this.scene;
    const chunk = [x, y, z].map((v, axis) => Math.floor((v + origin[axis] - site.origin[axis]) / (8 * site.voxel_size_m)));
    return this.shown.blocks.table.has(...chunk);
  }
}
