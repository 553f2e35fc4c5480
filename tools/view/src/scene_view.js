// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The picture: camera, light, and navigation by mouse, touch and keys. It is redrawn only after
// changes.
import {AmbientLight, DirectionalLight, MOUSE, PerspectiveCamera, Raycaster, Scene, TOUCH, Vector2, Vector3, WebGLRenderer} from 'three';
import {MapControls} from 'three/addons/controls/MapControls.js';

const kFlight_ms = 700;
const kNearest_m = 6, kFits = 12, kMargin = 0.8;   // of the fit to places: distance, attempts, and their share of the room
const kSlow_ms = 90, kStill_ms = 400;   // between pictures
const kCoarsest = 0.35;   // pixels of pictures that move, per pixel
const calm = matchMedia('(prefers-reduced-motion: reduce)');

export class SceneView {
  scene = new Scene();
  camera = new PerspectiveCamera(42, 1, 0.1, 5000);
  /** Called before each picture with its time in ms; returns whether another picture must follow. */
  beforeFrame = [];
  /** Called before a picture is drawn, with the camera in its place. */
  beforeRender = [];
  /** Called after a picture was drawn. */
  afterFrame = [];
  frames = 0;
  #dirty = true;
  #flight = null;
  #keys = new Set();
  #lastTime = 0;
  #frameAt = 0;
  #drawnAt = 0;
  #moving = false;
  #slow = 0;
  #sharpness = 1;    // while something moves
  #drawnSharp = 1;   // of the last picture

  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({canvas, antialias: true, alpha: true, powerPreference: 'high-performance'});
    this.renderer.setClearAlpha(0);
    this.camera.up.set(0, 0, 1);
    this.scene.add(new AmbientLight(0xb8c0cc, 1.4));
    const sun = new DirectionalLight(0xfff4e0, 2.2);
    sun.position.set(-0.48, 0.31, 0.82);
    this.scene.add(sun);
    this.controls = new MapControls(this.camera, canvas);
    Object.assign(this.controls, {zoomToCursor: true, maxPolarAngle: 0.49 * Math.PI, enableDamping: false, zoomSpeed: 1.4});
    this.controls.mouseButtons = {LEFT: MOUSE.PAN, MIDDLE: MOUSE.ROTATE, RIGHT: MOUSE.ROTATE};
    this.controls.touches = {ONE: TOUCH.PAN, TWO: TOUCH.DOLLY_ROTATE};
    this.controls.addEventListener('change', () => this.changed());
    this.controls.addEventListener('start', () => { this.#flight = null; });
    new ResizeObserver(() => this.#resize()).observe(canvas.parentElement);
    this.#listenToKeys();
    this.#resize();
    this.renderer.setAnimationLoop((time) => this.#frame(time));
  }

  changed() {
    this.#dirty = true;
  }

  #resize() {
    const {clientWidth, clientHeight} = this.canvas.parentElement, before = this.height;
    this.width = Math.max(1, clientWidth);
    this.height = Math.max(1, clientHeight);
    this.renderer.setPixelRatio(this.#drawnSharp * Math.min(2, devicePixelRatio));
    this.renderer.setSize(this.width, this.height, false);
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
    if (before) this.#scale(this.height / before);   // metres per pixel stay
    this.changed();
  }

  /** Moves the camera away from its target. */
  #scale(by) {
    const flown = this.#flight ? [this.#flight.from, this.#flight.to] : [];
    for (const {target, position} of [{target: this.controls.target, position: this.camera.position}, ...flown]) position.sub(target).multiplyScalar(by).add(target);
  }

  #frame(time) {
    const step_s = Math.min(0.1, (time - this.#lastTime) / 1000);
    this.#lastTime = time;
    if (this.#keys.size > 0) this.#move(step_s);
    if (this.#flight) this.#fly(time);
    let again = false;
    for (const work of this.beforeFrame) again = work(time) || again;
    if (again) this.#dirty = true;
    this.#suitSpeed(time);
    if (!this.#dirty) return;
    this.#dirty = false;
    const distance = this.distance;
    this.camera.near = Math.max(0.02, 0.004 * distance);
    this.camera.far = 30 * distance + 3 * (this.size_m ?? 100);
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    for (const work of this.beforeRender) work();
    this.renderer.render(this.scene, this.camera);
    ++this.frames;
    for (const work of this.afterFrame) work();
  }

  /** If drawing is slow, pictures are coarser during movement, and sharp at rest. */
  #suitSpeed(time) {
    const gap = time - this.#frameAt, moving = this.#moving;
    this.#frameAt = time;
    this.#moving = this.#dirty;
    if (!this.#dirty) {
      if (this.#drawnSharp < 1 && time - this.#drawnAt > kStill_ms) this.#sharpen(1);
      return;
    }
    this.#drawnAt = time;
    if (!moving) return;
    this.#slow = gap > kSlow_ms ? this.#slow + 1 : Math.max(0, this.#slow - 0.02);
    if (this.#slow >= 2) {
      this.#slow = 0;
      this.#sharpness = Math.max(kCoarsest, 0.7 * this.#sharpness);
    }
    if (this.#drawnSharp !== this.#sharpness) this.#sharpen(this.#sharpness);
  }

  #sharpen(sharpness) {
    this.#drawnSharp = sharpness;
    this.renderer.setPixelRatio(sharpness * Math.min(2, devicePixelRatio));
    this.#dirty = true;
  }

  get distance() {
    return this.camera.position.distanceTo(this.controls.target);
  }

  /** Looks at a place from a distance, from the present direction or from an azimuth and height. */
  lookAt(target, distance, {azimuth, elevation, now = false} = {}) {
    const from = this.camera.position.clone().sub(this.controls.target);
    if (azimuth !== undefined) {
      from.set(-Math.sin(azimuth) * Math.cos(elevation), -Math.cos(azimuth) * Math.cos(elevation), Math.sin(elevation));
    }
    const to = {target: target.clone(), position: target.clone().addScaledVector(from.normalize(), distance)};
    if (now || calm.matches) this.#place(to.target, to.position);
    else this.#flight = {from: {target: this.controls.target.clone(), position: this.camera.position.clone()}, to, start: null};
    this.changed();
  }

  /** Looks at places, from the present direction, so that they are in a part of the picture. @param {Object} box pixels */
  lookAtAll(places, {left, top, right, bottom}) {
    const camera = this.camera.clone(), target = new Vector3(), from = this.camera.position.clone().sub(this.controls.target).normalize();
    for (const p of places) target.addScaledVector(p, 1 / places.length);
    const size = Math.max(...places.map((p) => p.distanceTo(target)));
    const right_m = new Vector3(-from.y, from.x, 0).normalize(), ahead_m = new Vector3(-right_m.y, right_m.x, 0);
    let distance = Math.max(kNearest_m, 3.5 * size);
    for (let n = 0; n < kFits; ++n) {
      camera.position.copy(target).addScaledVector(from, distance);
      camera.updateMatrixWorld();
      const px = places.map((p) => this.project(p, camera) ?? [0, 0]), at = [0, 1].map((axis) => px.map((p) => p[axis]));
      const [low, high] = [at.map((all) => Math.min(...all)), at.map((all) => Math.max(...all))];
      const by = this.pixelAt_m(target, camera);
      target.addScaledVector(right_m, ((low[0] + high[0] - left - right) / 2) * by)
        .addScaledVector(ahead_m, (((top + bottom - low[1] - high[1]) / 2) * by) / Math.max(0.1, from.z));
      const room = Math.min((right - left) / (high[0] - low[0] + 1), (bottom - top) / (high[1] - low[1] + 1));
      distance = Math.max(kNearest_m, distance / Math.min(2, kMargin * room));
    }
    this.lookAt(target, distance);
  }

  #place(target, position) {
    this.controls.target.copy(target);
    this.camera.position.copy(position);
    this.controls.update();
  }

  #fly(time) {
    const flight = this.#flight;
    flight.start ??= time;
    const s = Math.min(1, (time - flight.start) / kFlight_ms), t = s * s * (3 - 2 * s);
    this.#place(flight.from.target.clone().lerp(flight.to.target, t), flight.from.position.clone().lerp(flight.to.position, t));
    if (s === 1 && this.#flight === flight) this.#flight = null;
    this.changed();
  }

  /** Moves camera and target together, to follow a machine. */
  shift(by) {
    if (by.lengthSq() === 0) return;
    this.controls.target.add(by);
    this.camera.position.add(by);
    if (this.#flight) {
      this.#flight.to.target.add(by);
      this.#flight.to.position.add(by);
    }
    this.changed();
  }

  #listenToKeys() {
    const kMoves = ['ArrowLeft', 'ArrowRight', 'ArrowUp', 'ArrowDown', '+', '=', '-', '_'];
    this.canvas.addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !kMoves.includes(event.key)) return;
      this.#keys.add((event.shiftKey && event.key.startsWith('Arrow') ? 'Shift' : '') + event.key);
      event.preventDefault();
    });
    const up = (event) => {
      this.#keys.delete(event.key);
      this.#keys.delete('Shift' + event.key);
      if (event.key === 'Shift') this.#keys.clear();
    };
    this.canvas.addEventListener('keyup', up);
    this.canvas.addEventListener('blur', () => this.#keys.clear());
  }

  #move(step_s) {
    const key = (name) => (this.#keys.has(name) ? 1 : 0);
    const {target} = this.controls, from = this.camera.position.clone().sub(target);
    const ahead = new Vector3(-from.x, -from.y, 0).normalize(), right = new Vector3(ahead.y, -ahead.x, 0);
    const pan = this.distance * 0.8 * step_s;
    const by = ahead.multiplyScalar((key('ArrowUp') - key('ArrowDown')) * pan)
      .addScaledVector(right, (key('ArrowRight') - key('ArrowLeft')) * pan);
    from.applyAxisAngle(this.camera.up, (key('ShiftArrowLeft') - key('ShiftArrowRight')) * 1.5 * step_s);
    const tilt = (key('ShiftArrowUp') - key('ShiftArrowDown')) * 1.0 * step_s;
    const polar = Math.acos(Math.min(1, from.z / from.length()));
    const side = new Vector3(from.y, -from.x, 0).normalize();
    const turn = Math.min(0.49 * Math.PI, Math.max(0.02, polar - tilt)) - polar;
    from.applyAxisAngle(side, -turn);
    from.multiplyScalar(Math.exp((key('-') + key('_') - key('+') - key('=')) * 1.6 * step_s));
    this.#flight = null;
    this.#place(target.clone().add(by), target.clone().add(by).add(from));
    this.changed();
  }

  /** The ray through a pixel of the canvas. */
  rayAt(x, y) {
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2((2 * x) / this.width - 1, 1 - (2 * y) / this.height), this.camera);
    return caster;
  }

  /** Pixel of a place in the scene; null behind the camera. */
  project(point, camera = this.camera) {
    const p = point.clone().applyMatrix4(camera.matrixWorldInverse);
    if (p.z > -camera.near) return null;
    p.applyMatrix4(camera.projectionMatrix);
    return [((p.x + 1) / 2) * this.width, ((1 - p.y) / 2) * this.height];
  }

  /** Metres of a pixel at the target. */
  get pixel_m() {
    return this.pixelAt_m(this.controls.target);
  }

  /** Metres of a pixel at a place in the scene. */
  pixelAt_m(place, camera = this.camera) {
    return (2 * Math.tan((camera.fov * Math.PI) / 360) * camera.position.distanceTo(place)) / this.height;
  }

  /** Direction of view, clockwise from north. */
  get azimuth() {
    const d = this.controls.target.clone().sub(this.camera.position);
    return Math.atan2(d.x, d.y);
  }
}
