// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A server of a site and a headless browser that looks at it.
import {execFileSync, spawn} from 'node:child_process';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import {createInterface} from 'node:readline';
import {fileURLToPath, pathToFileURL} from 'node:url';

export const root = fileURLToPath(new URL('../..', import.meta.url));
export const program = process.env.SOILVDB_PROGRAM ?? path.join(root, 'build/soilvdb');
const build = path.dirname(program);

function found(name) {
  return (process.env.PATH ?? '').split(':').map((folder) => path.join(folder, name)).find((file) => fs.existsSync(file));
}

const chromium = process.env.SOILVDB_CHROMIUM ?? found('chromium') ?? found('google-chrome');

/** Why nothing can be tested here, or null. */
export const missing =
  !chromium ? 'no chromium is installed'
  : !fs.existsSync(path.join(build, 'view/view.js')) ? 'the page was not built (tools/view/build)'
  : !fs.existsSync(path.join(root, 'build/view_npm/node_modules/playwright-core')) ? 'playwright-core was not installed (tools/view/build)'
  : null;

export function folder() {
  return fs.mkdtempSync(path.join(os.tmpdir(), 'soilvdb-view-'));
}

export function run(...args) {
  return execFileSync(program, args, {encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe']});
}

/** Python with the module, on code that prints JSON; null where it wasn't built. */
export function python(code) {
  const modules = path.join(build, 'python');
  if (!fs.existsSync(modules)) return null;
  return JSON.parse(execFileSync(process.env.SOILVDB_PYTHON ?? '/usr/bin/python3', ['-c', code], {encoding: 'utf8', env: {...process.env, PYTHONPATH: modules}}));
}

/** Starts `soilvdb serve`; {url, signal(), stop()}. */
export async function serve(...args) {
  const child = spawn(program, ['serve', ...args], {stdio: ['ignore', 'pipe', 'inherit']});
  const url = await new Promise((resolve, reject) => {
    createInterface({input: child.stdout}).once('line', resolve);
    child.once('exit', (status) => reject(new Error(`soilvdb serve ended with ${status}`)));
  });
  const ended = new Promise((resolve) => child.once('exit', resolve));
  return {url, signal: (name) => child.kill(name), stop: async (signal = 'SIGTERM') => {
    child.kill(signal);
    await ended;
  }};
}

export async function browser() {
  const playwright = await import(pathToFileURL(path.join(root, 'build/view_npm/node_modules/playwright-core/index.mjs')).href);
  return playwright.chromium.launch({
    executablePath: chromium,
    args: ['--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--no-sandbox'],
  });
}

/** Opens a site's page and waits until all of it is drawn; {page, said}: what it wrote to the console. */
export async function open(browser, url, options = {}) {
  const context = await browser.newContext({viewport: {width: 900, height: 600}, deviceScaleFactor: 0.5, reducedMotion: 'reduce', ...options});
  const page = await context.newPage(), said = [];
  page.setDefaultTimeout(60000);
  page.on('console', (message) => said.push(`${message.type()}: ${message.text()}`));
  page.on('pageerror', (error) => said.push(String(error)));
  await page.goto(url);
  await settled(page);
  return {page, said, close: () => context.close()};
}

export async function settled(page) {
  await page.waitForFunction(() => window.soilvdb?.terrain().settled && window.soilvdb.view().settled);
}

/** Waits until the ground is drawn at a place of the world, and lower than a height. */
export const drawnBelow = (page, place, most) => page.waitForFunction(([x, y, z]) => {
  const height = window.soilvdb.height(x, y);
  return height !== null && height < z;
}, [...place, most]);

/** Clicks on the ground where it is drawn at a place of the world. */
export async function clickAt(page, [x, y]) {
  const pixel = await page.evaluate(([u, v]) => {
    const z = window.soilvdb.height(u, v);
    return z === null ? null : window.soilvdb.project([u, v, z]);
  }, [x, y]);
  if (pixel === null) throw new Error(`no ground is drawn at ${x}, ${y}`);
  await page.mouse.click(pixel[0], pixel[1]);
}

/** Mean colour of some pixels where the ground is drawn at a place of the world: red, green, blue. */
export async function colorAt(page, [x, y]) {
  const [px, py] = await page.evaluate(([u, v]) => window.soilvdb.project([u, v, window.soilvdb.height(u, v)]), [x, y]);
  const pixels = await pixelsIn(page, {x: px - 4, y: py - 4, width: 9, height: 9});
  return [0, 1, 2].map((channel) => pixels.reduce((sum, pixel) => sum + pixel[channel] / pixels.length, 0));
}

/** All pixels of a part of the page: red, green, blue of each. */
export async function pixelsIn(page, clip) {
  const picture = await page.screenshot({clip});
  return page.evaluate(async (png) => {
    const image = new Image();
    image.src = `data:image/png;base64,${png}`;
    await image.decode();
    const draw = new OffscreenCanvas(image.width, image.height).getContext('2d');
    draw.drawImage(image, 0, 0);
    const {data} = draw.getImageData(0, 0, image.width, image.height);
    return Array.from({length: data.length / 4}, (_, i) => [...data.subarray(4 * i, 4 * i + 3)]);
  }, picture.toString('base64'));
}

/** Waits until a change of the page is drawn: sizes are known after one frame, the picture after the next. */
export const drawn = (page) => page.evaluate(() => new Promise((done) => {
  let frames = 4;
  const next = () => (--frames > 0 ? requestAnimationFrame(next) : done());
  next();
}));

/** The answer to the next query of a path that the page makes while something is done. */
export async function answerTo(page, what, action) {
  const [response] = await Promise.all([page.waitForResponse((r) => new URL(r.url()).pathname === what), action()]);
  return {query: new URL(response.url()).searchParams, json: await response.json()};
}
