// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the page makes of numbers, without a browser.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import test from 'node:test';
import zlib from 'node:zlib';
import {alarmLines} from '../../tools/view/src/alarms.js';
import {ChunkTable} from '../../tools/view/src/chunk_table.js';
import {decodeBlock, decodeSigmas, inflate} from '../../tools/view/src/decode.js';
import {LargestForce, arrowScale, forceText, limitText} from '../../tools/view/src/force_values.js';
import * as format from '../../tools/view/src/format.js';
import {vertexNormals, writeNormals} from '../../tools/view/src/normals.js';
import {boxOf, freeBox, placeTag} from '../../tools/view/src/tag_place.js';
import {TerrainMesh} from '../../tools/view/src/terrain_mesh.js';
import {sliderStart} from '../../tools/view/src/timeline.js';
import * as units from '../../tools/view/src/units.js';

/** An array as differences in planes of bytes: written from the protocol's text, not from the decoder. */
function planes(values, bytes) {
  const modulus = 2 ** (8 * bytes);
  return plain(values.map((v, i) => (v - (i > 0 ? values[i - 1] : 0) + modulus) % modulus), bytes);
}

function plain(values, bytes) {
  return Buffer.from(Array.from({length: bytes}, (_, b) => values.map((v) => Math.floor(v / 256 ** b) % 256)).flat());
}

/** Corners as the text has them: 0 for the next vertex, else how far back it is. */
function counted(index) {
  let next = 0;
  return index.map((v) => (v === next ? 0 * next++ : next - v));
}

function message({first = [32, -64, 1e6 * 32], view = 7, lo = 0x80000001, hi = 5, points, change, design, loose, index, corners = counted(index)}) {
  const n = points.length, head = Buffer.alloc(36);
  first.forEach((v, i) => head.writeInt32LE(v, 4 * i));
  [view, lo, hi, n, corners.length / 3, design ? 1 : 0].forEach((v, i) => head.writeUInt32LE(v, 12 + 4 * i));
  const u16 = (v) => v.map((x) => x & 0xffff);
  return Buffer.concat([head, ...[0, 1, 2].map((axis) => planes(points.map((p) => p[axis]), 2)), planes(u16(change), 2),
    ...(design ? [planes(u16(design), 2)] : []), planes(loose, 2), plain(corners, n > 65535 ? 4 : 2)]);
}

const exact = (buffer) => buffer.buffer.slice(buffer.byteOffset, buffer.byteOffset + buffer.length);
const triangle = {
  points: [[0, 65535, 8192], [65535, 0, 8193], [8192, 40960, 300]], change: [-32768, 32767, -1], design: [0, -32768, 12],
  loose: [65535, 0, 1], index: [0, 1, 2, 1, 0, 2],
};

test('a block is read back as it was written, whatever its differences wrap around', async () => {
  for (const design of [triangle.design, undefined]) {
    const block = decodeBlock(await inflate(zlib.deflateSync(message({...triangle, design}))));
    assert.deepEqual([block.bx, block.by, block.bz, block.view, block.lo, block.hi], [32, -64, 32e6, 7, 0x80000001, 5]);
    assert.deepEqual([...block.points], triangle.points.flat());
    assert.deepEqual([...block.change], triangle.change);
    assert.deepEqual(block.design && [...block.design], design ?? null);
    assert.deepEqual([...block.loose], triangle.loose);
    assert.deepEqual([...block.index], triangle.index);
  }
});

test('a block of more than 65535 vertices has indices of 32 bits', () => {
  const n = 70000, points = Array.from({length: n}, (_, i) => [i & 0xffff, 0, 0]), zeros = new Array(n).fill(0);
  const index = [...Array.from(zeros, (_, i) => i), 0, 65536];
  const block = decodeBlock(exact(message({points, change: zeros, loose: zeros, index})));
  assert.deepEqual([...block.index], index);
});

test('a block without a surface has no vertices', () => {
  const block = decodeBlock(exact(message({points: [], change: [], loose: [], index: []})));
  assert.equal(block.points.length, 0);
});

test('what is no block is refused: too short, too long, a corner beyond the vertices', () => {
  const good = exact(message(triangle));
  assert.throws(() => decodeBlock(good.slice(0, 20)), /no head/);
  for (let cut = 36; cut < good.byteLength; ++cut) assert.throws(() => decodeBlock(good.slice(0, cut)), /bytes, not/);
  assert.throws(() => decodeBlock(exact(Buffer.concat([Buffer.from(good), Buffer.alloc(1)]))), /bytes, not/);
  assert.throws(() => decodeBlock(exact(message({...triangle, corners: [0, 0, 3]}))), /a corner 3 before vertex 2/);
  assert.throws(() => decodeBlock(exact(message({...triangle, corners: [0, 0, 0, 0, 1, 1]}))), /a corner 0 before vertex 3/);
});

test('a corner of 32 bits counts with all of them', () => {
  const n = 65536, points = Array.from({length: n}, (_, i) => [i, 0, 0]), zeros = new Array(n).fill(0);
  for (const far of [2 ** 24 + 1, 2 ** 31 + 1]) {
    const corners = [...zeros, far, 1];
    assert.throws(() => decodeBlock(exact(message({points, change: zeros, loose: zeros, corners}))), new RegExp(`a corner ${far} before vertex ${n}`));
  }
});

