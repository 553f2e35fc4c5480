// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The pictures in README. `node tests/view/pictures.mjs` takes them again.
import fs from 'node:fs';
import path from 'node:path';
import {fileURLToPath} from 'node:url';
import * as site from './site.mjs';

const data = path.join(site.root, 'data');
const kUntil_s = 63;
const kBoundary = [[512342, 5403637.4], [512349, 5403637.4], [512349, 5403641.2], [512342, 5403641.2]];
const kSection = [[512345.2, 5403641.8], [512345.2, 5403633.4]];
const kSide = 16;             // of a tile that is compared, pixels
const kUnlike = 8;            // mean difference of a tile that differs, of 255
const kMostUnlike = 0.003;    // share of tiles; a machine that went idle meanwhile has 0.0014

/** README's excavator in perspective: view.png of a run of data/excavator.yaml. */
export function view(run, file) {
  site.run('export', path.join(run, 'soil_final.vdb'), '--to', file, '--view', 'perspective');
}

/** README's live page: the excavator after its first 63 s, with a boundary and a section. */
export async function live(browser, folder, file) {
  for (const name of ['excavator.yaml', 'excavator.urdf', 'hills.tif']) fs.copyFileSync(path.join(data, name), path.join(folder, name));
  const [head, ...rows] = fs.readFileSync(path.join(data, 'excavator.csv'), 'utf8').trim().split('\n');
  fs.writeFileSync(path.join(folder, 'excavator.csv'), `${[head, ...rows.filter((row) => parseFloat(row) <= kUntil_s)].join('\n')}\n`);
  const server = await site.serve(path.join(folder, 'excavator.yaml'), '--speed', '1000', '--port', '0');
  try {
    const {page, close} = await site.open(browser, server.url, {viewport: {width: 1440, height: 900}, deviceScaleFactor: 1});
    await page.waitForFunction((end) => document.querySelector('#time-now').textContent === end, '1:03.0');
    await site.settled(page);   // all that was dug is in the picture
    await page.click('#work');
    await site.settled(page);
    await page.keyboard.press('b');
    for (const corner of [...kBoundary, kBoundary[0]]) await site.clickAt(page, corner);
    await page.waitForSelector('.card[data-kind=boundary] .cut dd');
    await page.keyboard.press('s');
    for (const end of kSection) await site.clickAt(page, end);
    await page.waitForSelector('.card[data-kind=section] svg.chart');
    await page.keyboard.press('Escape');
    await page.mouse.move(720, 890);
    await page.evaluate(() => document.activeElement.blur());
    await site.settled(page);
    await page.waitForFunction(() => {   // pictures are sharp again a while after the last movement
      const canvas = document.querySelector('#canvas');
      return canvas.width === canvas.clientWidth;
    });
    await page.evaluate(async () => {   // what is drawn is shown some frames later where there is no graphics card
      for (let n = 0; n < 20; ++n) await new Promise(requestAnimationFrame);
    });
    await page.screenshot({path: file});
    await close();
  } finally {
    await server.stop();
  }
}

/** Do two pictures show the same? Tiles are compared by their means, because fonts differ a little by system. */
export async function same(browser, a, b) {
  const page = await browser.newPage();
  const unlike = await page.evaluate(async ([pngs, side, most]) => {
    const [p, q] = await Promise.all(pngs.map(async (png) => {
      const image = new Image();
      image.src = `data:image/png;base64,${png}`;
      await image.decode();
      const canvas = new OffscreenCanvas(image.width, image.height), draw = canvas.getContext('2d');
      draw.drawImage(image, 0, 0);
      return draw.getImageData(0, 0, image.width, image.height);
    }));
    if (p.width !== q.width || p.height !== q.height) return 1;
    let tiles = 0, others = 0;
    for (let y0 = 0; y0 + side <= p.height; y0 += side) {
      for (let x0 = 0; x0 + side <= p.width; x0 += side, ++tiles) {
        let sum = 0;
        for (let y = y0; y < y0 + side; ++y) {
          for (let i = 4 * (y * p.width + x0); i < 4 * (y * p.width + x0 + side); ++i) sum += Math.abs(p.data[i] - q.data[i]);
        }
        if (sum > most * 3 * side * side) ++others;
      }
    }
    return others / tiles;
  }, [[a, b].map((file) => fs.readFileSync(file).toString('base64')), kSide, kUnlike]);
  await page.close();
  return unlike < kMostUnlike;
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const folder = site.folder(), browser = await site.browser();
  site.run('run', path.join(data, 'excavator.yaml'), '--out', path.join(folder, 'run'), '--no-mesh');
  view(path.join(folder, 'run'), path.join(data, 'excavator.png'));
  await live(browser, folder, path.join(data, 'live.png'));
  await browser.close();
  console.log(`state_hash for data/README.md: ${JSON.parse(fs.readFileSync(path.join(folder, 'run/summary.json'), 'utf8')).state_hash}`);
  fs.rmSync(folder, {recursive: true});
}
