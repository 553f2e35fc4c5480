// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The page in a browser, looking at a finished run and at a live site.
import assert from 'node:assert/strict';
import {once} from 'node:events';
import fs from 'node:fs';
import http from 'node:http';
import path from 'node:path';
import test, {after, before} from 'node:test';
import {along} from '../../tools/view/src/ramps.js';
import * as pictures from './pictures.mjs';
import * as site from './site.mjs';

if (site.missing) console.log(`view_browser skipped: ${site.missing}`);
const options = {skip: site.missing ?? false, timeout: 240000};
const kHalfVoxel_m = 0.025;   // what is drawn is a mesh of 5 cm voxels
const kCorners = [[512341, 5403633], [512351, 5403633], [512351, 5403643], [512341, 5403643]];   // around all that is dug

let browser, work, done;
before(async () => {
  if (site.missing) return;
  work = site.folder();
  done = path.join(work, 'done');
  site.run('run', path.join(site.root, 'data/excavator.yaml'), '--out', done, '--no-mesh');
  browser = await site.browser();
});
after(async () => {
  await browser?.close();
  if (work) fs.rmSync(work, {recursive: true});
});

/** Tests with a server and a page of it; nothing may be written to the console. */
function looking(name, args, body, view = {}) {
  test(name, options, async () => {
    const server = await site.serve(...args(), '--port', '0');
    try {
      const {page, said, close} = await site.open(browser, server.url, view);
      await body(page, server);
      assert.deepEqual(said, []);
      await close();
    } finally {
      await server.stop();
    }
  });
}
const recorded = () => [done];

looking('a boundary drawn around a dig has the volumes of soilvdb diff, before digging and since another time', recorded, async (page) => {
  await page.click('#work');
  await page.waitForTimeout(300);
  await page.keyboard.press('n');
  await page.keyboard.press('t');
  await page.mouse.move(450, 450);
  await page.mouse.wheel(0, 400);   // all corners are in the picture, and none below a button
  await page.keyboard.press('b');
  for (const corner of kCorners) await site.clickAt(page, corner);
  const all = await site.answerTo(page, '/volume', () => site.clickAt(page, kCorners[0]));
  const drawn = all.query.get('boundary').split(',').map(Number);
  assert.equal(drawn.length, 8);
  kCorners.flat().forEach((v, i) => assert.ok(Math.abs(v - drawn[i]) < 0.05, `${drawn[i]} was clicked at ${v}`));
  const summary = JSON.parse(fs.readFileSync(path.join(done, 'summary.json'), 'utf8'));
  assert.ok(Math.abs(all.json.net_m3 - (all.json.fill_m3 - all.json.cut_m3)) < 1e-9);
  assert.ok(Math.abs(all.json.net_m3 - summary.volume_m3.ground_change) < 1e-9, 'the ledger says as much');
  await page.waitForSelector('.card[data-kind=boundary] .cut dd');
  const shown = await page.locator('.card[data-kind=boundary] .cut dd').textContent();
  assert.equal(Number(shown.split('\u2009')[0]), Number(all.json.cut_m3.toPrecision(3)));

  await page.click('#canvas', {position: {x: 400, y: 300}});
  for (let n = 0; n < 2; ++n) await step(page, '[');
  const answers = [];
  page.on('response', (r) => { if (new URL(r.url()).pathname === '/volume') answers.push(r); });
  await page.keyboard.press('a');
  await page.keyboard.press('l');
  const since = () => answers.findLast((r) => !new URL(r.url()).searchParams.has('time') && new URL(r.url()).searchParams.has('against'));
  while (!since()) await page.waitForTimeout(50);
  const later = await since().json(), from = new URL(since().url()).searchParams.get('against');
  const truth = JSON.parse(site.run('diff', path.join(done, `soil_${from}.vdb`), path.join(done, 'soil_final.vdb'), '--json'));
  for (const key of ['cut_m3', 'fill_m3', 'net_m3']) {
    assert.ok(Math.abs(later[key] - truth[key]) < 1e-9, `since ${from} s ${JSON.stringify(later)} is not ${JSON.stringify(truth)}`);
  }
}, {viewport: {width: 1300, height: 900}});

/** Presses a key that shows another time, and waits until it is there. */
async function step(page, key) {
  const id = await page.evaluate(() => window.soilvdb.view().id);
  await page.keyboard.press(key);
  await page.waitForFunction((before) => window.soilvdb.view().id !== before && window.soilvdb.view().settled, id);
}

looking('a section is the heights along it, as the server and as Python have them', recorded, async (page, server) => {
  await page.click('#work');
  await page.waitForTimeout(300);
  await page.keyboard.press('s');
  await site.clickAt(page, [512346, 5403634]);
  const {query, json} = await site.answerTo(page, '/section', () => site.clickAt(page, [512347, 5403642]));
  const [from, to] = ['from', 'to'].map((k) => query.get(k).split(',').map(Number));
  const n = json.distance_m.length, at = (i) => [0, 1].map((axis) => from[axis] + ((to[axis] - from[axis]) * i) / (n - 1));
  assert.ok(Math.abs(json.distance_m[n - 1] - Math.hypot(to[0] - from[0], to[1] - from[1])) < 1e-9);
  const heights = site.python(`import json, soilvdb
site = soilvdb.Site(0.05, soilvdb.snapshot(${JSON.stringify(path.join(done, 'soil_final.vdb'))}), [])
print(json.dumps(list(site.mesh_heights(${JSON.stringify(Array.from({length: n}, (_, i) => at(i)))}))))`);
  for (let i = 0; i < n; i += 50) {
    const [x, y] = at(i), one = await (await fetch(`${server.url}height?x=${x}&y=${y}`)).json();
    assert.ok(Math.abs(one.height_m - json.now_m[i]) < 1e-6);
    assert.ok(Math.abs(one.before_m - json.before_m[i]) < 1e-6);
  }
  if (heights) heights.forEach((z, i) => assert.ok(Math.abs(z - json.now_m[i]) < 1e-6, `${z} is not ${json.now_m[i]} at ${at(i)}`));
  assert.ok(json.now_m.some((z, i) => z < json.before_m[i] - 0.3), 'it goes through the trench');
  await page.waitForSelector('.card[data-kind=section] svg.chart');
});

looking('the slider shows what a snapshot holds', recorded, async (page, server) => {
  const places = [];
  for (let x = 512343.013; x <= 512350; x += 0.7) for (let y = 5403635.017; y <= 5403641; y += 0.55) places.push([x, y]);
  const seen = new Set();
  for (let n = 0; n < 3; ++n) {
    await step(page, '[');
    const text = await page.locator('#time-now').textContent();
    const time = text.includes(':') ? 60 * Number(text.split(':')[0]) + Number(text.split(':')[1]) : Number(text.split('\u2009')[0]);
    assert.ok(fs.existsSync(path.join(done, `soil_${time}.vdb`)), `${text} is a snapshot's`);
    seen.add(time);
    const drawn = await page.evaluate((all) => all.map(([x, y]) => window.soilvdb.height(x, y)), places);
    let near = 0, steep = 0;
    for (const [i, [x, y]] of places.entries()) {
      const at = async (u, v) => (await (await fetch(`${server.url}height?x=${u}&y=${v}&time=${time}`)).json()).height_m;
      const z = await at(x, y);
      if (Math.abs(drawn[i] - z) < kHalfVoxel_m) ++near;
      else if (Math.abs((await at(x + 0.05, y)) - z) + Math.abs((await at(x, y + 0.05)) - z) +
               Math.abs((await at(x - 0.05, y)) - z) + Math.abs((await at(x, y - 0.05)) - z) > kHalfVoxel_m) ++steep;
      else assert.fail(`at ${x}, ${y}, ${time} s the ground is drawn at ${drawn[i]}, and is at ${z}`);
    }
    assert.ok(near > 0.9 * places.length && steep < 0.1 * places.length, `${near} of ${places.length} agree`);
  }
  assert.equal(seen.size, 3);
});

looking('machines, loads and totals are those of the time shown', recorded, async (page, server) => {
  const row = () => page.locator('#machine-table tbody tr').textContent();
  const end = await row(), all = JSON.parse(fs.readFileSync(path.join(done, 'summary.json'), 'utf8'));
  assert.ok(end.includes(`${all.volume_m3.cut.toPrecision(3)}\u2009m³`), `${end} is after all was cut`);
  assert.doesNotMatch(end, /not seen/);
  const putDown = Number((await page.locator('#totals').textContent()).match(/Put down[^0-9]*([0-9.]+)/)[1]);
  assert.equal(putDown, Number(all.volume_m3.spilled.toPrecision(3)), 'as in the report');
  assert.notEqual(putDown, Number(all.volume_m3.fill.toPrecision(3)));
  const lip = (await page.evaluate(() => window.soilvdb.machines()))[0].position;
  for (let n = 0; n < 3; ++n) await step(page, '[');
  const time = Number((await page.evaluate(() => window.soilvdb.time())));
  const csv = (await (await fetch(`${server.url}machines.csv?time=${time}`)).text()).split('\n')[1].split(',');
  const [there] = await page.evaluate(() => window.soilvdb.machines());
  csv.slice(2, 5).forEach((v, i) => assert.ok(Math.abs(there.position[i] - Number(v)) < 1e-6, `${there.position} is not ${csv}`));
  assert.notDeepEqual(there.position, lip);
  assert.ok(Number(csv[7]) < all.volume_m3.cut - 1);
  assert.ok((await row()).includes(`${Number(Number(csv[7]).toPrecision(3)).toFixed(Number(csv[7]) < 10 ? 2 : 1)}\u2009m³`), `${await row()} has ${csv[7]}`);
  await page.keyboard.press('l');
  await page.waitForFunction((text) => document.querySelector('#machine-table tbody tr').textContent === text, end);
});

looking('what remains to a design has colours also where nothing was dug', () => {
  fs.writeFileSync(path.join(work, 'plan.asc'), `ncols 12\nnrows 12\nxllcorner 512335\nyllcorner 5403630\ncellsize 2\n${`${'430 '.repeat(12)}\n`.repeat(12)}`);
  return [done, '--design', path.join(work, 'plan.asc')];
}, async (page) => {
  await page.click('#whole');
  await page.selectOption('[aria-label="Colour by"]', 'design');
  await site.settled(page);
  await page.waitForFunction(() => window.soilvdb.terrain().fromDesign_m > 0);
  // Where nobody has dug, inside and outside of the design: stripes and colours, and grey.
  const [inside, outside] = [[512337, 5403650], [512333, 5403628]];
  const saturation = async (x, y) => {
    const [r, g, b] = await site.colorAt(page, [x, y]);
    return (Math.max(r, g, b) - Math.min(r, g, b)) / Math.max(r, g, b);
  };
  assert.ok(await saturation(...inside) > 0.3);
  assert.ok(await saturation(...outside) < 0.25);
});