/** As the shader looks chunks up, in the table's bare numbers. */
function lookUp(table, [x, y, z]) {
  const block = [x >> 2, y >> 2, z >> 2];
  let h = Math.imul(block[0], 73856093) ^ Math.imul(block[1], 19349663) ^ Math.imul(block[2], 83492791);
  h = Math.imul(h ^ (h >>> 15), 0x85ebca77);
  let slot = ((h ^ (h >>> 13)) >>> 0) & (table.slots - 1);
  for (let i = 0; i < table.probes; ++i, slot = (slot + 1) & (table.slots - 1)) {
    const key = table.data.subarray(8 * slot, 8 * slot + 8);
    if (key[3] === 0) return false;
    if (block.some((v, axis) => v !== key[axis])) continue;
    const bit = ((x & 3) * 4 + (y & 3)) * 4 + (z & 3);
    return ((key[4 + (bit >> 5)] >> (bit & 31)) & 1) === 1;
  }
  return false;
}

test('sigmas are read as the protocol has them, and what is too short or too long is refused', () => {
  const message = (nx, ny, cells) => {
    const bytes = Buffer.alloc(32 + 2 * cells.length);
    [512000.25, -7.5, 0.1].forEach((v, i) => bytes.writeDoubleLE(v, 8 * i));
    [nx, ny].forEach((v, i) => bytes.writeUInt32LE(v, 24 + 4 * i));
    cells.forEach((v, i) => bytes.writeUInt16LE(v, 32 + 2 * i));
    return exact(bytes);
  };
  const {west, south, cell_m, nx, ny, sigmas_m} = decodeSigmas(message(3, 2, [30, 65535, 65534, 0, 1, 3000]));
  assert.deepEqual([west, south, cell_m, nx, ny], [512000.25, -7.5, 0.1, 3, 2]);
  assert.ok(sigmas_m[1] < 0);
  [0.003, null, 6.5534, 0, 0.0001, 0.3].forEach((wanted, i) => assert.ok(wanted === null || Math.abs(sigmas_m[i] - wanted) < 1e-6, `${sigmas_m[i]} is not ${wanted}`));
  assert.equal(decodeSigmas(message(0, 0, [])).sigmas_m.length, 0);
  for (const wrong of [message(3, 2, [1, 2, 3, 4, 5]), message(3, 2, [1, 2, 3, 4, 5, 6, 7]), exact(Buffer.alloc(30))]) assert.throws(() => decodeSigmas(wrong), /bytes/);
});

test('the table of chunks says of each chunk what was last said, by its map and by the numbers for the shader', () => {
  let seed = 12345;
  const random = (n) => (seed = (Math.imul(seed, 1103515245) + 12345) >>> 0) % n;
  const table = new ChunkTable(), truth = new Map();
  for (let n = 0; n < 3000; ++n) {
    const block = [random(20) - 10, random(20) + 90000, random(5) - 2];
    const empty = random(4) === 0, lo = empty ? 0 : random(2 ** 32) >>> 0, hi = empty ? 0 : random(2 ** 32) >>> 0;
    table.set(...block, lo, hi);
    truth.set(block.join(), [lo, hi]);
  }
  table.build();
  for (let n = 0; n < 20000; ++n) {
    const chunk = [random(84) - 42, random(84) + 360000 - 2, random(24) - 10];
    const [lo, hi] = truth.get(chunk.map((v) => v >> 2).join()) ?? [0, 0];
    const bit = ((chunk[0] & 3) * 4 + (chunk[1] & 3)) * 4 + (chunk[2] & 3);
    const resident = (((bit < 32 ? lo : hi) >>> (bit & 31)) & 1) === 1;
    assert.equal(table.has(...chunk), resident);
    assert.equal(lookUp(table, chunk), resident);
  }
});

test('neighbours have the same normal at vertices they share: the whole surface’s', () => {
  // A bumpy surface over two blocks, cut at x = 32 voxels.
  const z = (i, j) => Math.round(8192 + 16384 + 3000 * Math.sin(i / 3) + 2000 * Math.cos(j / 5));
  const part = (from, to) => {
    const points = [], index = [], width = to - from + 1;
    for (let j = 0; j <= 32; ++j) for (let i = from; i <= to; ++i) points.push(8192 + 1024 * (i - from), 8192 + 1024 * j, z(i, j));
    for (let j = 0; j < 32; ++j) {
      for (let i = 0; i + 1 < width; ++i) {
        const a = j * width + i;
        index.push(a, a + 1, a + width + 1, a, a + width + 1, a + width);
      }
    }
    return {points: new Uint16Array(points), index: new Uint16Array(index)};
  };
  const [left, right] = [part(0, 32), part(32, 64)].map((p) => ({...p, ...vertexNormals(p.points, p.index)}));
  const normals = (own, neighbour) => {
    const out = new Int8Array((4 * own.points.length) / 3);
    writeNormals(own, own.points, neighbour, out);
    return out;
  };
  const a = normals(left, (dx, dy, dz) => (dx === 1 && dy === 0 && dz === 0 ? right : null));
  const b = normals(right, (dx, dy, dz) => (dx === -1 && dy === 0 && dz === 0 ? left : null));
  const alone = normals(left, () => null);
  let differ = 0;
  for (let j = 1; j < 32; ++j) {
    const i = 4 * (j * 33 + 32), k = 4 * (j * 33);
    assert.deepEqual([...a.slice(i, i + 3)], [...b.slice(k, k + 3)]);
    if (String(a.slice(i, i + 3)) !== String(alone.slice(i, i + 3))) ++differ;
  }
  assert.ok(differ > 0, 'or the neighbour adds nothing');
});

