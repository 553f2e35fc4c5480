// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the page of a live site costs who looks at it without a graphics card, and what one request costs
// others: a site of a square kilometre with a post each metre, in a headless browser of 1440 x 900.
// node bench/live_page.mjs --out FOLDER [--quick]
import fs from 'node:fs';
import net from 'node:net';
import path from 'node:path';
import * as site from '../tests/view/site.mjs';

const quick = process.argv.includes('--quick'), out = process.argv[process.argv.indexOf('--out') + 1];
const kPosts = quick ? 200 : 1000;   // a metre apart
const kVisits = quick ? 1 : 5, kTurned_ms = quick ? 500 : 5000;
const kSections = 32, kSectionPoints = 5000, kHeights = quick ? 5 : 50, kHalfOpen = quick ? 20 : 600;

const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];
const seconds = (from) => (performance.now() - from) / 1000;

async function visit(browser, url) {
  const context = await browser.newContext({viewport: {width: 1440, height: 900}, deviceScaleFactor: 1});
  const page = await context.newPage();
  const from = performance.now();
  await page.goto(url, {waitUntil: 'commit'});
  await page.waitForFunction(() => window.soilvdb?.terrain().tiles > 0 && window.soilvdb.frames() > 0);
  const first = seconds(from);
  await site.settled(page);
  return {page, first, all: seconds(from), close: () => context.close()};
}

/** Frames that are drawn in a second while a finger turns the picture. */
async function turning(page) {
  const frames = () => page.evaluate(() => window.soilvdb.frames());
  await page.mouse.move(700, 450);
  await page.mouse.down();
  const begin = await frames(), from = performance.now();
  for (let n = 0; performance.now() - from < kTurned_ms; ++n) await page.mouse.move(700 + 200 * Math.sin(n / 20), 450 + 20 * Math.cos(n / 20));
  const rate = (await frames() - begin) / seconds(from);
  await page.mouse.up();
  return rate;
}

/** Slowest of many heights, one after another, ms. */
async function slowest(url) {
  let most = 0;
  for (let n = -1; n < kHeights; ++n) {   // the first opens connections
    const from = performance.now();
    await (await fetch(`${url}height?x=${500000 + n}&y=5400010`)).json();
    if (n >= 0) most = Math.max(most, performance.now() - from);
  }
  return most;
}

async function besideSections(url) {
  let going = true;
  const far = kPosts - 1;
  const sections = Array.from({length: kSections}, async (_, n) => {
    while (going) await (await fetch(`${url}section?from=500001,${5400001 + n}&to=${500000 + far},${5400000 + far}&points=${kSectionPoints}`)).text();
  });
  await new Promise((done) => setTimeout(done, 200));
  const most = await slowest(url);
  going = false;
  await Promise.all(sections);
  return most;
}

async function besideHalfOpen(url) {
  const {hostname, port} = new URL(url);
  const sockets = Array.from({length: kHalfOpen}, () => net.connect({host: hostname, port}).on('error', () => {}));
  await new Promise((done) => setTimeout(done, 500));
  const most = await slowest(url);
  sockets.forEach((socket) => socket.destroy());
  return most;
}

/** A photo of all the site, as coarse as browsers get it, placed by its world file. */
function photo(file) {
  const n = quick ? 256 : 2048, head = Buffer.alloc(54), pixels = Buffer.alloc(3 * n * n);
  head.write('BM');
  [[2, 54 + pixels.length], [10, 54], [14, 40], [18, n], [22, n], [34, pixels.length]].forEach(([at, v]) => head.writeUInt32LE(v, at));
  head.writeUInt16LE(1, 26);
  head.writeUInt16LE(24, 28);
  for (let k = 0; k < pixels.length; ++k) pixels[k] = 128 + 60 * Math.sin(k / 97) + 50 * Math.sin(12.9898 * k);
  fs.writeFileSync(file, Buffer.concat([head, pixels]));
  const cell_m = kPosts / n;
  fs.writeFileSync(file.replace(/bmp$/, 'bpw'), [cell_m, 0, 0, -cell_m, 500000 + cell_m / 2, 5400000 + kPosts - cell_m / 2].join('\n'));
}

if (site.missing) {
  console.log(`without the page's figures: ${site.missing}`);
  process.exit();
}
const folder = site.folder();
const rows = Array.from({length: kPosts}, (_, j) => Array.from({length: kPosts}, (_, i) => (400 + 9 * Math.sin(i / 90) + 7 * Math.cos(j / 70)).toFixed(2)).join(' '));
fs.writeFileSync(path.join(folder, 'wide.asc'), `ncols ${kPosts}\nnrows ${kPosts}\nxllcorner 500000\nyllcorner 5400000\ncellsize 1\n${rows.join('\n')}\n`);
fs.writeFileSync(path.join(folder, 'wide.yaml'), 'soilvdb: 1\nvoxel_size: 0.05\nterrain: {raster: wide.asc}\nmachines:\n  - {name: digger, bucket: {width: 0.8, height: 0.6}}\n');
const server = await site.serve(path.join(folder, 'wide.yaml'), '--out', path.join(folder, 'wide'), '--port', '0');
const browser = await site.browser();
try {
  const visits = [];
  let rate = 0;
  for (let n = 0; n < kVisits; ++n) {
    const {page, first, all, close} = await visit(browser, server.url);
    visits.push({first, all});
    if (n + 1 === kVisits) rate = await turning(page);
    await close();
  }
  const figures = [
    ['first picture of 1 km2, software renderer', median(visits.map((v) => v.first)), 's', '<= 2'],
    ['all of it', median(visits.map((v) => v.all)), 's', '<= 5'],
    ['frames while it is turned', rate, '1/s', '>= 10'],
    ['a height, slowest, with nothing beside', await slowest(server.url), 'ms', ''],
    [`the same beside ${kSections} sections of ${kSectionPoints} points`, await besideSections(server.url), 'ms', '<= 50'],
    [`the same beside ${kHalfOpen} connections that say nothing`, await besideHalfOpen(server.url), 'ms', '<= 50'],
  ];
  photo(path.join(folder, 'photo.bmp'));
  const draped = await site.serve(path.join(folder, 'wide.yaml'), '--out', path.join(folder, 'draped'), '--drape', path.join(folder, 'photo.bmp'), '--port', '0');
  const {page, close} = await visit(browser, draped.url);
  await page.waitForFunction(() => window.soilvdb.draped());
  figures.splice(3, 0, ['the same under an orthophoto', await turning(page), '1/s', '>= 10']);
  await close();
  await draped.stop();
  fs.writeFileSync(path.join(out, 'page.csv'), ['figure,measured,unit,goal', ...figures.map(([name, value, unit, goal]) => `"${name}",${value.toPrecision(4)},${unit},${goal}`), ''].join('\n'));
  for (const [name, value, unit, goal] of figures) {
    const [sign, limit] = goal.split(' ');
    const verdict = goal === '' ? '' : (sign === '<=' ? value <= Number(limit) : value >= Number(limit)) ? 'PASS' : 'miss';
    console.log(`${name.padEnd(52)} ${value.toPrecision(4).padStart(10)} ${unit.padEnd(4)} ${goal.padEnd(6)} ${verdict}`);
  }
} finally {
  await browser.close();
  await server.stop();
  fs.rmSync(folder, {recursive: true});
}