looking('lines of a design are drawn over the ground, on it where they have no heights', () => {
  const line = (...at) => ({type: 'Feature', properties: {}, geometry: {type: 'LineString', coordinates: at}});
  fs.writeFileSync(path.join(work, 'lines.geojson'), JSON.stringify({
    type: 'FeatureCollection', crs: {type: 'name', properties: {name: 'urn:ogc:def:crs:EPSG::32632'}},
    features: [line([512337, 5403630], [512337, 5403650]), line([512353, 5403630, 440], [512353, 5403650, 440])],
  }));
  return [done, '--lines', path.join(work, 'lines.geojson')];
}, async (page) => {
  await page.waitForFunction(() => window.soilvdb.lines() === 41);   // 20 m at 0.5 m, and one by its heights
  await page.click('#whole');
  await site.settled(page);
  await site.drawn(page);
  const pink = async ([px, py]) => {
    const pixels = await site.pixelsIn(page, {x: px - 4, y: py - 4, width: 9, height: 9});
    return pixels.some(([r, g, b]) => r > g + 60 && b > g + 40);
  };
  const at = (place) => page.evaluate((p) => window.soilvdb.project([p[0], p[1], p[2] ?? window.soilvdb.height(p[0], p[1])]), place);
  assert.ok(await pink(await at([512337, 5403632.3])));
  assert.ok(await pink(await at([512353, 5403648.3, 440])));
  assert.ok(!await pink(await at([512353, 5403648.3])));
  assert.ok(!await pink(await at([512345, 5403632])));
});

looking('on a phone nothing is wider than the screen or under what is over the picture, and all panels can be opened', recorded, async (page) => {
  const fits = async () => assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= 360 && document.body.scrollWidth <= 360));
  await fits();
  const clear = async () => {   // a machine's label is to be read wherever the machine is
    const boxes = await Promise.all(['.tag', '#tools', '#camera', '#legend'].map((q) => page.locator(q).first().boundingBox()));
    const [tag, ...over] = boxes;
    for (const box of over) {
      assert.ok(tag.x >= box.x + box.width || tag.x + tag.width <= box.x || tag.y >= box.y + box.height || tag.y + tag.height <= box.y,
        `${JSON.stringify(tag)} lies under ${JSON.stringify(box)}`);
    }
    assert.ok(tag.x >= 0 && tag.x + tag.width <= 360, `${JSON.stringify(tag)} is out of the picture`);
  };
  await clear();
  for (let n = 0; n < 12; ++n) {   // the machine goes over the picture, below all that is there
    await page.focus('#canvas');
    await page.keyboard.press(n < 6 ? 'ArrowRight' : 'ArrowUp', {delay: 60});
    await page.waitForTimeout(50);
    if (await page.locator('.tag:not(.away)').count() > 0) await clear();
  }
  for (const panel of ['machines', 'measures']) {
    await page.tap(`[data-tab=${panel}]`);
    assert.ok(await page.locator(`#${panel}`).isVisible());
    await fits();
  }
  await page.tap('#downloads summary');
  await page.locator('#download-list a').nth(4).waitFor();
  const list = await page.locator('#download-list').boundingBox();
  assert.ok(list.x >= 0 && list.x + list.width <= 360);
}, {viewport: {width: 360, height: 640}, hasTouch: true});

looking('all figures are in the units that the viewer chose, which the address passes on and the browser keeps', recorded, async (page, server) => {
  await page.click('#work');
  await site.settled(page);
  await page.keyboard.press('h');
  await site.answerTo(page, '/height', () => site.clickAt(page, [512346, 5403638]));
  await page.keyboard.press('s');
  await site.clickAt(page, [512346, 5403634]);
  await site.answerTo(page, '/section', () => site.clickAt(page, [512347, 5403642]));
  await page.waitForSelector('.card svg.chart');
  await page.selectOption('[aria-label="Colour by"]', 'height');
  const words = () => page.evaluate(() => ['totals', 'machine-table', 'measure-list', 'legend', 'scale-text', 'tags', 'help-body'].map((id) => document.getElementById(id).textContent).join(' | '));
  const metric = /[0-9]\u2009(m|cm|mm|km|m²|m³|kg|t)(?![a-z²³])/;
  const before = await words(), dug = async () => (await page.locator('#totals').textContent()).match(/Dug[^0-9]*([0-9.]+)/)[1];
  assert.match(before, metric);
  const m3 = Number(await dug());
  await page.click('#units summary');
  for (const [name, word] of [['Lengths', 'ft'], ['Volumes', 'yd3'], ['Masses', 'short_tons']]) await page.selectOption(`#unit-list [aria-label=${name}]`, word);
  await page.keyboard.press('Escape');
  await site.drawn(page);
  assert.doesNotMatch(await words(), metric);
  assert.ok(Math.abs(Number(await dug()) - m3 / 0.9144 ** 3) <= 0.0051 * m3, `${await dug()} yd³ are ${m3} m³`);
  assert.match(page.url(), /#units=ft,yd3,short_tons/);
  await page.click('#downloads summary');
  const report = await page.locator('#download-list a[href*="report"]').getAttribute('href');
  assert.match(await (await fetch(report)).text(), /yd³ bank/);
  const other = await site.open(browser, page.url());
  await other.page.waitForFunction(() => /yd³/.test(document.getElementById('totals').textContent));
  await other.page.goto('about:blank');
  await other.page.goto(server.url);   // an address is not kept
  await site.settled(other.page);
  assert.match(await other.page.locator('#totals').textContent(), /m³/);
  await other.close();
  await page.goto('about:blank');
  await page.goto(server.url);
  await site.settled(page);
  await page.waitForFunction(() => /yd³/.test(document.getElementById('totals').textContent));
  await page.goto(`${server.url}#units=m3`);
  await page.waitForFunction(() => !/yd³/.test(document.getElementById('totals').textContent));
  await page.goto(`${server.url}#units=feet`);
  await page.waitForFunction(() => /units=feet: at most one each/.test(document.getElementById('hint-text').textContent));
});

looking('everything can be reached and used by keys', recorded, async (page) => {
  const reached = new Set();
  for (let n = 0; n < 60; ++n) {
    await page.keyboard.press('Tab');
    reached.add(await page.evaluate(() => document.activeElement.id || document.activeElement.getAttribute('aria-label') ||
      document.activeElement.dataset.tool || document.activeElement.className));
    const seen = await page.evaluate(() => document.activeElement === document.body ||
      getComputedStyle(document.activeElement).outlineStyle !== 'none');
    assert.ok(seen, 'what has the focus shows it');
  }
  for (const what of ['canvas', 'look', 'boundary', 'section', 'height', 'distance', 'north', 'above', 'whole', 'work', 'Colour by', 'Time shown',
                      'Previous snapshot', 'Downloads', 'Units', 'theme', 'help-open', 'machine']) {
    assert.ok([...reached].some((r) => r === what || (what === 'theme' && /colours$/.test(r)) || r.startsWith(what)), `${what} of ${[...reached]}`);
  }
  await page.click('#work');
  await page.focus('#canvas');
  await page.keyboard.press('h');
  const {json} = await site.answerTo(page, '/height', () => page.keyboard.press('Space'));
  assert.ok(json.height_m > 400);
  await page.keyboard.press('?');
  assert.ok(await page.locator('dialog#help').isVisible());
  await page.keyboard.press('Escape');
  assert.ok(!(await page.locator('dialog#help').isVisible()));
});

const live = () => {
  fs.writeFileSync(path.join(work, 'pit.yaml'), `soilvdb: 1
name: pit
voxel_size: 0.05
terrain: {plane: {z: 2.0}}
soil: {repose_angle: 0.61}
machines:
  - {name: digger, bucket: {width: 0.8, height: 0.6, profile: [[0, 0], [-0.3, -0.05], [-0.6, 0.4], [0, 0.6]]}}
`);
  return [path.join(work, 'pit.yaml'), '--out', path.join(work, `live${++runs}`), '--token', 'sesame'];
};
let runs = 0;

/** A picture of one colour, placed by its world file. */
function paint(file, [r, g, b], [xmin, ymax], cell_m, side) {
  const head = Buffer.alloc(54), row = Buffer.alloc(4 * Math.ceil((3 * side) / 4));
  head.write('BM');
  [[2, 54 + row.length * side], [10, 54], [14, 40], [18, side], [22, side], [34, row.length * side]].forEach(([at, v]) => head.writeUInt32LE(v, at));
  head.writeUInt16LE(1, 26);
  head.writeUInt16LE(24, 28);
  for (let i = 0; i < side; ++i) row.set([b, g, r], 3 * i);
  fs.writeFileSync(file, Buffer.concat([head, ...Array(side).fill(row)]));
  fs.writeFileSync(file.replace(/bmp$/, 'bpw'), [cell_m, 0, 0, -cell_m, xmin + cell_m / 2, ymax - cell_m / 2].join('\n'));
}

looking('a photo lies on ground as it was surveyed, and never on ground that was dug', () => {
  paint(path.join(work, 'photo.bmp'), [30, 60, 220], [-1.5, 2], 0.1, 40);
  return [...live(), '--drape', path.join(work, 'photo.bmp')];
}, async (page) => {
  const dug = [0.5, 0], undug = [0.5, 1.5], outside = [0.5, -2.6];
  await scoop(page, 0, 0, 0, 0.3);
  await page.waitForFunction(() => window.soilvdb.view().blocks > 0);
  await page.click('#work');
  await page.keyboard.press('t');
  await site.settled(page);
  const blue = async (at) => {
    const [r, , b] = await site.colorAt(page, at);
    return b > 1.5 * r;
  };
  const all = async () => [await blue(undug), await blue(dug), await blue(outside)];
  for (const mode of ['loose', 'depth', 'change']) {
    await page.selectOption('[aria-label="Colour by"]', mode);
    await page.waitForFunction(() => window.soilvdb.draped());
    await site.drawn(page);
    assert.deepEqual(await all(), [true, false, false], mode);
  }
  await page.selectOption('[aria-label="Colour by"]', 'loose');
  await step(page, 'a');   // changes since now: they do not tell where it is as surveyed
  await site.drawn(page);
  assert.deepEqual(await all(), [true, false, false], 'compared');
  await page.focus('#canvas');
  await page.keyboard.press('o');
  await site.drawn(page);
  assert.deepEqual(await all(), [false, false, false]);
});

/** Feeds states from the page, as a machine would; the last answer. */
const feed = (page, all) => page.evaluate((states) => new Promise((resolve, reject) => {
  const feed = new WebSocket(`${location.href.replace('http', 'ws').split('#')[0]}feed?token=sesame`);
  let answers = 0;
  feed.onopen = () => states.forEach((s) => feed.send(JSON.stringify(s)));
  feed.onmessage = ({data}) => {
    if (JSON.parse(data).error) reject(new Error(data));
    if (++answers === states.length) {
      feed.close();
      resolve(JSON.parse(data));
    }
  };
}), all);

/** Feeds a scoop from x to x + 1 m at a depth. */
const scoop = (page, begin_s, x, y, depth_m, machine = 'digger') => feed(page, Array.from({length: 21}, (_, i) => ({
  machine, time: begin_s + i / 10, rotation: [0, Math.sin(-0.15), 0, Math.cos(-0.15)],
  position: [x + i / 20, y, 2 + (i < 4 ? 0.2 - (i / 4) * (0.2 + depth_m) : i > 16 ? -depth_m + ((i - 16) / 4) * (depth_m + 0.3) : -depth_m)],
})));

test('what machines dig arrives as it is dug, also after the server was killed', options, async () => {
  let args = live(), server = await site.serve(...args, '--port', '0');
  const port = new URL(server.url).port;
  try {
    const {page, said} = await site.open(browser, `http://127.0.0.1:${port}/#token=sesame`);
    assert.equal((await page.evaluate(() => window.soilvdb.view())).blocks, 0);
    const heightOf = async (y) => (await (await fetch(`http://127.0.0.1:${port}/height?x=0.6&y=${y}&token=sesame`)).json()).height_m;
    for (const [t, y, depth] of [[0, 0, 0.2], [10, 2, 0.3], [20, 0, 0.4]]) {
      await scoop(page, t, 0, y, depth);
      const z = await heightOf(y);
      assert.ok(z < 2 - 0.1);
      await page.waitForFunction(([v, truth, most]) => Math.abs(window.soilvdb.height(0.6, v) - truth) < most, [y, z, kHalfVoxel_m]);
    }
    assert.match(await page.locator('#machine-table tbody tr').textContent(), /digger.*working/s);
    assert.deepEqual(said, []);
    const acknowledged = async () => (await (await fetch(`http://127.0.0.1:${port}/summary.json?token=sesame`)).json()).acknowledged.time_s;
    while (await acknowledged() < 22) await page.waitForTimeout(100);
    const truths = [[0, await heightOf(0)], [2, await heightOf(2)]];
    await page.evaluate(() => { window.before = true; });
    await server.stop('SIGKILL');
    await page.waitForSelector('#notice:not([hidden])');
    server = await site.serve(...args, '--port', port);
    await page.locator('#notice-do').click({timeout: 2000}).catch(() => {});  // it may have tried again by itself
    // Around work that is there already the site is larger, so the page loads itself anew.
    await page.waitForFunction(([all, most]) => !window.before && document.getElementById('notice').hidden &&
      window.soilvdb?.view().settled &&
      all.every(([y, z]) => Math.abs(window.soilvdb.height(0.6, y) - z) < most), [truths, kHalfVoxel_m]);
  } finally {
    await server.stop();
  }
});

const kNames = ['north excavator of the western pit', 'dozer 2', 'wheel loader number three', 'digger'];
const yard = () => {
  const machine = (name) => `  - {name: ${name}, bucket: {width: 0.8, height: 0.6, profile: [[0, 0], [-0.3, -0.05], [-0.6, 0.4], [0, 0.6]]}}`;
  fs.writeFileSync(path.join(work, 'yard.yaml'), `soilvdb: 1
name: gravel pit of the northern bypass, lot 3
voxel_size: 0.05
terrain: {plane: {z: 2.0}}
soil: {repose_angle: 0.61}
machines:
${kNames.map(machine).join('\n')}
`);
  return [path.join(work, 'yard.yaml'), '--out', path.join(work, `live${++runs}`), '--token', 'sesame'];
};

/** What covers or is cut in a page: controls and panels that intersect, words out of their buttons, small targets for fingers. */
const untidy = (page, least_px) => page.evaluate((least) => {
  const found = [], visible = (e) => e.checkVisibility({visibilityProperty: true}) && e.getBoundingClientRect().width > 0;
  const name = (e) => e.id || e.getAttribute('aria-label') || e.getAttribute('class') || e.tagName;
  const boxOf = (e) => {   // what is to be seen of it
    let {left, top, right, bottom} = e.getBoundingClientRect();
    for (let p = e.parentElement; p; p = p.parentElement) {
      if (getComputedStyle(p).overflow === 'visible') continue;
      const box = p.getBoundingClientRect();
      [left, top, right, bottom] = [Math.max(left, box.left), Math.max(top, box.top), Math.min(right, box.right), Math.min(bottom, box.bottom)];
    }
    return {left, top, right, bottom};
  };
  const controls = [...document.querySelectorAll('button, select, input, summary, #menu-list a')].filter(visible);
  const parts = [...controls, ...[...document.querySelectorAll('.bar, #stage, #panel, #time, .tabs, .rail, .note, #legend, #readout, .card, .force, h1, .chip, #time-now, circle[r="9"]')].filter(visible)];
  const boxes = parts.map(boxOf);
  parts.forEach((a, i) => {
    for (let k = i + 1; k < parts.length; ++k) {
      const b = parts[k], p = boxes[i], q = boxes[k];
      if (a.contains(b) || b.contains(a)) continue;
      const [w, h] = [Math.min(p.right, q.right) - Math.max(p.left, q.left), Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top)];
      if (w > 0.5 && h > 0.5) found.push(`${name(a)} and ${name(b)} intersect by ${w} x ${h}`);
    }
  });
  for (const e of controls) {
    e.scrollIntoView({block: 'nearest', inline: 'nearest'});
    const box = e.getBoundingClientRect(), at = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
    if (getComputedStyle(e).pointerEvents !== 'none' && !(e.contains(at) || at?.contains(e) && at.tagName === 'LABEL')) found.push(`${name(e)} cannot be reached: ${at && name(at)}`);
    const target = (e.closest('label') ?? e).getBoundingClientRect();
    if (Math.min(target.width, target.height) < least - 0.5) found.push(`${name(e)} is ${target.width} x ${target.height}`);
    for (const child of e.children) {
      const inner = child.getBoundingClientRect();
      if (visible(child) && (inner.left < box.left - 1 || inner.right > box.right + 1 || inner.bottom > box.bottom + 1)) found.push(`${child.textContent} is wider than ${name(e)}`);
    }
    for (const cut of [e, ...e.querySelectorAll('span')]) {
      if (visible(cut) && (cut.scrollWidth > cut.clientWidth + 1 || cut.scrollHeight > cut.clientHeight + 1) && cut.clientWidth > 0 && !cut.closest('[title]')) found.push(`${cut.textContent} is cut`);
    }
  }
  if (document.documentElement.scrollWidth > innerWidth) found.push(`the page is ${document.documentElement.scrollWidth} wide`);
  return found;
}, least_px);