/** Random ground with voids: nx x ny heights, and numbers from 0 to 1. */
function randomGround(nx, ny, seed, voids) {
  let state = seed;
  const random = () => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) / 2 ** 32;
  const waves = Array.from({length: 4}, () => [random() / 3, random() / 3, 6 * random()]), rough = random() ** 3;
  const heights = Float32Array.from({length: nx * ny}, (_, k) => waves.reduce((z, [u, v, w]) => z + Math.sin(u * (k % nx) + v * Math.floor(k / nx) + w), rough * random()));
  for (let n = 0; n < voids; ++n) {
    const x = random() * nx, y = random() * ny, radius = 0.5 + random() * Math.min(nx, ny) / 6;
    heights.forEach((_, k) => { if (Math.hypot((k % nx) - x, Math.floor(k / nx) - y) < radius) heights[k] = NaN; });
  }
  return heights;
}

/** Each cell's four triangles to its middle - south, east, north, west - by the triangles over them. */
function quartersCovered(triangles, nx) {
  const count = new Map();
  for (const [a, b, c] of triangles) {
    const inside = (x, y) => [[a, b], [b, c], [c, a]].every(([p, q]) => (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) > 0);
    const [x0, x1, y0, y1] = [0, 1].flatMap((axis) => [Math.min(a[axis], b[axis], c[axis]), Math.max(a[axis], b[axis], c[axis])]);
    for (let j = y0; j < y1; ++j) {
      for (let i = x0; i < x1; ++i) {
        [[0.5, 0.2], [0.8, 0.5], [0.5, 0.8], [0.2, 0.5]].forEach(([x, y], quarter) => {
          const key = 4 * (j * nx + i) + quarter;
          if (inside(i + x, j + y)) count.set(key, (count.get(key) ?? 0) + 1);
        });
      }
    }
  }
  return count;
}

test('triangles of terrain cover its ground once, without gaps, and no post is farther from them than is tolerated', () => {
  let partial = 0, voids = 0, coarse = 0;
  const sizes = [[2, 2], [3, 3], [9, 2], [5, 40], [17, 17], [33, 21], [65, 65], [50, 64]];
  for (let n = 0; n < 96; ++n) {
    const [nx, ny] = sizes[n % sizes.length], z = randomGround(nx, ny, n + 1, n % 3 === 0 ? 0 : n % 5);
    const isGround = (i, j) => i >= 0 && j >= 0 && i < nx && j < ny && !Number.isNaN(z[j * nx + i]);
    const tolerance = [0, 0.02, 0.2, 1.5, 100][n % 5], where = `ground ${n}`, foot = (side, h) => h - 1 - side;
    const mesh = new TerrainMesh(nx, ny, z).cut(tolerance, foot);
    const at = (v) => [mesh.grid[2 * v], mesh.grid[2 * v + 1], mesh.height[v]];
    const all = Array.from({length: mesh.index.length / 3}, (_, t) => [...mesh.index.subarray(3 * t, 3 * t + 3)]);
    const ground = all.filter(([a]) => mesh.side[a] < 0), triangles = ground.map((t) => t.map(at));
    for (const [i, j, h] of triangles.flat()) assert.equal(h, z[j * nx + i], where);

    const covered = quartersCovered(triangles, nx);
    for (let j = 0; j + 1 < ny; ++j) {
      for (let i = 0; i + 1 < nx; ++i) {
        const [a, b, c, d] = [isGround(i, j), isGround(i + 1, j), isGround(i + 1, j + 1), isGround(i, j + 1)], known = a + b + c + d;
        // Three posts have a triangle; its two legs are sides of the cell.
        const legs = known === 4 ? [true, true, true, true] : known === 3 ? [a && b, b && c, c && d, d && a] : [false, false, false, false];
        legs.forEach((is, quarter) => assert.equal(covered.get(4 * (j * nx + i) + quarter) ?? 0, is ? 1 : 0, `${where}, cell ${i}, ${j}`));
        if (known === 3) ++partial;
        if (known < 4) ++voids;
      }
    }

    let worst = 0;
    for (const [a, b, c] of triangles) {
      const det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
      assert.ok(det > 0, `${where}: counter-clockwise`);
      const [x0, x1, y0, y1] = [0, 1].flatMap((axis) => [Math.min(a[axis], b[axis], c[axis]), Math.max(a[axis], b[axis], c[axis])]);
      for (let y = y0; y <= y1; ++y) {
        for (let x = x0; x <= x1; ++x) {
          const s = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det, t = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det;
          if (s < 0 || t < 0 || s + t > 1) continue;
          assert.ok(isGround(x, y), `${where}: ${x}, ${y} is void`);
          worst = Math.max(worst, Math.abs((1 - s - t) * a[2] + s * b[2] + t * c[2] - z[y * nx + x]));
        }
      }
    }
    assert.ok(worst <= mesh.error + 1e-6 && mesh.error <= tolerance, `${where}: ${worst}, ${mesh.error}, ${tolerance}`);
    if (worst > 0) ++coarse;

    const edges = new Set(ground.flatMap(([a, b, c]) => [`${a},${b}`, `${b},${c}`, `${c},${a}`]));
    assert.equal(edges.size, 3 * ground.length, `${where}: each edge once in each direction`);
    const tops = new Set(), name = (a, b) => [a, b].map((v) => at(v).slice(0, 2)).join(' ');
    for (const [a, b, c] of all.filter(([v]) => mesh.side[v] >= 0)) {
      const side = mesh.side[a], [p, q, r] = [a, b, c].map(at), [u, v] = [q, r].map((e) => e.map((x, axis) => x - p[axis]));
      assert.deepEqual([mesh.side[b], mesh.side[c]], [side, side]);
      const out = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2]], towards = [[0, -1], [1, 0], [0, 1], [-1, 0]][side];
      assert.ok(out[0] * towards[0] + out[1] * towards[1] > 0, `${where}: skirts face outwards`);
      for (const [i, j, h] of [p, q, r]) assert.ok(h === z[j * nx + i] || Math.abs(h - foot(side, z[j * nx + i])) < 1e-6);
      if (r[2] !== z[r[1] * nx + r[0]]) continue;
      tops.add(name(a, c));
      const steps = Math.max(Math.abs(r[0] - p[0]), Math.abs(r[1] - p[1]));
      for (let k = 0; k <= steps; ++k) assert.ok(isGround(p[0] + ((r[0] - p[0]) * k) / steps, p[1] + ((r[1] - p[1]) * k) / steps), `${where}: no skirt at a void`);
    }
    for (const edge of edges) {
      const [a, b] = edge.split(',').map(Number);
      if (edges.has(`${b},${a}`)) continue;
      const [i, j] = at(a), [u, v] = at(b), x = Math.sign(u - i), y = Math.sign(v - j);
      // What is right of the edge's first cell: nothing, or another triangle would have a vertex within the edge.
      const px = i + 0.5 * x + 0.2 * y, py = j + 0.5 * y - 0.2 * x, cx = Math.floor(px), cy = Math.floor(py), fx = px - cx - 0.5, fy = py - cy - 0.5;
      const beside = x * y === 0 ? [Math.abs(fy) > Math.abs(fx) ? (fy < 0 ? 0 : 2) : fx > 0 ? 1 : 3] : [fy < 0 ? 0 : 2, fx > 0 ? 1 : 3];
      for (const quarter of beside) assert.ok(!covered.has(4 * (cy * nx + cx) + quarter) || cx < 0 || cx > nx - 2, `${where}: ${edge} has another triangle beside it`);
      const onSide = (i === u && (i === 0 || i === nx - 1)) || (j === v && (j === 0 || j === ny - 1));
      if (onSide) assert.ok(tops.has(name(a, b)), `${where}: the side from ${[i, j]} to ${[u, v]} has a skirt`);
    }
  }
  assert.ok(partial > 100 && voids > 1000 && coarse > 30, `${partial} ${voids} ${coarse}`);
});

