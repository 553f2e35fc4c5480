// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Triangles of a tile of terrain, as few as a tolerance permits: a right-triangulated irregular
// network (Evans et al. 2001). A triangle is halved at the middle of its hypotenuse while posts are
// too far above or below it. Both triangles at a hypotenuse are halved alike, so that no triangle
// has a vertex in the middle of a side. Skirts below the tile's sides hide gaps to other tiles.

export class TerrainMesh {
  #heights;          // of the network, which may be larger than the tile
  #errors;           // of the two triangles at a hypotenuse, by the post in its middle
  #corners = [];     // triangles that the network lacks: those in cells with one void

  /** @param {Float32Array} heights of nx x ny posts, row by row; NaN: void */
  constructor(nx, ny, heights) {
    Object.assign(this, {nx, ny});
    this.cells = 2;   // along the network
    while (this.cells < Math.max(nx, ny) - 1) this.cells *= 2;
    const {cells} = this, posts = cells + 1;
    this.#heights = new Float32Array(posts * posts).fill(NaN);
    for (let j = 0; j < ny; ++j) this.#heights.set(heights.subarray(j * nx, (j + 1) * nx), j * posts);
    this.#errors = new Float32Array(posts * posts);
    if (this.#heights.some(Number.isNaN)) this.#refineAroundVoids();
    for (let half = 1; 2 * half <= cells; half *= 2) {
      for (let j = 0; j <= cells; j += half) {
        const odd = (j / half) % 2 === 1;
        for (let i = odd ? 0 : half; i <= cells; i += 2 * half) this.#judge(i, j, odd ? 0 : half, odd ? half : 0);
      }
      for (let j = half; j < cells; j += 2 * half) {
        for (let i = half; i < cells; i += 2 * half) this.#judge(i, j, half, (i + j) % (4 * half) === 2 * half ? half : -half);
      }
    }
  }

  /** All posts of cells that are partly void become vertices. */
  #refineAroundVoids() {
    const {cells} = this, posts = cells + 1, heights = this.#heights;
    for (let j = 0; j < cells; ++j) {
      for (let i = 0; i < cells; ++i) {
        const at = j * posts + i, cell = [at, at + 1, at + posts + 1, at + posts];
        const ground = cell.filter((post) => !Number.isNaN(heights[post]));
        if (ground.length === 0 || ground.length === 4) continue;
        for (const post of cell) this.#errors[post] = Infinity;
        // The network divides cells between posts of even numbers.
        if (ground.length === 3 && ground.filter((post) => post % 2 === 0).length === 1) this.#corners.push(ground);
      }
    }
  }

  /** The errors of the triangles whose hypotenuse has its middle at (i, j) and goes by (di, dj) from there. */
  #judge(i, j, di, dj) {
    const {cells} = this, posts = cells + 1, z = this.#heights, errors = this.#errors, at = j * posts + i;
    const within = (x, y) => x >= 0 && y >= 0 && x <= cells && y <= cells;
    let error = errors[at];
    if ((di + dj) % 2 === 0) {   // not less than those of their halves
      let u = (di - dj) / 2, v = (di + dj) / 2;
      for (let k = 0; k < 4; ++k) {
        if (within(i + u, j + v)) error = Math.max(error, errors[at + v * posts + u]);
        const before = u;
        u = -v;
        v = before;
      }
    }
    const step = dj * posts + di, aside = di * posts - dj;
    const middle = (z[at - step] + z[at + step]) / 2, rise = (z[at + step] - z[at - step]) / 2;
    const left = (within(i - dj, j + di) ? z[at + aside] : NaN) - middle;
    const right = (within(i + dj, j - di) ? z[at - aside] : NaN) - middle;
    const isSquare = di * dj !== 0, reach = Math.max(di, dj), size = di * di + dj * dj;
    for (let y = Math.max(-reach, -j); y <= Math.min(reach, cells - j); ++y) {
      const width = isSquare ? reach : reach - Math.abs(y), end = Math.min(width, cells - i);
      for (let x = Math.max(-width, -i); x <= end; ++x) {
        const along = (x * di + y * dj) / size, off = (y * di - x * dj) / size;
        const plane = middle + along * rise + (off > 0 ? off * left : off < 0 ? -off * right : 0);
        const own = Math.abs(z[at + y * posts + x] - plane);
        if (own > error) error = own;   // false at voids
      }
    }
    errors[at] = error;
  }

  /**
   * @param {number} tolerance of heights
   * @param {function(number, number): number} footOf the skirt's foot at a side (0 to 3: south,
   *     east, north, west) below a height
   * @return {{grid: Uint16Array, height: Float32Array, side: Int8Array, index: Uint32Array, error: number}}
   *     column and row, height, and side (-1: on the ground) of each vertex; triangles,
   *     counter-clockwise from above or outside; largest distance of posts from them
   */
  cut(tolerance, footOf) {
    const {nx, ny, cells} = this, posts = cells + 1, z = this.#heights, errors = this.#errors;
    const most = posts * posts + 8 * posts;   // vertices
    const grid = new Uint16Array(2 * most), height = new Float32Array(most), side = new Int8Array(most);
    const index = new Uint32Array(6 * (cells + 4) * cells), vertexAt = new Int32Array(posts * posts).fill(-1);
    let vertices = 0, corners = 0, error = 0;
    const add = (post, z, of) => {
      grid[2 * vertices] = post % posts;
      grid[2 * vertices + 1] = Math.floor(post / posts);
      height[vertices] = z;
      side[vertices] = of;
      return vertices++;
    };
    const triangle = (a, b, c) => {
      index[corners++] = a;
      index[corners++] = b;
      index[corners++] = c;
    };
    const vertex = (post) => {
      if (vertexAt[post] < 0) vertexAt[post] = add(post, z[post], -1);
      return vertexAt[post];
    };
    const divide = (a, b, c, times) => {   // the hypotenuse is from a to b
      if (times > 0) {
        const middle = (a + b) / 2;
        if (errors[middle] > tolerance) {
          divide(c, a, middle, times - 1);
          divide(b, c, middle, times - 1);
          return;
        }
        error = Math.max(error, errors[middle]);
      }
      if (!Number.isNaN(z[a] + z[b] + z[c])) triangle(vertex(a), vertex(b), vertex(c));
    };
    const first = 0, last = posts * posts - 1, times = 2 * Math.log2(cells);
    divide(last, first, cells, times);
    divide(first, last, last - cells, times);
    for (const corner of this.#corners) triangle(...corner.map(vertex));
    [[0, 1, nx], [nx - 1, posts, ny], [(ny - 1) * posts + nx - 1, -1, nx], [(ny - 1) * posts, -posts, ny]].forEach(([start, step, count], at) => {
      let before = -1;
      for (let k = 0, post = start; k < count; ++k, post += step) {
        if (Number.isNaN(z[post])) before = -1;
        if (vertexAt[post] < 0) continue;
        const top = add(post, z[post], at), foot = add(post, footOf(at, z[post]), at);
        if (before >= 0) {
          triangle(before, before + 1, foot);
          triangle(before, foot, top);
        }
        before = top;
      }
    });
    const used = (array, count) => array.slice(0, count);
    return {grid: used(grid, 2 * vertices), height: used(height, vertices), side: used(side, vertices), index: used(index, corners), error};
  }
}