/** Words that are shown lower than so many px. */
const lowTexts = (page, least_px) => page.evaluate((least) => {
  const range = document.createRange(), texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), low = [];
  while (texts.nextNode()) {
    const {data, parentElement} = texts.currentNode;
    range.selectNodeContents(texts.currentNode);
    const {left, height} = range.getBoundingClientRect();
    if (data.trim() && left > 0 && height > 0 && height < least && parentElement.checkVisibility({visibilityProperty: true})) low.push(`${data}: ${height}`);
  }
  return low;
}, least_px);

for (const [kind, sizes, touch] of [
  ['screens', [[640, 400], [720, 450], [1440, 900], [3840, 2160]], false],
  ['phones and tablets', [[390, 844], [844, 390], [768, 1024]], true],
]) {
  looking(`nothing covers anything on ${kind}, and all controls can be reached`, yard, async (page) => {
    for (const [i, machine] of kNames.slice(0, 3).entries()) await scoop(page, 1.7e9 + 100 * i, 0.3 * i, 0.4 * i, 0.3, machine);   // dates are long
    await page.waitForFunction(() => window.soilvdb.view().blocks > 0);
    await page.evaluate(() => { document.querySelector('#legend details').open = true; });
    for (const [width, height] of sizes) {
      await page.setViewportSize({width, height});
      const tidy = async (when) => {
        await site.drawn(page);
        assert.deepEqual(await untidy(page, touch ? 40 : 0), [], `at ${width} x ${height} ${when}`);
      };
      await page.evaluate(() => document.querySelector('[data-tab][aria-pressed=true]')?.click());
      await page.click('#work');
      await site.settled(page);
      await tidy('at first');
      if (width > 3000) assert.deepEqual(await lowTexts(page, 16), [], 'words can be read on a screen of 4K');
      await page.evaluate(() => { document.querySelector('#notice').hidden = document.querySelector('#notice-do').hidden = false; document.querySelector('#notice-text').textContent = 'No connection to the site. Trying again in 30 s.'; });
      await tidy('without a connection');
      await page.evaluate(() => { document.querySelector('#notice').hidden = true; });
      await page.click('[data-tool=boundary]');
      await page.focus('#canvas');
      await page.keyboard.press('Space');
      await tidy('with a point');
      await page.keyboard.press('Escape');
      await page.keyboard.press('h');
      for (let n = 0; n < 2; ++n) {   // two letters at one place
        await site.answerTo(page, '/height', () => page.keyboard.press('Space'));
      }
      await page.keyboard.press('v');
      await tidy('with measures');
      await page.keyboard.press('a');
      if (await page.locator('[data-tab=machines]').isVisible()) await page.click('[data-tab=machines]');
      await page.click('.machine >> nth=0');
      await tidy('with machines');
      await page.keyboard.press('k');
      await page.waitForFunction(() => document.querySelectorAll('.force .gauge:not([hidden])').length === 3);
      await tidy('with forces');
      await page.keyboard.press('k');
      await page.keyboard.press('a');
      await page.click('.machine >> nth=0');
      while (await page.locator('.card').count() > 0) await page.evaluate(() => document.querySelector('[aria-label^=Remove]').click());
    }
  }, {deviceScaleFactor: 0.25, hasTouch: touch, isMobile: touch});   // coarse, because drawing takes the time
}

for (const [way, viewport] of [['upright', {width: 195, height: 422}], ['on its side', {width: 422, height: 195}]]) {
  looking(`a phone ${way} at 200 % has all controls, and its page scrolls`, yard, async (page) => {
    await scoop(page, 1.7e9, 0, 0, 0.3, kNames[3]);
    await page.waitForFunction(() => window.soilvdb.view().blocks > 0);
    for (const tab of ['machines', 'measures']) {
      await page.tap(`[data-tab=${tab}]`);
      for (const control of await page.locator('button:visible, summary:visible, select:visible, input:visible').all()) {
        if (await control.evaluate((e) => !e.disabled && getComputedStyle(e).pointerEvents !== 'none')) await control.tap({trial: true});
      }
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth && document.documentElement.scrollHeight > innerHeight));
    }
    await page.tap('[data-tab=machines]');
    assert.ok(await page.locator('#machines .scroll').evaluate((e) => e.scrollWidth <= e.clientWidth), 'all of the table is to be seen');
    for (const menu of ['downloads', 'units']) {
      await page.tap(`#${menu} summary`);
      const names = page.locator(`#${menu} :is(a, label)`);
      await names.first().waitFor();
      for (const name of await names.all()) {
        const {x, width} = await name.boundingBox();
        assert.ok(x >= 0 && x + width <= viewport.width, `${await name.textContent()} from ${x} to ${x + width}`);
        assert.ok(await name.evaluate((e) => e.scrollWidth <= e.clientWidth), await name.textContent());
      }
      await page.keyboard.press('Escape');
    }
  }, {viewport, hasTouch: true, isMobile: true});
}

/** Whether all of a text is to be seen: at the ends of each of its lines there is nothing else. */
const legible = (page, part) => page.evaluate((selector) => {
  const range = document.createRange(), element = document.querySelector(selector);
  range.selectNodeContents(element);
  element.scrollIntoView({block: 'nearest'});
  return [...range.getClientRects()].every(({left, right, top, bottom}) => [left + 1, right - 1].every((x) => element.contains(document.elementFromPoint(x, (top + bottom) / 2))));
}, part);

for (const locale of ['en-US', 'de-DE']) {
  looking(`the time is to be read on phones in ${locale}, also while changes are compared`, yard, async (page) => {
    await scoop(page, 1.7e9 + 40000, 0, 0, 0.3, kNames[3]);
    const first = await page.waitForFunction(() => /[0-9]{2}:[0-9]{2}/.test(document.querySelector('#time-now').textContent) && document.querySelector('#time-now').textContent);
    const [day] = (await first.jsonValue()).split(',');
    for (const compared of [false, true]) {
      if (compared) {
        await page.keyboard.press('a');
        const words = await page.waitForFunction(() => document.querySelector('#compare').textContent.match(/^Since (.*) \u00d7$/)?.[1]).then((text) => text.jsonValue());
        assert.ok(!words.includes(day) && /^[0-9]+:/.test(words), `${words} is on the shown day`);
      }
      for (const [width, height] of [[390, 844], [844, 390], [195, 422], [422, 195], [360, 640], [768, 1024]]) {
        await page.setViewportSize({width, height});
        await site.drawn(page);
        assert.ok(await legible(page, '#time-now'), `at ${width} x ${height}${compared ? ', compared' : ''}`);
        assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `at ${width} x ${height}`);
      }
    }
  }, {viewport: {width: 390, height: 844}, hasTouch: true, isMobile: true, locale, timezoneId: 'UTC'});
}