test('level terrain has two triangles and a skirt at each side, an even slope no more', () => {
  for (const slope of [0, 0.25]) {
    const z = Float32Array.from({length: 257 * 257}, (_, k) => 400 + slope * (k % 257) - 2 * slope * Math.floor(k / 257));
    const mesh = new TerrainMesh(257, 257, z).cut(1e-9, (side, h) => h - 1);
    assert.equal(mesh.index.length, 3 * (2 + 4 * 2));
    assert.equal(mesh.error, 0);
  }
});

test('numbers have three digits, at most three decimals, units and a minus sign', () => {
  const plain = (text) => text.replaceAll('\u2009', ' ');
  assert.equal(plain(format.volume(12.034)), '12.0 m³');
  assert.equal(plain(format.volume(0.0123456)), '0.012 m³');
  assert.equal(plain(format.volume(0.00099)), '< 0.001 m³');
  assert.equal(plain(format.area(0.000045)), '< 0.001 m²');
  assert.equal(plain(format.signedVolume(-0.0004)), '< 0.001 m³');
  assert.equal(plain(format.signedVolume(0.0004)), '< 0.001 m³');
  assert.equal(plain(format.signedVolume(0.0104)), '+0.010 m³');
  assert.equal(plain(format.volume(0)), '0 m³');
  assert.equal(plain(format.volume(9.9996)), '10.0 m³');
  assert.equal(plain(format.volume(123456)), '123 000 m³');
  assert.equal(plain(format.signedVolume(-4.655)), '\u22124.66 m³');
  assert.equal(plain(format.rate(16.63)), '16.6 m³/h');
  assert.equal(plain(format.rate(-2)), '\u22122.00 m³/h');
  assert.equal(format.rate(null), '–');
  assert.deepEqual([0.25, 3.876].map((h) => plain(format.hours(h))), ['15 min', '3.88 h']);
  assert.equal(plain(format.length(-0.465)), '\u221246.5 cm');
  assert.equal(plain(format.mass(12345)), '12.3 t');
  assert.equal(plain(format.coordinate(5403639.256)), '5 403 639.26');
  assert.equal(format.volume(null), '–');
  assert.equal(plain(format.time(130.6)), '2:10.6');
  assert.equal(plain(format.time(59.96)), '1:00.0');
});

/** Chooses units for one test. */
function inUnits(t, text, swell = null) {
  t.after(() => {
    units.choose({});
    units.setSwell(null);
  });
  units.setSwell(swell);
  units.choose(units.parsed(text));
}