looking('a phone has the totals of the site above its machines, and surveys beside the net', yard, async (page) => {
  await scoop(page, 0, 0, 0, 0.3, kNames[3]);
  await page.tap('[data-tab=machines]');
  const totals = page.locator('#panel .totals');
  await page.waitForFunction(() => /Dug[^0-9]*[1-9]?[0-9.]*[1-9]/.test(document.querySelector('#panel .totals').textContent));
  assert.ok(await totals.isVisible());
  assert.equal(await totals.textContent(), await page.locator('#totals').textContent());
  assert.doesNotMatch(await totals.textContent(), /surveyed/);
  const points = [[-1, 5], [1, 5], [1, 7], [-1, 7]].map(([x, y], i) => `<P id="${i + 1}">${y} ${x} 2.5</P>`).join('');
  const {added_m3: added, removed_m3: removed} = await page.evaluate(async (text) => (await (await fetch('survey?token=sesame', {method: 'POST', body: text})).json()), '<?xml version="1.0"?>' +
    '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2"><Units><Metric linearUnit="meter"/></Units><Surfaces><Surface name="heap">' +
    `<Definition surfType="TIN"><Pnts>${points}</Pnts><Faces><F>1 2 3</F><F>1 3 4</F></Faces></Definition></Surface></Surfaces></LandXML>`);
  assert.ok(added > 1);
  await page.waitForFunction((net) => Number(document.querySelector('#panel .totals').textContent.match(/surveyed\+([0-9.]+)/)?.[1]) === net, Number((added - removed).toPrecision(3)));
}, {viewport: {width: 390, height: 844}, hasTouch: true, isMobile: true});

/** Sends rays from above that ended at points on a grid, so far below the drawn ground; the answer. */
const scan = (page, sensor, time, [x0, y0, x1, y1], below_m = 0) => page.evaluate(([head, box, below]) => new Promise((resolve) => {
  const points = [], step = 0.03;
  for (let x = box[0]; x <= box[2]; x += step) for (let y = box[1]; y <= box[3]; y += step) points.push(x, y, window.soilvdb.height(x, y) - below);
  const words = new TextEncoder().encode(JSON.stringify(head)), message = new Uint8Array(4 + words.length + 8 * points.length), view = new DataView(message.buffer);
  view.setUint32(0, words.length, true);
  message.set(words, 4);
  points.forEach((v, k) => view.setFloat64(4 + words.length + 8 * k, v, true));
  const stream = new WebSocket(`${location.href.replace('http', 'ws').split('#')[0]}scan?token=sesame`);
  stream.onopen = () => stream.send(message);
  stream.onmessage = ({data}) => {
    stream.close();
    resolve(JSON.parse(data));
  };
}), [{sensor, format: 'float64_xyz', frame: 'world', position: [(x0 + x1) / 2, (y0 + y1) / 2, 7], rotation: [1, 0, 0, 0], ...(time === null ? {} : {time})}, [x0, y0, x1, y1], below_m]);

const seesSigmas = (page, what) => page.waitForFunction((seen) => window.soilvdb.sigmas().settled && (window.soilvdb.sigmas().seen > 0) === seen, what);

/** A site whose soil stays where it is. */
const quarry = () => {
  fs.writeFileSync(path.join(work, 'quarry.yaml'), `soilvdb: 1
voxel_size: 0.05
terrain: {plane: {z: 2.0}}
machines: [{name: digger, bucket: {width: 0.8, height: 0.6, profile: [[0, 0], [-0.5, 0], [-0.5, 0.6], [0, 0.6]]}}]
`);
  return [path.join(work, 'quarry.yaml'), '--out', path.join(work, `live${++runs}`), '--token', 'sesame'];
};

/** Digs a trench of 1 m with a level floor at a depth, and moves away. */
const trench = (page, begin_s, y, depth_m) => feed(page, [[0, 0.5], ...Array.from({length: 21}, (_, i) => [i / 20, -depth_m]), [1, 4], [6, 4]].map(([x, z], i) => (
  {machine: 'digger', time: begin_s + i / 10, position: [x, y, 2 + z], rotation: [0, 0, 0, 1]})));

looking('the ground has the colours of what scans know of it, until it is dug, and the scans are told with the lips', quarry, async (page) => {
  const asked = [];
  page.on('request', (request) => { if (new URL(request.url()).pathname.endsWith('/sigmas')) asked.push(request.url()); });
  const option = page.locator('[aria-label="Colour by"] option[value=sigma]'), words = (part) => page.locator(part).allTextContents();
  await trench(page, 1.7e9, 0, 0.3);
  await site.drawnBelow(page, [0.6, 0.03], 1.75);
  assert.ok(await option.count() === 0 && await page.isHidden('#scans'), 'nobody scans');
  const answer = await scan(page, 'mast', 1.7e9 + 1, [-1.5, 0.8, 1.5, 1.6]);
  assert.ok(answer.rays.used > 900, JSON.stringify(answer));
  await option.waitFor({state: 'attached'});
  assert.deepEqual(asked, [], 'nobody looks');
  for (const button of ['#work', '#above']) await page.click(button);
  await page.selectOption('[aria-label="Colour by"]', 'sigma');
  await seesSigmas(page, true);
  await site.settled(page);
  const sigma = (at) => page.evaluate(([x, y]) => window.soilvdb.sigma(x, y), at), seen = [0.63, 1.13], beside = [0.63, -1.23], floor = [0.6, 0.03];
  const known_m = await sigma(seen);
  assert.ok(known_m >= 0.003 && known_m < 0.0102, `${known_m} is better than the terrain`);
  assert.equal(await sigma(beside), null);
  assert.equal(await sigma(floor), null, 'it was not scanned');
  // On level ground light multiplies colours alike, so the picture tells those of the scale.
  const as = async (mode, at) => {
    await page.selectOption('[aria-label="Colour by"]', mode);
    await site.drawn(page);
    return site.colorAt(page, at);
  };
  const [plain, shown, soil] = [await as('depth', seen), await as('sigma', seen), await as('sigma', beside)];
  soil.forEach((v, c) => assert.ok(Math.abs(v - plain[c]) < 3, `ground that was not seen is plain: ${soil}, not ${plain}`));
  const share = Math.log10(known_m / 0.003) / 2, wanted = along('sigma', share).map((v, c) => Math.min(255, (v / (255 * [0.79, 0.725, 0.63][c])) * plain[c]));
  shown.forEach((v, c) => assert.ok(Math.abs(v - wanted[c]) < 6, `${known_m} m is ${shown}, not ${wanted}`));
  await page.mouse.move(...await page.evaluate(([x, y]) => window.soilvdb.project([x, y, window.soilvdb.height(x, y)]), seen));
  await page.waitForFunction((mm) => document.querySelector('#position').textContent.includes(`\u00b1 ${mm}\u2009mm`), (1000 * known_m).toFixed(0));
  assert.deepEqual(await words('#legend .ticks span'), ['3', '10', '30', '100', '300']);
  assert.ok((await words('#legend p, #legend .legend-names')).join().includes('mm') && await page.isVisible('text=Plain: not seen as it is now'));

  // The lip of the machine that dug, by what was scanned of its trench, 2 cm below where it is said to be.
  const told = await scan(page, 'of the trench', null, [0.3, -0.3, 0.8, 0.3], 0.02), [mean, sigma_m] = told.lip_error.digger;
  await page.waitForFunction(() => window.soilvdb.sigma(0.6, 0.03) !== null);
  await page.waitForFunction(() => document.querySelectorAll('#scans .scan').length === 3);
  const rows = async () => (await words('#scans .scan')).map((row) => row.replace(/\u2009/g, ' '));
  const lip = `digger${mean < 0 ? '\u2212' : '+'}${Math.abs(1000 * mean).toFixed(0)} \u00b1 ${(1000 * sigma_m).toFixed(0)} mm`;
  await page.waitForFunction((text) => document.querySelector('#scans').textContent.replace(/\u2009/g, ' ').includes(text), lip);
  assert.ok(mean > 0.002 && sigma_m < 0.0195, JSON.stringify(told));
  const all = await rows(), clock = (s) => page.evaluate((t) => new Date(1000 * t).toLocaleTimeString(undefined, {timeStyle: 'medium'}), s);
  assert.match(all[0], new RegExp(`^mast${await clock(1.7e9 + 1)} \u00b7 [0-9]+ s ago$`));
  assert.match(all[1], new RegExp(`^of the trench${await clock(1.7e9 + 2.3)} \u00b7 [0-9]+ s ago$`));
  const [, ago] = all[0].match(/([0-9]+) s ago/);
  await page.waitForFunction((before) => Number(document.querySelector('#scans .scan').textContent.match(/([0-9]+)\u2009s ago/)[1]) > before, Number(ago));

  await trench(page, 1.7e9 + 10, 1.2, 0.2);
  await page.waitForFunction(() => window.soilvdb.sigma(0.63, 1.13) === null && window.soilvdb.sigma(-1.33, 1.13) !== null);

  // Other times: before the first scan, and after the last one.
  const slide = async (share) => {
    const before = await page.evaluate(() => window.soilvdb.view().id);
    await page.locator('#time input').evaluate((slider, at) => {
      slider.value = String(at * Number(slider.max));
      slider.dispatchEvent(new Event('change'));
    }, share);
    await page.waitForFunction((id) => window.soilvdb.view().id !== id && document.querySelector('#connection-text').textContent === 'Past', before);
  };
  await slide(0);
  await seesSigmas(page, false);
  assert.ok(await page.isHidden('#scans') && asked.some((url) => new URL(url).searchParams.has('time')));
  await slide(0.5);
  await seesSigmas(page, true);
  assert.ok(await sigma(seen) !== null, 'it was not dug then');
  const ago_s = (await page.evaluate(() => window.soilvdb.time())) - 1.7e9 - 2.3;
  assert.ok(ago_s > 1);
  assert.deepEqual(await rows(), [`Last${await clock(1.7e9 + 2.3)} \u00b7 ${ago_s.toFixed(0)} s ago`, lip]);
  await page.keyboard.press('l');
  await page.waitForFunction(() => document.querySelector('#connection-text').textContent === 'Live');
  await seesSigmas(page, true);
  await page.evaluate(() => { location.hash = ''; });
  await page.click('#units summary');
  await page.selectOption('#unit-list select', 'ft');
  assert.deepEqual(await words('#legend .ticks span'), ['0.01', '0.03', '0.1', '0.3', '1']);
  assert.match((await rows()).at(-1), / ft$/);
}, {viewport: {width: 1100, height: 700}});