test('units are those of their definitions, to the last digits and in both directions', (t) => {
  // In whole numbers: 1 ft = 3048 / 10000 m, 1 ftUS = 1200 / 3937 m, 1 yd = 3 ft, 1 short ton = 2000 lb of 45359237 / 10^8 kg.
  const exact = {
    length: {m: [1n, 1n], ft: [3048n, 10000n], us_ft: [1200n, 3937n]}, area: {m: [1n, 1n], ft: [3048n ** 2n, 10000n ** 2n], us_ft: [1200n ** 2n, 3937n ** 2n]},
    volume: {m3: [1n, 1n], yd3: [9144n ** 3n, 10000n ** 3n]}, mass: {t: [1000n, 1n], short_tons: [2000n * 45359237n, 10n ** 8n]},
  };
  const near = (a, b) => Math.abs(a - b) <= 1e-15 * Math.abs(b);   // a few roundings of 2^-53
  for (const [kind, all] of Object.entries(exact)) {
    for (const [word, [num, den]] of Object.entries(all)) {
      inUnits(t, word);
      for (let n = 0; n < 300; ++n) {
        const whole = BigInt(Math.floor((Math.random() - 0.5) * 10 ** (15 * Math.random()))), value = Number(whole);
        const scaled = 10n ** 30n, quotient = Number((whole * den * scaled) / num) / 1e30, product = Number((whole * num * scaled) / den) / 1e30;
        assert.ok(near(units.shown(kind, value), quotient), `${value} in ${word} is ${quotient}, not ${units.shown(kind, value)}`);
        assert.ok(near(units.si(kind, value), product), `${value} ${word} is ${product}, not ${units.si(kind, value)}`);
        assert.ok(near(units.si(kind, units.shown(kind, value)), value));
      }
    }
  }
});

test('what is typed comes back as it was shown, and what was shown is as near as its digits', (t) => {
  for (const word of ['m', 'ft', 'us_ft']) {
    inUnits(t, word);
    for (let n = 0; n < 500; ++n) {
      const metres = (Math.random() - 0.5) * 10 ** (6 * Math.random()), typed = format.toType(metres);
      assert.equal(format.toType(format.typedLength(typed)), typed);
      assert.ok(Math.abs(format.typedLength(typed) - metres) <= 0.5001e-4);
      const read = Number(format.coordinate(metres, 3).replaceAll('\u2009', '').replace('\u2212', '-'));
      assert.ok(Math.abs(units.si('length', read) - metres) <= 0.5001e-3 * units.si('length', 1));
    }
    for (const bad of ['', ' ', 'x', '1 m']) assert.ok(Number.isNaN(format.typedLength(bad)), bad);
    assert.equal(format.typedLength('1,5'), units.si('length', 1.5));
  }
});

test('bank and loose volumes differ by the swell that the engine uses, where it is known', (t) => {
  for (let n = 0; n < 100; ++n) {
    const swell = Math.random(), m3 = 1e4 * Math.random(), ratio = Math.round((1 + swell) * 65536) / 65536;
    inUnits(t, 'loose', swell);
    assert.ok(Math.abs(units.ofSoil(m3, 'bank') - m3 * ratio) < 1e-9 && units.ofSoil(m3, 'loose') === m3);
    inUnits(t, 'bank', swell);
    assert.ok(Math.abs(units.ofSoil(m3, 'loose') - m3 / ratio) < 1e-9 && units.ofSoil(m3, 'bank') === m3);
    assert.deepEqual([units.soilOf('loose'), units.text()], ['bank', 'm,m3,t,bank']);
    inUnits(t, 'bank');
    assert.deepEqual([units.ofSoil(m3, 'loose'), units.soilOf('loose'), units.text()], [m3, '', 'm,m3,t']);
    inUnits(t, '', swell);
    assert.deepEqual([units.ofSoil(m3, 'loose'), units.soilOf('loose'), units.soilOf('bank')], [m3, 'loose', 'bank']);
  }
});

test('a text of units is read again as it was written, and a wrong one is told', (t) => {
  const any = (list) => list[Math.floor(Math.random() * list.length)];
  for (let n = 0; n < 50; ++n) {
    const all = Object.fromEntries(Object.entries(units.kUnits).map(([kind, of]) => [kind, any(Object.keys(of))]));
    inUnits(t, '', 0.2);
    units.choose(all);
    assert.deepEqual(units.parsed(units.text()), all);
  }
  for (const bad of ['feet', 'ft,m', 'ft,,yd3', 'toString']) assert.throws(() => units.parsed(bad), /^Error: units=.*m or ft or us_ft/);
});

test('numbers in feet, cubic yards and pounds have three digits, too', (t) => {
  const plain = (text) => text.replaceAll('\u2009', ' ');
  inUnits(t, 'ft,yd3,short_tons');
  assert.equal(plain(format.length(-0.465)), '\u22121.53 ft');
  assert.equal(plain(format.length(0.005)), '0.016 ft');
  assert.equal(plain(format.height(100, 3)), '328.084 ft');
  assert.equal(plain(format.area(1)), '10.8 ft²');
  assert.equal(plain(format.signedVolume(0.764554857984)), '+1.00 yd³');
  assert.equal(plain(format.mass(1000)), '2200 lb');
  assert.equal(plain(format.mass(12345)), '13.6 short tons');
  for (const empty of [format.length(null), format.volume(undefined), format.mass(null)]) assert.equal(empty, '–');
  for (let about = 0.001; about < 1e4; about *= 1.37) {
    for (const step of [format.stepUp(about), format.stepDown(about)]) assert.match(Number((step / 0.3048).toPrecision(9)).toExponential(), /^[125]e/);
    assert.ok(format.stepUp(about) >= about * (1 - 1e-6) && format.stepDown(about) <= about * (1 + 1e-6));
  }
});