looking('small screens have room for the sigmas and the scans', yard, async (page) => {
  const long = 'depth camera on the mast beside the eastern gate of the pit';
  await scoop(page, 1.7e9, 0, 0, 0.3, kNames[0]);
  await scan(page, long, 1.7e9 + 1, [-0.5, 0.5, 1.5, 2]);
  await page.waitForFunction(() => document.querySelector('#scans .scan'));
  await page.evaluate(() => {
    const select = document.querySelector('[aria-label="Colour by"]');
    select.value = 'sigma';
    select.dispatchEvent(new Event('change'));
  });
  await seesSigmas(page, true);
  await page.tap('[data-tab=machines]');
  for (const [width, height] of [[390, 844], [844, 390], [195, 422], [422, 195]]) {
    await page.setViewportSize({width, height});
    await site.drawn(page);
    const wrong = await page.evaluate(() => {
      const found = [], box = (e) => e.getBoundingClientRect(), apart_px = 3, panel = box(document.querySelector('#panel'));
      if (document.documentElement.scrollWidth > innerWidth) found.push(`the page is ${document.documentElement.scrollWidth} wide`);
      const ticks = [...document.querySelectorAll('#legend .ticks span')].filter((tick) => tick.checkVisibility()), legend = box(document.querySelector('#legend'));
      ticks.forEach((tick, i) => {
        if (i > 0 && box(ticks[i - 1]).right > box(tick).left - apart_px) found.push(`${ticks[i - 1].textContent} covers ${tick.textContent}`);
        if (box(tick).left < legend.left || box(tick).right > legend.right) found.push(`${tick.textContent} is cut`);
      });
      if (ticks.length !== (innerWidth < 300 ? 3 : 5)) found.push(`${ticks.length} ticks`);
      for (const row of document.querySelectorAll('#scans .scan')) {
        const [name, value] = [row.querySelector('span'), row.querySelector('b')].map(box);
        if (name.width < 40 || value.width < 40 || value.right > panel.right || name.left < panel.left) found.push(`${row.textContent} is cut`);
        if (name.bottom > value.top + 2 && name.right > value.left) found.push(`${row.textContent} is covered`);
      }
      return found;
    });
    assert.deepEqual(wrong, [], `at ${width} x ${height}`);
  }
  assert.ok(await page.getByTitle(long).count() > 0, 'all of the name is to be had');
}, {viewport: {width: 390, height: 844}, hasTouch: true, isMobile: true});

looking('a measure is shown where nothing covers its corners, and can be dragged there', yard, async (page) => {
  const corners = [[-1, -1], [2, -1], [2, 1.5], [-1, 1.5]];
  await page.evaluate((points) => fetch('measures?token=sesame', {method: 'POST', body: JSON.stringify({add: {kind: 'boundary', name: 'pit', points}})}), corners);
  for (const [width, height] of [[390, 844], [844, 390], [1440, 900]]) {
    await page.setViewportSize({width, height});
    if (await page.isHidden('#measures')) await page.tap('[data-tab=measures]');
    const shown = page.locator('#named button');
    if (await shown.getAttribute('aria-pressed') === 'false') await shown.click();
    for (const from of ['#above', '#whole']) {
      await page.click(from);
      await site.drawn(page);
      await page.getByLabel('Go to Boundary pit').click();
      await site.drawn(page);
      const under = await page.evaluate((all) => all.map(([x, y]) => {
        const [u, v] = window.soilvdb.project([x, y, window.soilvdb.height(x, y)]);
        return document.elementFromPoint(u, v)?.id;
      }), corners);
      assert.deepEqual(under, Array(4).fill('canvas'), `at ${width} x ${height} after ${from}`);
      const [low, high] = await page.evaluate((all) => {
        const xs = all.map(([x, y]) => window.soilvdb.project([x, y, window.soilvdb.height(x, y)])[0]);
        return [Math.min(...xs), Math.max(...xs)];
      }, corners);
      assert.ok(high - low > 50, `${high - low} px are large enough to drag`);
    }
  }
}, {viewport: {width: 390, height: 844}, hasTouch: true, isMobile: true});

looking('the ground keeps its size when a panel opens or the phone is turned', yard, async (page) => {
  await page.click('#whole');
  await site.settled(page);
  await site.drawn(page);
  const metre = () => page.evaluate(() => {   // at the middle of the picture
    const [a, b] = [[-0.5, 0, 2], [0.5, 0, 2]].map((p) => window.soilvdb.project(p));
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  });
  const before = await metre(), height = () => page.locator('#canvas').evaluate((e) => e.clientHeight), tall = await height();
  const same = async (when) => {
    await site.drawn(page);
    assert.ok(Math.abs((await metre()) / before - 1) < 0.03, `a metre of ${before} px has ${await metre()} px ${when}`);
  };
  await page.tap('[data-tab=machines]');
  await site.drawn(page);
  assert.ok(await height() < 0.7 * tall);
  await same('beside a panel');
  await page.tap('[data-tab=machines]');
  await page.setViewportSize({width: 844, height: 390});
  await same('on the side');
  await page.setViewportSize({width: 390, height: 844});
  await same('upright again');
  assert.equal(await height(), tall);
}, {viewport: {width: 390, height: 844}, hasTouch: true, isMobile: true});

looking('a machine that comes leaves what was measured and what is being drawn', yard, async (page) => {
  await scoop(page, 0, 0, 0, 0.3, kNames[3]);
  await site.drawnBelow(page, [0.6, 0], 1.9);
  await site.drawn(page);
  await page.keyboard.press('g');
  await page.keyboard.press('t');
  await site.drawn(page);
  const places = [];
  page.on('request', (request) => { if (new URL(request.url()).pathname === '/height') places.push(new URL(request.url()).search); });
  for (const at of [[0.6, 0], [0.2, 0.1]]) {
    await page.keyboard.press('h');
    await site.answerTo(page, '/height', () => site.clickAt(page, at));
  }
  await page.keyboard.press('b');
  for (const at of [[0, 0], [1, 0], [1, 0.4]]) await site.clickAt(page, at);
  const words = () => page.evaluate(() => [...document.querySelectorAll('.card')].map((card) => card.getAttribute('aria-label')));
  assert.deepEqual(await words(), ['Point B', 'Point A']);
  const asked = [...new Set(places)].sort();
  for (const name of ['loader', 'second']) {
    places.length = 0;
    await Promise.all([page.waitForEvent('load'), fetchChange(page, {add: {name, bucket: {width: 2.4, height: 1.0}}})]);
    await site.settled(page);
    await page.waitForFunction(() => document.querySelectorAll('.card dd').length >= 6);
    assert.deepEqual(await words(), ['Point B', 'Point A']);
    assert.deepEqual([...new Set(places)].sort(), asked, 'where they were');
    assert.equal(await page.locator('#done').isEnabled(), true, 'three corners are drawn');
  }
  const {query} = await site.answerTo(page, '/volume', () => page.click('#done'));
  assert.equal(query.get('boundary').split(',').length, 6);
  assert.deepEqual(await words(), ['Boundary C', 'Point B', 'Point A']);
  await page.reload();
  await site.settled(page);
  assert.deepEqual(await words(), [], 'who loads the page begins anew');
});

/** Changes the machines of a site. */
const fetchChange = (page, change) => page.evaluate((what) => { fetch('machines?token=sesame', {method: 'POST', body: JSON.stringify(what)}); }, change);

looking('a finger draws a boundary, takes a point back and ends it', yard, async (page) => {
  await scoop(page, 0, 0, 0, 0.3, kNames[3]);
  await page.waitForFunction(() => window.soilvdb.view().blocks > 0);
  await page.tap('#work');
  await site.settled(page);
  await page.tap('[data-tab=machines]');
  assert.ok(await page.isVisible('#panel'));
  await page.tap('[data-tool=boundary]');
  assert.ok(await page.isHidden('#panel'), 'all of the picture is there to draw in');
  assert.match(await page.textContent('#hint-text'), /^Tap corners/);
  assert.ok(await page.locator('#undo').isHidden());
  assert.ok(await page.isVisible('#legend select') && await page.isHidden('#legend summary') && await page.isHidden('#legend label'));
  const {width, height, x, y} = await page.locator('#canvas').boundingBox();
  const points = (n) => page.waitForFunction((all) => document.querySelectorAll('#marks circle').length === all, n);
  for (const [i, [u, v]] of [[0.4, 0.4], [0.6, 0.4], [0.6, 0.6], [0.4, 0.6]].entries()) {
    await page.touchscreen.tap(x + u * width, y + v * height);
    await points(i + 1);
    assert.equal(await page.locator('#done').isEnabled(), i >= 2);
  }
  await page.tap('#undo');
  await points(3);
  const {query} = await site.answerTo(page, '/volume', () => page.tap('#done'));
  assert.equal(query.get('boundary').split(',').length, 6);
  assert.ok(await page.locator('#undo').isHidden());
  await page.waitForSelector('#panel .card[data-kind=boundary] .cut dd');
  assert.ok(await page.isHidden('#hint'), 'it would lie over what was drawn');
  await page.tap('#work');
  await site.settled(page);
  const [legend, picture] = await Promise.all(['#legend', '#stage'].map((part) => page.locator(part).boundingBox()));
  assert.ok(legend.height < picture.height / 3, `a legend of ${legend.height} px in a picture of ${picture.height} px`);
  await page.tap('#legend summary');
  assert.ok(await page.isVisible('#legend select'));
  await page.touchscreen.tap(x + 0.6 * width, y + 0.2 * height);
  assert.ok(await page.isVisible('#undo'), 'the tool goes on');
  await page.tap('[data-tool=look]');
  await page.tap('[data-tool=boundary]');
  assert.ok(await page.isVisible('#hint'));
  await page.tap('[data-tab=measures]');
  await page.getByText('Name and keep').tap();
  await page.setViewportSize({width: 390, height: 480});   // by a phone's keyboard
  const [name, panel] = await Promise.all(['.edit > input', '#panel'].map((part) => page.locator(part).boundingBox()));
  assert.ok(name.y + name.height <= panel.y + panel.height, 'a name can be seen');
}, {viewport: {width: 390, height: 844}, hasTouch: true, isMobile: true});

/** Touches with one finger or more, which go on straight lines. @param {number[][][]} ways from and to of each */
async function touch(page, ways) {
  const client = await page.context().newCDPSession(page), steps = 8;
  const send = (type, k) => client.send('Input.dispatchTouchEvent', {type, touchPoints: k === null ? [] : ways.map(([from, to], id) =>
    ({id, x: from[0] + ((to[0] - from[0]) * k) / steps, y: from[1] + ((to[1] - from[1]) * k) / steps}))});
  await send('touchStart', 0);
  for (let k = 1; k <= steps; ++k) {
    await send('touchMove', k);
    await site.drawn(page);
  }
  await send('touchEnd', null);
  await site.drawn(page);
}

looking('two fingers on what floats over the ground never zoom the page', yard, async (page) => {
  await scoop(page, 0, 0, 0, 0.3, kNames[3]);
  await page.waitForFunction(() => document.querySelector('.tag:not([hidden]):not(.away)'));
  await page.evaluate(() => { document.querySelector('#notice').hidden = false; document.querySelector('#notice-text').textContent = 'No connection to the site.'; });
  await site.drawn(page);
  const scale = () => page.evaluate(() => visualViewport.scale);
  const pinch = async (part) => {
    const {x, y, width, height} = await page.locator(part).first().boundingBox(), [u, v] = [x + width / 2, y + height / 2];
    await touch(page, [[[u - 10, v], [u - 80, v]], [[u + 10, v], [u + 80, v]]]);
  };
  for (const part of ['.tag:not([hidden])', '#legend', '#notice', '#tools', '#camera', '#canvas']) {
    await pinch(part);
    assert.equal(await scale(), 1, part);
  }
  await page.tap('[data-tab=measures]');
  await pinch('#measures');
  assert.ok(await scale() > 1.2, 'words of a panel can be enlarged');
}, {viewport: {width: 390, height: 844}, hasTouch: true, isMobile: true});