test('times since 1970 are dates, smaller ones are durations', () => {
  const date = (s) => new Date(1000 * s).toLocaleString(undefined, {dateStyle: 'short', timeStyle: 'medium'});
  for (const s of [1.5e8, 0.99e9, 1.7e9]) assert.equal(format.time(s), date(s));
  assert.equal(format.time(0.9e8), '25000:00:00.0');
});

test('an age has one unit, and an estimate its sign and its sigma to the millimetre', (t) => {
  t.after(() => units.choose({}));
  const plain = (text) => text.replace(/\u2009/g, ' ');
  for (const [s, words] of [[-3, '0 s ago'], [0.4, '0 s ago'], [59.4, '59 s ago'], [59.6, '1 min ago'], [3569, '59 min ago'], [3571, '1 h ago'], [84500, '23 h ago'], [86400, '1 d ago'], [864000, '10 d ago']]) {
    assert.equal(plain(format.ago(s)), words);
  }
  for (const [mean, sigma, words] of [[0.0214, 0.0079, '+21 \u00b1 8 mm'], [-0.0214, 0.02, '\u221221 \u00b1 20 mm'], [0, 0.02, '0 \u00b1 20 mm'], [-0.0004, 0.0049, '0 \u00b1 5 mm']]) {
    assert.equal(plain(format.estimate(mean, sigma)), words);
  }
  units.choose({length: 'ft'});
  assert.equal(plain(format.estimate(-0.3048, 0.03048)), '\u22121.000 \u00b1 0.100 ft');
});

test('a force that is a bound has a sign and the reason', () => {
  const plain = (...of) => forceText(...of).replaceAll('\u2009', ' ');
  assert.equal(plain(12345, ''), '12 kN');
  assert.equal(plain(0, ''), '0 kN');
  assert.equal(plain(999, 'heel'), '≈ 1.0 kN');
  assert.equal(plain(123456, 'no failure plane'), '≥ 120 kN');
  assert.equal(plain(5e3, 'steep blade, ground ends ahead'), '≈ 5.0 kN', 'no bound if it is also rough');
  assert.equal(plain(5e3, 'lifts'), '≈ 5.0 kN');
  assert.equal(plain(5e3, 'blade below ground'), '≥ 5.0 kN');
  assert.equal(plain(5e3, 'lifts, blade below ground'), '≈ 5.0 kN', 'too high by one, too low by the other');
  assert.equal(limitText(''), '');
  assert.equal(limitText('rolled over'), 'Too low: rolled over');
  assert.equal(limitText('steep blade, heel, ground ends ahead'), 'Rough estimate: steep blade, heel. Too low: ground ends ahead');
  assert.equal(limitText('lifts, blade below ground'), 'Rough estimate: lifts (too high). Too low: blade below ground');
});

test('the largest force is that of this and the last cycle', () => {
  const largest = new LargestForce(), seen = [];
  assert.equal(largest.value, null);
  for (const [kn, cycle] of [[3, 4], [9, 4], [5, 4], [2, 5], [4, 5], [1, 6], [6, 6], [1, 7], [2, 8], [1, 8]]) {
    largest.add(1000 * kn, '', cycle);
    seen.push(largest.value.size_n / 1000);
  }
  assert.deepEqual(seen, [3, 9, 9, 9, 9, 4, 6, 6, 2, 2]);
});

test('arrows of a usual force are as long as a bucket, whatever its size', () => {
  for (const [width_m, height_m] of [[0.3, 0.3], [0.8, 0.6], [1.2, 1.15], [4, 3]]) {
    const {n_per_m, most_m} = arrowScale([{width_m, height_m}, {width_m: 0.1, height_m: 0.1}]);
    const full_n = 0.6 * width_m * height_m ** 2 * 1600 * 9.81;   // weight of a load
    assert.ok(full_n / n_per_m > 0.2 * height_m && full_n / n_per_m < 2 * height_m && most_m >= 2 * height_m, `${width_m} m: ${full_n / n_per_m} m`);
    assert.match(String(n_per_m), /^[125]0*$/);
  }
});

test('the slider begins after a gap from a clock at 0 to one that counts from 1970', () => {
  const begins = 1.7e9, day_s = 86400;
  assert.equal(sliderStart({from: 0, to: 5000, snapshots: [100, 4000]}), 0);
  assert.equal(sliderStart({from: begins, to: begins + 5000, snapshots: [begins + 100]}), begins);
  assert.equal(sliderStart({from: 0, to: begins + 5000, snapshots: [3, begins, begins + 2000]}), begins);
  assert.equal(sliderStart({from: 0, to: begins + 5000, snapshots: []}), begins + 5000 - day_s, 'no time after the gap is known');
  assert.equal(sliderStart({from: 7, to: 7, snapshots: []}), 7);
});