looking('keys alone move the picture, measure, and read a section', yard, async (page) => {
  await scoop(page, 0, 0, 0, 0.3, kNames[3]);
  await page.waitForFunction(() => window.soilvdb.view().blocks > 0);   // else all of the site stays in view, where keys move little
  await page.keyboard.press('g');
  await site.settled(page);
  await page.evaluate(() => { window.place = () => [[-4, -4, 2], [4, -4, 2], [4, 4, 2], [-4, 4, 2]].map((p) => window.soilvdb.project(p) ?? [0, 0]).flat(); });
  const place = () => page.evaluate(() => window.place());
  /** Holds a key until the picture has moved; the page itself releases it, before the picture leaves the site. */
  const hold = async (key, shift = false) => {
    await page.evaluate((held) => {
      const before = window.place();
      window.hasMoved = false;
      const look = () => {
        if (window.place().every((v, i) => Math.abs(v - before[i]) < 10)) return requestAnimationFrame(look);
        document.querySelector('#canvas').dispatchEvent(new KeyboardEvent('keyup', {key: held}));
        window.hasMoved = true;
      };
      look();
    }, key);
    if (shift) await page.keyboard.down('Shift');
    await page.keyboard.down(key);
    await page.waitForFunction(() => window.hasMoved);
    await page.keyboard.up(key);
    if (shift) await page.keyboard.up('Shift');
  };
  await page.keyboard.press('b');   // the picture has the focus now
  assert.ok(await page.locator('#crosshair').isVisible());
  await page.waitForFunction(() => /E .*N .*height/.test(document.querySelector('#position').textContent));
  await page.keyboard.press('Space');
  await hold('ArrowRight');
  await page.keyboard.press('Enter');
  await hold('ArrowUp');
  await page.keyboard.press('Space');
  await page.focus('#done');
  const {query} = await site.answerTo(page, '/volume', () => page.keyboard.press('Enter'));
  assert.equal(query.get('boundary').split(',').length, 6);
  assert.ok(await page.evaluate(() => document.activeElement.id === 'canvas'));
  for (const [key, shift] of [['ArrowLeft', true], ['ArrowUp', true], ['+', false], ['-', false]]) await hold(key, shift);
  await page.keyboard.press('s');
  await page.keyboard.press('Enter');
  await hold('ArrowLeft');
  await site.answerTo(page, '/section', () => page.keyboard.press('Enter'));
  await page.waitForSelector('svg.chart');
  for (let n = 0; n < 60 && !(await page.evaluate(() => document.activeElement.matches('svg.chart'))); ++n) await page.keyboard.press('Tab');
  await page.keyboard.press('ArrowRight');
  assert.match(await page.locator('.card[data-kind=section] .keys').textContent(), /^at /);
  await page.keyboard.press('t');   // at once, because this browser asks for less motion
  await site.drawn(page);
  const there = await place();
  await site.drawn(page);
  assert.deepEqual(await place(), there);
});

const blades = () => {
  fs.writeFileSync(path.join(work, 'blades.yaml'), `soilvdb: 1
voxel_size: 0.05
terrain: {plane: {z: 2.0}}
soil: {repose_angle: 0.61, density: 1800, cohesion: 8000}
machines:
  - {name: digger, bucket: {width: 0.8, height: 0.6, profile: [[0, 0], [-0.3, 0.05], [-0.6, 0.4], [0, 0.6]]}}
  - {name: blade, bucket: {width: 0.8, height: 0.6}}
  - {name: waiting, bucket: {width: 0.8, height: 0.6}}
`);
  return [path.join(work, 'blades.yaml'), '--out', path.join(work, `live${++runs}`), '--token', 'sesame'];
};
const kNewtonsPerMetre = 5000, kLongest_m = 2;   // of arrows at such buckets

/** A drag at a depth that ends in the ground. */
const drag = (machine, begin_s, y, depth_m, pitch = 0) => Array.from({length: 21}, (_, i) => ({
  machine, time: begin_s + i / 10, force: true, position: [i / 20, y, 2 - depth_m], rotation: [0, Math.sin(pitch / 2), 0, Math.cos(pitch / 2)],
}));

/** What the page shows of the force on a machine: its arrow and the texts of its gauge. */
const shownForce = (page, machine) => page.evaluate((name) => {
  const row = document.querySelector(`.force[data-machine="${name}"]`), text = (q) => row.querySelector(q).textContent.replaceAll('\u2009', ' ');
  const {arrow} = window.soilvdb.machines().find((m) => m.name === name);
  return {arrow, value: text('b'), why: text('.force-limit'), all: row.textContent.replaceAll('\u2009', ' '), said: row.querySelector('.gauge').getAttribute('aria-valuetext')?.replaceAll('\u2009', ' ')};
}, machine);

/** Waits until the page shows a force, and gives it. */
async function forceOf(page, machine, size_n) {
  await page.waitForFunction(([name, kn]) => Number(document.querySelector(`.force[data-machine="${name}"] b`)?.textContent.match(/[0-9.]+/)?.[0]) === kn, [machine, Number((size_n / 1000).toPrecision(2))]);
  return shownForce(page, machine);
}

looking('the force on a bucket is an arrow to its lip and a gauge, while it is switched on', blades, async (page) => {
  const frames = {state: 0, force: 0};
  page.on('websocket', (socket) => socket.on('framereceived', ({payload}) => {
    if (typeof payload === 'string' && socket.url().includes('/view')) ++frames[JSON.parse(payload).type];
  }));
  const states = async (more) => { for (const until = frames.state + more; frames.state < until;) await page.waitForTimeout(50); };
  await page.reload();
  await site.settled(page);
  const pitch = -0.3, {force_n: [x, y, z]} = await feed(page, drag('digger', 0, 0, 0.3, pitch)), size_n = Math.hypot(x, y, z);
  await states(2);
  assert.equal(frames.force, 0);
  await page.keyboard.press('k');
  assert.ok(await page.isChecked('#force'));
  const first = await forceOf(page, 'digger', size_n), world = [Math.cos(pitch) * x + Math.sin(pitch) * z, y, Math.cos(pitch) * z - Math.sin(pitch) * x];
  const along = world.map((n) => (n / size_n) * Math.min(kLongest_m, size_n / kNewtonsPerMetre));
  first.arrow.forEach((m, axis) => assert.ok(Math.abs(m - along[axis]) < 1e-6, `${first.arrow} is not ${along}`));
  assert.ok(first.all.includes(`Largest ${first.value}`) && first.said.includes(first.value), JSON.stringify(first));
  assert.equal((await shownForce(page, 'waiting')).why, 'not seen yet');
  assert.ok((await page.getByRole('meter', {name: 'Force on digger'}).count()) === 1);
  assert.ok((await page.locator('.tag >> nth=0').textContent()).replaceAll('\u2009', ' ').endsWith(first.value));
  assert.match((await page.locator('#force-scale').textContent()).replaceAll('\u2009', ' '), /^1 m is 5\.0 kN$/);

  const steep = await feed(page, drag('blade', 0, 3, 0.4)), steep_n = Math.hypot(...steep.force_n);
  assert.ok(steep_n > kLongest_m * kNewtonsPerMetre);
  const blade = await forceOf(page, 'blade', steep_n);
  assert.ok(Math.abs(Math.hypot(...blade.arrow) - kLongest_m) < 1e-9, 'it is as long as arrows get');
  assert.ok(blade.value.startsWith('≈') && blade.why === 'Rough estimate: steep blade', JSON.stringify(blade));
  const {force_n: less} = await feed(page, [{...drag('digger', 3, 0, -0.5)[0], position: [1, 0, 2.5]}]);
  const later = await forceOf(page, 'digger', Math.hypot(...less));
  assert.ok(later.all.includes(`Largest ${first.value}`), `${later.all} has ${first.value}`);

  await page.keyboard.press('k');   // in a small picture the box is behind a button
  assert.equal((await shownForce(page, 'blade')).arrow, null);
  assert.ok(await page.isHidden('#forces'));
  await states(2);
  const {force} = frames;
  await states(2);
  assert.equal(frames.force, force, 'the server sends no more');
});

looking('forces at another time are those of then', recorded, async (page) => {
  await page.keyboard.press('k');
  await page.waitForSelector('.force .gauge:not([hidden])');
  assert.match((await shownForce(page, 'excavator')).all, /Largest [0-9]/);
  let largest_n = 0;
  for (let n = 0; n < 3; ++n) {
    await step(page, '[');
    await page.waitForSelector('.force .gauge:not([hidden])');
    const [force] = await page.evaluate((time) => new Promise((resolve) => {
      const viewer = new WebSocket(`${location.href.replace('http', 'ws').split('#')[0]}view`);
      viewer.onopen = () => [{time}, {force: true}].forEach((asked) => viewer.send(JSON.stringify(asked)));
      viewer.onmessage = ({data}) => {
        const message = typeof data === 'string' ? JSON.parse(data) : {};
        if (message.type !== 'force' || message.id === 0) return;
        viewer.close();
        resolve(message.machines.map((m) => m.world_force_n));
      };
    }), await page.evaluate(() => window.soilvdb.time()));
    const size_n = Math.hypot(...force), shown = await forceOf(page, 'excavator', size_n);
    assert.ok(Math.abs(Math.hypot(...(shown.arrow ?? [0])) - size_n / 10000) < 0.03, `${shown.arrow} at ${size_n} N`);
    assert.match(shown.all, /Largest: of live forces only/);
    largest_n = Math.max(largest_n, size_n);
  }
  assert.ok(largest_n > 5000, 'it holds soil at one of these times');
  await page.keyboard.press('l');
  await page.waitForFunction(() => /Largest [0-9]/.test(document.querySelector('.force').textContent));
});

test('a server that falls silent is said to be lost within 5 s, and found again', options, async () => {
  const server = await site.serve(...live(), '--port', '0');
  try {
    const {page, close} = await site.open(browser, server.url);
    const state = (name) => page.waitForSelector(`#connection[data-state=${name}]`);
    await state('live');
    await page.keyboard.press('k');
    const sent = [];
    page.on('websocket', (socket) => socket.on('framesent', ({payload}) => sent.push(payload)));
    let took_s = Infinity;
    for (let n = 0; n < 3 && took_s >= 5; ++n) {   // a busy computer may be late
      server.signal('SIGSTOP');
      const begin = performance.now();
      await state('lost');
      took_s = (performance.now() - begin) / 1000;
      assert.ok(await page.locator('#notice').isVisible());
      server.signal('SIGCONT');
      await state('live');
      assert.ok(await page.locator('#notice').isHidden());
    }
    assert.ok(took_s < 5, `${took_s} s`);
    assert.ok(sent.length > 0 && sent.every((request) => request === '{"force":true}'), `${sent} asks for forces again`);
    await close();
  } finally {
    server.signal('SIGCONT');
    await server.stop();
  }
});

test('machines of which nothing is heard look so, also when it is the page that lost its connection', options, async () => {
  const server = await site.serve(...yard(), '--port', '0');
  try {
    const {page, close} = await site.open(browser, server.url);
    const state = (name) => page.waitForSelector(`#connection[data-state=${name}]`);
    const fed = `${server.url.split('#')[0]}feed?token=sesame`, ground = [0, 0, 0, 1];
    const marks = () => page.evaluate(() => [...document.querySelectorAll('.tag:not([hidden])')].map((tag) => [tag.title, /no link/.test(tag.textContent), /no link/.test(tag.getAttribute('aria-label'))]));
    const rows = () => page.evaluate(() => [...document.querySelectorAll('#machine-table tbody tr')].map((row) => /no link/.test(row.textContent)));
    await page.evaluate((url) => new Promise((resolve) => {
      window.feed = new WebSocket(url);
      window.feed.onmessage = resolve;
      let time = 0;
      const send = () => window.feed.send(JSON.stringify({machine: 'dozer 2', time: time += 0.5, position: [3, 3, 4], rotation: [0, 0, 0, 1]}));
      window.feed.onopen = () => { send(); window.sending = setInterval(send, 500); };
    }), fed.replace('http', 'ws'));
    await breakOff(fed, {machine: 'digger', position: [0, 0, 4], rotation: ground});
    await page.waitForFunction(() => /no link/.test(document.querySelector('.tag[title=digger]').textContent));
    assert.deepEqual(await marks(), [['dozer 2', false, false], ['digger', true, true]]);
    assert.deepEqual(await rows(), [false, false, false, true]);
    assert.match(await page.textContent('#totals'), /Working1 of 4/);
    await state('live');

    await page.evaluate(() => { clearInterval(window.sending); window.feed.close(); });
    await breakOff(fed, {machine: 'dozer 2', position: [3, 3, 4], rotation: ground});
    await state('lost');   // of all that were fed nothing is heard
    assert.equal(await page.textContent('#connection-text'), 'No feed');
    assert.match(await page.textContent('#totals'), /Working0 of 4/);
    await page.evaluate((url) => new Promise((resolve) => {
      window.feed = new WebSocket(url);
      window.feed.onmessage = resolve;
      window.feed.onopen = () => ['dozer 2', 'digger'].forEach((machine) => window.feed.send(JSON.stringify({machine, position: [3, 3, 5], rotation: [0, 0, 0, 1]})));
    }), fed.replace('http', 'ws'));
    await state('live');

    const controls = page.locator('#time :is(button, input)'), liveButton = page.getByLabel('Show the ground as it is now');
    assert.equal(await liveButton.getAttribute('aria-pressed'), 'true');
    server.signal('SIGSTOP');
    await page.waitForFunction(() => document.querySelector('#connection-text').textContent === 'Not connected');
    const shown = await page.textContent('#time-now');
    assert.deepEqual(await marks(), [['dozer 2', true, true], ['digger', true, true]]);
    assert.deepEqual(await rows(), [false, true, false, true], 'of others nothing was ever heard');
    for (const control of await controls.all()) assert.ok(await control.isDisabled());
    assert.equal(await liveButton.getAttribute('aria-pressed'), 'false');
    for (const key of ['[', 'l', 'a']) await page.keyboard.press(key);
    assert.equal(await page.textContent('#time-now'), shown, 'no other time can be shown');
    assert.equal(await page.textContent('#compare'), 'Compare');
    server.signal('SIGCONT');
    await page.waitForFunction(() => document.querySelector('#connection-text').textContent !== 'Not connected');
    for (const control of await controls.all()) assert.ok(await control.isEnabled());
    assert.equal(await liveButton.getAttribute('aria-pressed'), 'true');
    await close();
  } finally {
    server.signal('SIGCONT');
    await server.stop();
  }
});

looking('a time is loading until its ground is there, and a lost connection leaves what is shown', recorded, async (page) => {
  let held = null, socket = null;   // held: messages of blocks that wait
  await page.routeWebSocket(/\/view/, (route) => {
    socket = route;
    const server = route.connectToServer();
    server.onMessage((message) => {
      if (held && (typeof message !== 'string' || JSON.parse(message).type === 'whole')) held.push(message);
      else route.send(message);
    });
  });
  await page.reload();
  await site.settled(page);
  const said = (text) => page.waitForFunction((words) => document.querySelector('#connection-text').textContent === words, text);
  const busy = () => page.getAttribute('#time', 'aria-busy');
  await said('Recorded');
  const end = await page.textContent('#time-now');
  held = [];
  await page.keyboard.press('[');
  await said('Loading');
  await page.waitForFunction((before) => document.querySelector('#time-now').textContent !== before, end);
  assert.equal(await busy(), 'true');
  while (held.length === 0) await page.waitForTimeout(20);   // the view has begun
  assert.equal(await page.textContent('#connection-text'), 'Loading');
  for (const message of held.splice(0)) socket.send(message);
  held = null;
  await said('Past');
  assert.equal(await busy(), 'false');
  const shown = await page.textContent('#time-now');
  held = [];
  await page.keyboard.press('[');
  await said('Loading');
  await socket.close();
  await said('Not connected');
  assert.equal(await page.textContent('#time-now'), shown);
  held = null;
  await said('Past');
  assert.equal(await page.textContent('#time-now'), shown);
});

test('a clock that was at 0 first and then counts from 1970 has a slider over the latter', options, async () => {
  const server = await site.serve(...live(), '--port', '0'), now = 1.7e9;
  try {
    const {page, close} = await site.open(browser, server.url);
    await scoop(page, 0, 0, 0, 0.3);
    await scoop(page, now, 0, 2, 0.3).catch(() => {});   // only the first state of a jump is refused
    await page.waitForFunction((s) => document.querySelector('#time-now').textContent.includes(new Date(1000 * s).toLocaleDateString(undefined, {dateStyle: 'short'})), now);
    const half = await page.locator('.slider input').evaluate((input) => {
      input.value = input.max / 2;
      input.dispatchEvent(new Event('input'));
      return document.querySelector('#time-now').textContent;
    });
    const half_s = await page.evaluate((text) => Date.parse(text) / 1000, half);
    assert.ok(half_s > now - 86400 && half_s <= now + 2, half);
    await close();
  } finally {
    await server.stop();
  }
});

test('level ground on a contour has one colour and few triangles', options, async () => {
  const server = await site.serve(...live(), '--port', '0');   // at 2 m, with a line every 10 cm
  try {
    const {page, said, close} = await site.open(browser, server.url, {deviceScaleFactor: 1});
    await page.selectOption('[aria-label="Colour by"]', 'height');
    for (const key of ['f', 't']) {
      await page.keyboard.press(key);
      await site.drawn(page);
      await site.settled(page);
      const pixels = await site.pixelsIn(page, {x: 200, y: 250, width: 150, height: 100});
      const most = (channel) => pixels.reduce((a, p) => Math.max(a, p[channel]), 0), least = (channel) => pixels.reduce((a, p) => Math.min(a, p[channel]), 255);
      for (const channel of [0, 1, 2]) assert.ok(most(channel) - least(channel) <= 2, `${least(channel)} to ${most(channel)} after ${key}`);
    }
    const {tiles, triangles} = await page.evaluate(() => window.soilvdb.terrain());
    assert.ok(triangles <= 10 * tiles, `${triangles} triangles of ${tiles} level tiles`);
    assert.deepEqual(said, []);
    await close();
  } finally {
    await server.stop();
  }
});

test('without the token the page says that it wants one', options, async () => {
  const server = await site.serve(...live(), '--port', '0');
  const context = await browser.newContext();
  try {
    const page = await context.newPage();
    await page.goto(new URL('/', server.url).href);
    await page.waitForFunction(() => /token/.test(document.getElementById('notice-text').textContent));
  } finally {
    await context.close();
    await server.stop();
  }
});

/** Feeds a state, when nobody else feeds its machine any more, and breaks off without a goodbye. */
async function breakOff(url, state) {
  const line = Buffer.from(JSON.stringify(state));
  const headers = {Connection: 'Upgrade', Upgrade: 'websocket', 'Sec-WebSocket-Version': '13', 'Sec-WebSocket-Key': Buffer.alloc(16).toString('base64')};
  for (let answer = 'fed by'; answer.includes('fed by');) {
    const [, socket, head] = await once(http.get(url, {headers}), 'upgrade');
    socket.write(Buffer.concat([Buffer.from([0x81, 0x80 | line.length, 0, 0, 0, 0]), line]));
    answer = String(head.length > 0 ? head : (await once(socket, 'data'))[0]);
    socket.destroy();
  }
}

test('alarms are shown while they last', options, async () => {
  fs.writeFileSync(path.join(work, 'edge.csv'), '-2,-2\n2,-2\n2,2\n-2,2\n');
  const server = await site.serve(...live(), '--port', '0', '--boundary', path.join(work, 'edge.csv'));
  try {
    const {page, close} = await site.open(browser, server.url);
    const go = (x) => page.evaluate((x0) => new Promise((resolve) => {
      window.feed ??= new WebSocket(`${location.href.replace('http', 'ws').split('#')[0]}feed?token=sesame`);
      const send = () => window.feed.send(JSON.stringify({machine: 'digger', position: [x0, 0, 4], rotation: [0, 0, 0, 1]}));
      window.feed.onmessage = () => resolve();
      if (window.feed.readyState === WebSocket.OPEN) send();
      else window.feed.onopen = send;
    }), x);
    await go(0);
    await go(5);
    await page.waitForFunction(() => /digger: it is 3\.0 m outside the boundary/.test(document.getElementById('alarms').textContent));
    assert.ok(await page.isVisible('#alarms'));
    await go(1);
    await page.waitForFunction(() => !/outside/.test(document.getElementById('alarms').textContent));
    const table = (words) => page.waitForFunction((text) => document.querySelector('#machines').textContent.includes(text), words);
    await table('\u25cf working');
    await page.evaluate(() => window.feed.close());
    await breakOff(`${server.url.split('#')[0]}feed?token=sesame`, {machine: 'digger', position: [0, 0, 5], rotation: [0, 0, 0, 1]});
    await table('no link');
    await page.waitForFunction(() => /its connection broke off/.test(document.getElementById('alarms').textContent));
    await close();
  } finally {
    await server.stop();
  }
});