test('a tag is in the picture, beside what lies over it, and no farther from its machine than that takes', () => {
  const picture = {width: 360, height: 400}, size = {width: 120, height: 24};
  const over = [{left: 10, top: 10, right: 74, bottom: 260}, {left: 300, top: 10, right: 350, bottom: 200}, {left: 10, top: 330, right: 272, bottom: 390}];
  const fits = (x, y) => x >= 60 && x <= 300 && y >= 24 && y <= 400 &&
    over.every((box) => x + 60 <= box.left || x - 60 >= box.right || y <= box.top || y - 24 >= box.bottom);
  let moved = 0;
  for (let x = -40; x <= 400; x += 23) {
    for (let y = -20; y <= 420; y += 19) {
      const [u, v] = placeTag([x, y], size, picture, over);
      assert.ok(fits(u, v), `${x}, ${y} is put at ${u}, ${v}`);
      if (fits(x, y)) assert.deepEqual([u, v], [x, y]);
      else ++moved;
      let least = Infinity;   // of places a pixel apart; the tag keeps 4 pixels away from what is over the picture
      for (let i = 60; i <= 300; ++i) for (let j = 24; j <= 400; ++j) if (fits(i, j)) least = Math.min(least, Math.hypot(i - x, j - y));
      assert.ok(Math.hypot(u - x, v - y) <= least + 6, `${x}, ${y} is put at ${u}, ${v}, ${least} would do`);
    }
  }
  assert.ok(moved > 150);
  const beside = (x, y, left, top, right, bottom) => placeTag([x, y], size, picture, [{left, top, right, bottom}]);
  assert.deepEqual(beside(180, 60, 0, 0, 360, 100), [180, 128], 'below');
  assert.deepEqual(beside(180, 350, 0, 300, 360, 400), [180, 296], 'above');
  assert.deepEqual(beside(80, 200, 0, 0, 100, 400), [164, 200], 'right of');
  assert.deepEqual(beside(280, 200, 260, 0, 360, 400), [196, 200], 'left of');
  assert.deepEqual(beside(180, 300, 0, 300, 360, 400), [180, 300], 'it may touch what is below it');
  assert.equal(placeTag([500, 500], size, picture, [{left: 0, top: 0, right: 360, bottom: 400}]), null, 'no room beside it');
});

test('tags of many machines at one place lie beside each other, and are soon placed', () => {
  const picture = {width: 1400, height: 800}, size = {width: 120, height: 24}, boxes = [], begin = process.cpuUsage();
  for (let n = 0; n < 150; ++n) {
    const place = placeTag([700, 400], size, picture, boxes);
    assert.ok(place);
    boxes.push(boxOf(place, size));
  }
  assert.ok(process.cpuUsage(begin).user < 2e6, 'two seconds of CPU time');
  for (const [i, a] of boxes.entries()) {
    assert.ok(a.left >= 0 && a.top >= 0 && a.right <= 1400 && a.bottom <= 800);
    for (const b of boxes.slice(i + 1)) assert.ok(a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top);
  }
});

/** The link with a socket and a clock of the test; `answering` is the server's HTTP. */
async function linked(t, answering) {
  const said = [], sockets = [], timers = [];
  let now = 0;
  const every = (repeat) => (call, ms) => timers.push({call, at: now + ms, ms: repeat ? ms : Infinity});
  class Socket {
    static OPEN = 1;
    constructor() { sockets.push(this); }
    readyState = 0;
    closed = false;
    open() {
      this.readyState = 1;
      this.onopen();
    }
    close() { this.closed = true; }   // the peer never answers it
  }
  const asked = [];
  const document = {hidden: false, addEventListener: (_, call) => { document.changed = call; }};
  const show = (visible) => {
    document.hidden = !visible;
    document.changed();
  };
  const globals = {
    document,
    setInterval: every(true), setTimeout: every(false), clearTimeout: (n) => { if (n) timers[n - 1].at = Infinity; },
    WebSocket: Socket, location: new URL('http://site/'), addEventListener: () => {},
    fetch: async (url) => {
      asked.push(url.pathname);
      if (!answering()) throw new Error('silence');
      return {ok: true};
    },
  };
  const saved = Object.fromEntries(Object.keys(globals).map((name) => [name, globalThis[name]]));
  Object.assign(globalThis, globals);
  t.after(() => Object.assign(globalThis, saved));
  const {Link} = await import('../../tools/view/src/link.js');
  const link = new Link({text: () => said.push('text'), binary: () => said.push('binary'), opened: () => said.push('opened'), lost: () => said.push('lost')});
  const pass = async (seconds, each = () => {}) => {
    for (let i = 0; i < 2 * seconds; ++i) {
      each(i / 2);
      now += 500;
      for (const timer of timers) {
        if (timer.at > now) continue;
        timer.at += timer.ms;
        timer.call();
      }
      await new Promise((done) => setImmediate(done));
    }
  };
  return {link, said, sockets, asked, pass, show};
}

test('a silent server is lost within 5 s, whatever becomes of its socket', async (t) => {
  const {said, sockets, pass} = await linked(t, () => false);
  sockets[0].open();
  await pass(3, () => sockets[0].onmessage({data: '{}'}));
  assert.ok(!said.includes('lost'));
  await pass(4.5);
  assert.deepEqual(said.slice(-1), ['lost']);
  assert.ok(sockets[0].closed && sockets[0].onmessage === null);
  await pass(1);
  assert.equal(sockets.length, 2, 'it tries again');
  sockets[1].open();
  assert.deepEqual(said.slice(-1), ['opened']);
});

test('a connection that carries a long message is not lost, and one that never brings it is', async (t) => {
  const {said, sockets, asked, pass} = await linked(t, () => true);
  sockets[0].open();
  await pass(10, (at) => { if (at % 1 === 0) sockets[0].onmessage({data: '{}'}); });
  assert.deepEqual(asked, [], 'nothing is asked while messages come');
  await pass(25);
  assert.ok(!said.includes('lost') && asked.length > 5);
  sockets[0].onmessage({data: new ArrayBuffer(0)});
  await pass(25);
  assert.ok(!said.includes('lost'));
  await pass(6);
  assert.deepEqual(said.slice(-1), ['lost']);
});