test('a measure with a name is seen by all, moved, asked for its progress, shared by a link, and removed for all', options, async () => {
  const [scenario, ...rest] = live(), design = path.join(work, 'design.asc');
  fs.writeFileSync(design, `ncols 20\nnrows 20\nxllcorner -10\nyllcorner -10\ncellsize 1\n${`${Array(20).fill(1.7).join(' ')}\n`.repeat(20)}`);
  const server = await site.serve(scenario, ...rest, '--view-token', 'looks', '--design', design, '--port', '0');
  assert.match(server.url, /#token=looks$/);
  const ask = async (what) => (await fetch(new URL(`${what}${what.includes('?') ? '&' : '?'}token=looks`, server.url))).json();
  const kept = async () => (await ask('measures')).measures;
  const pages = [];
  const opened = async (address) => {
    const made = await site.open(browser, address);
    pages.push(made);
    return made.page;
  };
  const named = (page, names) => page.waitForFunction((all) =>
    JSON.stringify([...document.querySelectorAll('#named button span')].map((e) => e.textContent)) === all, JSON.stringify(names));
  try {
    const office = await opened(server.url.replace('looks', 'sesame'));
    await scoop(office, 0, 0, 0, 0.3);
    await site.drawnBelow(office, [0.6, 0], 1.9);
    await site.drawn(office);   // the camera is at the work
    await office.keyboard.press('g');
    await office.keyboard.press('t');
    await site.drawn(office);
    await site.settled(office);
    await office.keyboard.press('b');
    for (const corner of [[-0.5, -0.5], [1.5, -0.5], [1.5, 0.5], [-0.5, 0.5]]) await site.clickAt(office, corner);
    await office.keyboard.press('Enter');
    await office.getByText('Name and keep').click();
    await office.keyboard.type('  Pit <A> ');
    await office.keyboard.press('Enter');
    await named(office, ['Pit <A>']);
    const [made] = await kept();
    assert.equal(made.points.length, 4);
    await office.evaluate(() => Object.defineProperty(navigator, 'clipboard', {value: {writeText: async (text) => { window.copied = text; }}}));
    await office.getByText('Copy link').click();
    const link = await office.waitForFunction(() => window.copied).then((text) => text.jsonValue());
    assert.equal(link, `${server.url.split('#')[0]}#measure=${made.id}&token=looks`, 'never with the token of feeds');

    const guest = await opened(link), card = guest.locator('.card', {hasText: 'Pit <A>'});
    await named(guest, ['Pit <A>']);
    await card.locator('.cut dd').first().waitFor();
    await guest.waitForFunction(([x, y]) => {
      const at = window.soilvdb.project([x, y, window.soilvdb.height(x, y)]), canvas = document.querySelector('#canvas').getBoundingClientRect();
      return at && Math.hypot(at[0] - canvas.left - canvas.width / 2, at[1] - canvas.top - canvas.height / 2) < canvas.height / 3;
    }, [0.6, 0]);
    assert.equal(await card.getByText('Edit').count(), 0, 'who may only look changes nothing');
    await card.locator('.progress summary').click();
    await card.locator('.progress svg').waitFor();
    const [progress] = (await ask(`progress?measure=${made.id}`)).areas;
    assert.ok(progress.done !== 0 && progress.done < 1);
    assert.equal(await card.locator('.progress dd').first().textContent(), `${(100 * progress.done).toFixed(0)}\u2009%`);
    assert.match(await card.locator('.progress').textContent(), /m³/);
    await guest.click('#units summary');
    await guest.selectOption('#unit-list [aria-label=Volumes]', 'yd3');
    assert.match(await card.locator('.progress').textContent(), /yd³/);
    assert.doesNotMatch(await card.locator('.progress').textContent(), /m³/);
    await guest.keyboard.press('Escape');

    await office.locator('.actions').getByText('Edit').click();
    const pixelOf = (page, [x, y]) => page.evaluate(([u, v]) => window.soilvdb.project([u, v, window.soilvdb.height(u, v)]), [x, y]);
    await site.settled(office);
    await office.mouse.move(...(await pixelOf(office, made.points[2])));
    await office.mouse.down();
    await office.mouse.move(...(await pixelOf(office, [1.8, 0.7])), {steps: 4});
    await office.mouse.up();
    await office.locator('.edit summary').click();
    const north = office.getByLabel('N of point 1'), metres = await north.inputValue();
    await office.click('#units summary');
    await office.selectOption('#unit-list [aria-label=Lengths]', 'ft');
    await office.keyboard.press('Escape');
    await office.waitForFunction((m) => Math.abs(document.querySelector('[aria-label="N of point 1"]').value * 0.3048 - m) < 1e-4, Number(metres));
    await north.fill('-2.5');
    const {query} = await site.answerTo(guest, '/volume', () => office.locator('.edit').getByText('Save').click());
    const [moved] = await kept();
    assert.deepEqual([moved.points[1], moved.points[3], moved.id], [made.points[1], made.points[3], made.id]);
    assert.ok(Math.hypot(moved.points[2][0] - 1.8, moved.points[2][1] - 0.7) < 0.05, `${moved.points[2]} was dragged there`);
    assert.ok(Math.abs(moved.points[0][1] + 2.5 * 0.3048) < 1e-9);
    assert.equal(query.get('boundary'), moved.points.flat().map((v) => v.toFixed(4)).join(), 'who looks has the new figures');

    await office.locator('.actions').getByText('Edit').click();
    await office.locator('.edit').getByText('Delete').click();
    await office.getByText('Delete for all').click();
    for (const page of [office, guest]) await named(page, []);
    assert.equal(await card.count(), 0);
    assert.deepEqual(await kept(), []);
    for (const {said} of pages) assert.deepEqual(said, []);
  } finally {
    for (const {close} of pages) await close();
    await server.stop();
  }
});

test('what is asked without a connection is asked again, and done when it is back', options, async () => {
  const [scenario, ...rest] = live(), design = path.join(work, 'level.asc');
  fs.writeFileSync(design, `ncols 20\nnrows 20\nxllcorner -10\nyllcorner -10\ncellsize 1\n${`${Array(20).fill(1.7).join(' ')}\n`.repeat(20)}`);
  const server = await site.serve(scenario, ...rest, '--design', design, '--port', '0');
  try {
    const {page, close} = await site.open(browser, server.url), context = page.context();
    const named = async () => (await (await fetch(new URL('measures?token=sesame', server.url))).json()).measures.map(({name}) => name);
    const words = (part) => page.waitForFunction((selector) => /No connection; it will be asked again/.test(document.querySelector(selector)?.textContent), part);
    await scoop(page, 0, 0, 0, 0.3);
    await site.drawnBelow(page, [0.6, 0], 1.9);
    await page.keyboard.press('g');
    await page.keyboard.press('t');
    await site.drawn(page);
    await page.keyboard.press('b');
    for (const corner of [[-0.5, -0.5], [1.5, -0.5], [1.5, 0.5]]) await site.clickAt(page, corner);
    await site.answerTo(page, '/volume', () => page.keyboard.press('Enter'));

    await context.setOffline(true);   // new connections are; that of the view may last
    await page.getByText('Name and keep').click();
    await page.keyboard.type('pit');
    await page.keyboard.press('Enter');
    await words('.edit .error');
    assert.deepEqual(await named(), []);
    await context.setOffline(false);
    await page.waitForSelector('.edit', {state: 'detached'});
    assert.deepEqual(await named(), ['pit']);

    await context.setOffline(true);
    await page.locator('.progress summary').click();
    await words('.progress .error');
    await page.keyboard.press('h');
    await site.clickAt(page, [0.6, 0]);
    await words('.card[data-kind=height] .error');
    await context.setOffline(false);
    await page.locator('.progress dd').first().waitFor();
    await page.locator('.card[data-kind=height] dd').first().waitFor();
    assert.equal(await page.locator('.error:visible').count(), 0);
    await close();
  } finally {
    await server.stop();
  }
});

test('below a path the page, its streams, queries and downloads are there', options, async () => {
  const server = await site.serve(...live(), '--port', '0', '--base-path', '/dig');
  try {
    assert.equal(new URL(server.url).pathname, '/dig/');
    const {page, said, close} = await site.open(browser, server.url.replace('/dig/', '/dig'));   // is sent on
    await scoop(page, 0, 0, 0, 0.3);
    const heightAt = async (x, y) => (await fetch(new URL(`height?x=${x}&y=${y}&token=sesame`, server.url))).json();
    const truth = await heightAt(0.6, 0);
    assert.ok(truth.height_m < 2 - 0.1);
    await page.waitForFunction(([z, most]) => Math.abs(window.soilvdb.height(0.6, 0) - z) < most, [truth.height_m, kHalfVoxel_m]);
    await page.keyboard.press('h');
    const {query, json} = await site.answerTo(page, '/dig/height', () => site.clickAt(page, [0.6, 0]));
    assert.deepEqual(json, await heightAt(query.get('x'), query.get('y')));
    for (const link of await page.locator('#download-list a').evaluateAll((all) => all.map((a) => a.href))) {
      assert.match(link, /\/dig\/([a-z]+\.[a-z]+|report)\?token=sesame$/);
    }
    assert.deepEqual(said, []);
    await close();
  } finally {
    await server.stop();
  }
});

test('behind a proxy that keeps the host to itself the page says what to set', options, async () => {
  const [scenario, ...rest] = live(), server = await site.serve(scenario, ...rest.slice(0, 2), '--port', '0');
  const {host, port} = new URL(server.url);
  const proxy = http.createServer(({url, method, headers}, answer) => {
    http.request({port, path: url, method, headers: {...headers, host}}, (told) => {
      answer.writeHead(told.statusCode, told.headers);
      told.pipe(answer);
    }).end();
  }).on('upgrade', (_, socket) => socket.destroy());
  await new Promise((resolve) => proxy.listen(0, '127.0.0.1', resolve));
  const context = await browser.newContext();
  try {
    const page = await context.newPage();
    await page.goto(`http://127.0.0.1:${proxy.address().port}/`);
    await page.waitForFunction(() => /pass the Host header on.*give --token/.test(document.getElementById('notice-text').textContent));
  } finally {
    await context.close();
    proxy.close();
    await server.stop();
  }
});

test('a site of a square kilometre with a post each metre is soon there', options, async () => {
  // Not for the figures, which need a graphics card: that coarse ground comes first, and all of it.
  const rows = Array.from({length: 1000}, (_, j) => Array.from({length: 1000}, (_, i) => (400 + 9 * Math.sin(i / 90) + 7 * Math.cos(j / 70)).toFixed(2)).join(' '));
  fs.writeFileSync(path.join(work, 'wide.asc'), `ncols 1000\nnrows 1000\nxllcorner 500000\nyllcorner 5400000\ncellsize 1\n${rows.join('\n')}\n`);
  fs.writeFileSync(path.join(work, 'wide.yaml'), `soilvdb: 1
voxel_size: 0.05
terrain: {raster: wide.asc}
machines:
  - {name: digger, bucket: {width: 0.8, height: 0.6}}
`);
  const server = await site.serve(path.join(work, 'wide.yaml'), '--out', path.join(work, 'wide'), '--port', '0');
  try {
    const {page, said, close} = await site.open(browser, server.url);
    assert.equal(await page.locator('#force').count(), 0, 'rigid soil has no force');
    const far = await page.evaluate(() => window.soilvdb.terrain().tiles);
    for (let n = 0; n < 30; ++n) await page.mouse.wheel(0, -200);
    await site.settled(page);
    const {bounds} = (await page.evaluate(() => window.soilvdb.site())).terrain;
    for (const share of [0.1, 0.5, 0.77]) {
      const x = bounds[0] + share * (bounds[2] - bounds[0]), y = bounds[1] + (1 - share) * (bounds[3] - bounds[1]);
      const {height_m} = await (await fetch(`${server.url}height?x=${x}&y=${y}`)).json();
      const drawn = await page.evaluate(([u, v]) => window.soilvdb.height(u, v), [x, y]);
      assert.ok(Math.abs(drawn - height_m) < 0.2, `${drawn} is drawn at ${height_m}`);   // at most 4 m posts: 16 / 8 x the curvature
    }
    assert.ok(far >= 1);
    assert.deepEqual(said, []);
    await close();
  } finally {
    await server.stop();
  }
});

test('the pictures in README are those of this version', options, async () => {
  const {state_hash: hash} = JSON.parse(fs.readFileSync(path.join(done, 'summary.json'), 'utf8'));
  const again = 'take them again: node tests/view/pictures.mjs';
  assert.ok(fs.readFileSync(path.join(site.root, 'data/README.md'), 'utf8').includes(hash), `the excavator leaves other ground now, ${hash}; ${again}`);
  const same = (name) => pictures.same(browser, path.join(site.root, 'data', name), path.join(work, name));
  pictures.view(done, path.join(work, 'excavator.png'));
  assert.ok(await same('excavator.png'), `data/excavator.png shows something else; ${again}`);
  let shown = false;
  for (let n = 0; n < 3 && !shown; ++n) {   // a busy computer may draw late
    await pictures.live(browser, work, path.join(work, 'live.png'));
    shown = await same('live.png');
  }
  assert.ok(shown, `data/live.png shows something else; ${again}`);
});