test('an attempt that hangs is given up, or replaced on request', async (t) => {
  const {link, said, sockets, pass} = await linked(t, () => false);
  await pass(29);
  assert.deepEqual(said, []);
  link.retry();
  assert.ok(sockets[0].closed);
  assert.equal(sockets.length, 2);
  await pass(31);
  assert.deepEqual(said, ['lost']);
});

test('a page that nobody sees disconnects after a while, and is back at once when it is seen', async (t) => {
  const {said, sockets, pass, show} = await linked(t, () => true);
  const hear = () => sockets.at(-1).onmessage({data: '{}'});
  sockets[0].open();
  show(false);
  await pass(8, hear);
  show(true);   // it was away for a moment only
  await pass(20, hear);
  assert.equal(sockets.length, 1);
  show(false);
  await pass(9, hear);
  assert.ok(!sockets[0].closed);
  await pass(120);
  assert.ok(sockets[0].closed && sockets.length === 1, 'it stays disconnected');
  assert.ok(!said.includes('lost'));
  show(true);
  assert.equal(sockets.length, 2);
  sockets[1].open();
  assert.deepEqual(said.slice(-1), ['opened']);
});

test('a hidden page that had lost its server does not look for it', async (t) => {
  const {sockets, pass, show} = await linked(t, () => false);
  sockets[0].open();
  show(false);
  await pass(5);   // lost
  await pass(10);
  const tries = sockets.length;
  await pass(60);
  assert.equal(sockets.length, tries);
  show(true);
  assert.equal(sockets.length, tries + 1);
});

test('a time of the same day is told by its clock beside another', () => {
  const noon = Date.UTC(2023, 10, 14, 12) / 1000, clock = (s) => new Date(1000 * s).toLocaleTimeString(undefined, {timeStyle: 'medium'});
  assert.equal(format.timeBeside(noon, noon + 60), clock(noon));
  assert.equal(format.timeBeside(noon, noon + 2 * 86400), format.time(noon));
  assert.equal(format.timeBeside(noon, 20), format.time(noon));
  assert.equal(format.timeBeside(20, 30), format.time(20));
  assert.ok(format.time(noon).endsWith(format.clock(noon)) && format.clock(noon) === clock(noon));
  assert.equal(format.clock(20), '');
});

test('many alarms are few lines, lost links first, and none is left out of the count', () => {
  const lost = (machine) => ({kind: 'feed_lost', machine, text: 'nothing is heard of it for 6 s'});
  const deep = {kind: 'below_design', machine: 'a', text: 'its lip is 0.12 m below the design', by_m: 0.12}, disk = {kind: 'disk', machine: null, text: 'the disk is full'};
  const few = alarmLines([deep, lost('b'), disk], false);
  assert.deepEqual([few.lines.map(({machine}) => machine), few.more], [['b', 'a', null], 0]);
  const all = [deep, lost('b'), disk, lost('c')], many = alarmLines(all, false);
  assert.deepEqual(many, {lines: [{machine: null, text: '2 machines are silent'}, {machine: 'a', text: deep.text}], more: 3});
  assert.deepEqual(alarmLines([...all.slice(0, 3), deep], false).lines, [{machine: 'b', text: lost('b').text}, {machine: null, text: '2 machines are below the design'}]);
  assert.deepEqual(alarmLines(all, true), {lines: [lost('b'), lost('c'), deep, disk].map(({machine, text}) => ({machine, text})), more: 0});
  assert.deepEqual(alarmLines([disk, disk, disk, disk], false).lines, [{machine: null, text: disk.text}], 'those without words for several are told one by one');
  units.choose(units.parsed('ft'));
  assert.match(alarmLines([deep], false).lines[0].text, /its lip is 0\.394\u2009ft below/);
  units.choose(units.parsed(''));
});

test('the free box of a picture is the largest that touches nothing', () => {
  const random = (n) => Math.floor(n * Math.random()), picture = {width: 24, height: 16};
  for (let n = 0; n < 60; ++n) {
    const over = Array.from({length: random(4)}, () => {
      const [left, top] = [random(28) - 4, random(20) - 4];
      return {left, top, right: left + 1 + random(9), bottom: top + 1 + random(9)};
    });
    const free = (x, y) => !over.some((b) => x >= b.left && x < b.right && y >= b.top && y < b.bottom);
    let most = 0;   // by counting cells
    for (let top = 0; top < 16; ++top) {
      const open = Array(24).fill(true);
      for (let bottom = top; bottom < 16; ++bottom) {
        let run = 0;
        for (let x = 0; x < 24; ++x) {
          open[x] &&= free(x, bottom);
          run = open[x] ? run + 1 : 0;
          most = Math.max(most, run * (bottom - top + 1));
        }
      }
    }
    const box = freeBox(picture, over);
    assert.equal(box ? (box.right - box.left) * (box.bottom - box.top) : 0, most, JSON.stringify(over));
    if (box) for (let x = box.left; x < box.right; ++x) for (let y = box.top; y < box.bottom; ++y) assert.ok(free(x, y));
  }
});

test('a report has the colours of machines that the page has', () => {
  const colours = (file, name) => {
    const source = fs.readFileSync(new URL(`../../tools/${file}`, import.meta.url), 'utf8');
    return source.slice(source.indexOf(name)).match(/^[^;]*/)[0].match(/#[0-9a-f]{6}/g);
  };
  assert.deepEqual(colours('serve/report_page.cc', 'kMachineColours[]'), colours('view/src/machines.js', 'kMachineColors ='));
});
