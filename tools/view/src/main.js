// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The page: connects its parts after the server's description of the site.
import {Box3, Vector3} from 'three';
import * as api from './api.js';
import {$} from './dom.js';
import * as format from './format.js';
import {GroundPick} from './ground_pick.js';
import {GroundUniforms} from './ground_uniforms.js';
import {Controls, drawScale} from './controls.js';
import {designLines} from './design_lines.js';
import {Drape} from './drape.js';
import {Forces} from './forces.js';
import {fillHelp} from './help.js';
import {Legend} from './legend.js';
import {Link} from './link.js';
import {MachineTable} from './machine_table.js';
import {Machines} from './machines.js';
import {Overlay} from './overlay.js';
import {MeasureCards} from './measure_cards.js';
import {Measures} from './measures.js';
import {showScans} from './scans.js';
import {SceneView} from './scene_view.js';
import {SigmaLayer} from './sigma_layer.js';
import {hint, notice, openPanel, showAlarms, showConnection, showTotals, startDownloads, startPanels} from './surroundings.js';
import {boxOf, boxesOver, freeBox} from './tag_place.js';
import {Terrain} from './terrain.js';
import {startTheme} from './theme.js';
import {Timeline} from './timeline.js';
import {UnitsMenu} from './units_menu.js';
import {Views} from './views.js';
import {handle} from './test_handle.js';

/** The properties that identify a site; the page restarts if one changes. */
const identity = (site) => JSON.stringify([site.name, site.voxel_size_m, site.origin, site.terrain, site.machines, site.drape]);

class Page {
  comparing = new Set();   // views whose changes are since another time
  connected = true;

  /** @param {Object} site from the server @param {Link} link */
  constructor(site, link) {
    this.site = site;
    this.link = link;
    document.title = `${site.name} \u00b7 soilvdb`;
    $('site-name').textContent = $('site-name').title = site.name;
    const [xmin, ymin, xmax, ymax] = site.terrain.bounds, round = (v) => 1000 * Math.round(v / 1000);
    // Near the site, so that floats are precise; round, so that grid lines have round coordinates.
    this.origin = [round((xmin + xmax) / 2), round((ymin + ymax) / 2), 0];
    this.middle = new Vector3((xmin + xmax) / 2 - this.origin[0], (ymin + ymax) / 2 - this.origin[1], 0);
    this.size_m = Math.hypot(xmax - xmin, ymax - ymin);
    this.sceneView = new SceneView($('canvas'));
    this.sceneView.size_m = this.size_m;
    const changed = () => this.sceneView.changed();
    const resized = new ResizeObserver(changed);   // tags must avoid what is larger now
    for (const part of document.querySelectorAll('.notes, .foot, #legend')) resized.observe(part);
    this.uniforms = new GroundUniforms();
    this.uniforms.values.voxel_m.value = site.voxel_size_m;
    this.uniforms.values.clod_m.value = Math.max(site.voxel_size_m, 0.08);
    this.terrain = new Terrain(site, api.getBytes, this.origin, this.uniforms, () => {
      this.updateTerrain();   // prepares the next tiles independently of the drawing rate
      this.overlay?.drapeAgain();
      changed();
    });
    this.views = new Views({site, origin: this.origin, uniforms: this.uniforms, parent: this.sceneView.scene}, changed);
    const pick = (name) => this.follow(this.machines.following === name ? null : name);
    this.machines = new Machines(site, this.origin, this.sceneView, $('tags'), pick);
    this.sceneView.scene.add(this.terrain.group, this.machines.group);
    this.table = new MachineTable($('machine-table'), site, pick);
    this.sigmas = new SigmaLayer(this.origin, this.uniforms, changed, () => this.wantSigmas());
    this.legend = new Legend($('legend'), site, this.uniforms, () => {
      this.wantSigmas();
      changed();
    });
    this.drape = new Drape(site, this.origin, this.uniforms, changed);
    this.forces = new Forces(site, (force) => this.link.send({force}), (forces) => this.machines.showForces(forces));
    this.timeline = new Timeline($('time'), site.live, (time, against) => this.link.send({time, against}));
    this.pick = new GroundPick(this.sceneView, this.terrain, this.views);
    this.measures = new Measures(() => this.shownTimes(), () => this.measuresChanged());
    this.overlay = new Overlay($('marks'), this.sceneView, this.pick, this.measures, this.origin);
    this.cards = new MeasureCards(this.measures, site.design, (m, d) => this.overlay.pointAt(m, d), (m) => this.goToMeasure(m));
    this.controls = new Controls({
      sceneView: this.sceneView, pick: this.pick, overlay: this.overlay, measures: this.measures, origin: this.origin,
      fitSite: () => this.fitSite(), fitWork: () => this.fitWork(), begun: () => openPanel(null), done: () => openPanel('measures'), more: ([x, y]) => this.sigmaText(x, y),
      keys: {
        'c': () => this.legend.next(), 'k': () => this.forces.switch(!this.forces.on), 'o': () => this.drape.switch(!this.drape.on), 'l': () => this.timeline.show(null), 'a': () => this.timeline.toggleAgainst(),
        '[': () => this.timeline.step(-1), ']': () => this.timeline.step(1), '?': () => $('help').showModal(),
      },
    });
    this.fitSite(true);
    startDownloads(() => this.shownTimes().time);
    this.setTheme(document.documentElement.dataset.theme);
    new UnitsMenu(site, () => this.unitsChanged());
    $('stage').addEventListener('wheel', () => this.follow(null), {passive: true, capture: true});
    this.sceneView.controls.addEventListener('start', () => this.follow(null));
    this.sceneView.beforeFrame.push(() => this.beforeFrame());
    this.sceneView.beforeRender.push(() => this.beforeRender());
    this.sceneView.afterFrame.push(() => this.afterFrame());
    this.setTimes(site.times);
    if (site.lines) this.drawLines();
    this.measures.restore();
    handle(this);
  }

  async drawLines() {
    try {
      this.lines = designLines((await api.getJson('/lines')).lines, this.origin);
      this.sceneView.scene.add(this.lines);
      this.sceneView.changed();
    } catch (error) {
      hint(`The lines of the design did not come: ${error.message}`, 6);
    }
  }

  /** Shows everything again in other units. */
  unitsChanged() {
    for (const part of [this.legend, this.forces, this.controls]) part.unitsChanged();
    this.cards.refresh();
    fillHelp(this.site);
    if (this.live) showAlarms(this.live.alarms ?? []);
    if (this.shownState) this.showState(this.shownState, false);
    this.sceneView.changed();
  }

  /** World coordinates of a place of the scene. */
  world(p) {
    return [p.x + this.origin[0], p.y + this.origin[1], p.z + this.origin[2]];
  }

  setTheme(theme) {
    this.uniforms.values.exposure.value = theme === 'dark' ? 0.8 : 1;
    this.sceneView.changed();
  }

  /** Parameters of queries about the shown ground. */
  shownTimes() {
    return {time: this.view?.time_s ?? null, against: this.view?.against_s ?? null};
  }

  beforeFrame() {
    const changed = this.views.takeChange();
    const moving = this.machines.animate();
    if (this.loaded === this.loads) this.sayConnection();
    this.uniforms.values.compares.value = this.comparing.has(this.views.shown.id);
    this.controls?.hover();
    if (changed) {
      this.overlay.drapeAgain();
      this.fitColours();
    }
    if (this.goal && this.lifted && this.terrain.settled) this.goToMeasure(this.goal);
    if (!this.fitted && this.lifted && this.live && this.views.settled && this.terrain.settled) this.fitWork(true);
    return changed || moving;
  }

  /** Called when the camera stops. */
  beforeRender() {
    this.uniforms.values.pixel_ratio.value = this.sceneView.renderer.getPixelRatio();
    this.terrain.showsDesign = this.legend.mode === 'design';
    this.updateTerrain();
    this.machines.placeArrows();
    if (!this.lifted && Number.isFinite(this.terrain.low)) {   // the ground's height is known now
      this.lifted = true;
      this.middle.z = (this.terrain.low + this.terrain.high) / 2;
      this.fitSite(true);
    }
  }

  updateTerrain() {
    this.terrain.update(this.sceneView.camera, this.sceneView.height, this.sceneView.canvas.height);
  }

  afterFrame() {
    this.overlay.draw();
    this.machines.placeTags(this.overlay.letters);
    const {grid_m, grid_from_m} = this.uniforms.values;
    grid_m.value = Math.min(1000, 2 * drawScale(this.sceneView));
    grid_from_m.value.set(...this.origin.slice(0, 2).map((v) => v - grid_m.value * Math.floor(v / grid_m.value)));
    this.fitColours();
  }

  fitColours() {
    const {low, high} = this.terrain, {deepest_m, highest_m, fromDesign_m} = this.views.shown.blocks;
    if (!Number.isFinite(low)) return;
    this.legend.fit({deepest_m, highest_m, fromDesign_m: Math.max(fromDesign_m, this.terrain.fromDesign_m), low_m: low - deepest_m, high_m: high + highest_m, originZ: this.origin[2]});
  }

  fitSite(now = false) {
    this.follow(null);
    const narrow = Math.min(1, this.sceneView.camera.aspect);
    this.sceneView.lookAt(this.middle, (1.3 * this.size_m) / narrow, {azimuth: 0.4, elevation: 0.75, now});
  }

  /** Moves the camera to changed ground, or to a machine. */
  fitWork(first = false) {
    if (first) this.fitted = true;
    const extent = this.views.shown.blocks.extent();
    if (!extent) {
      if (!first) hint('Nothing has changed yet', 2);
      return;
    }
    const box = new Box3(extent.low, extent.high);
    const machines = this.machines.extentNear(box.getCenter(new Vector3()), 30 + box.getSize(new Vector3()).length());
    if (machines) box.union(machines);
    const middle = box.getCenter(new Vector3()), size = box.getSize(new Vector3()).length();
    if (first && size < 0.02 * this.size_m) return;   // the whole site is a better first view
    this.follow(null);
    this.sceneView.lookAt(middle, Math.max(6, 1.5 * size) / Math.min(1, this.sceneView.camera.aspect));
  }

  follow(name) {
    if (name === this.machines.following) return;
    this.machines.following = name;
    this.table.follow(name);
    const at = name && this.machines.positionOf(name);
    if (at) this.sceneView.lookAt(at, Math.min(this.sceneView.distance, 22 / Math.min(1, this.sceneView.camera.aspect)));
  }

  goToMeasure({points}) {
    this.goal = null;
    this.fitted = true;
    this.follow(null);
    this.sceneView.lookAtAll(points.map((p) => this.overlay.local(p)), freeBox(this.sceneView, boxesOver()) ?? boxOf([0, 0], this.sceneView));
  }

  measuresChanged() {
    this.cards?.update();
    this.controls?.showDraft();
    this.sceneView.changed();
  }

  /** The measures with names. */
  measuresCome(message) {
    const first = !this.measures.hasNamed;
    this.measures.takeNamed(message);
    if (first) this.openAsked();
  }

  /** Shows the measure that the page's address asks for. */
  openAsked() {
    const asked = api.measureAsked();
    if (asked === null) return;
    this.goal = this.measures.open(Number(asked));
    if (!this.goal) return hint('The measure of this link is no longer kept', 6);
    openPanel('measures');
    this.sceneView.changed();
  }

  /** Asks for sigmas, if they are to be seen and may be others than those that came. */
  wantSigmas() {
    if (this.legend?.mode !== 'sigma' || !this.connected || document.hidden) return;
    const {time} = this.shownTimes(), of = this.live ?? {};
    this.sigmas.want(time, time === null ? JSON.stringify([of.cut_m3, of.change_m3, of.surveyed_m3, of.scanned_s, of.scans?.map(({count}) => count)]) : '');
  }

  /** What is told of the place under the pointer, besides its height. */
  sigmaText(x, y) {
    if (this.legend.mode !== 'sigma' || !this.sigmas.map) return [];
    const sigma_m = this.sigmas.at(x, y);
    return [sigma_m === null ? 'not seen' : `\u00b1 ${format.length(sigma_m)}`];
  }

  setTimes(times) {
    if (times !== undefined) this.timeline.setTimes(times);
  }

  state(state) {
    this.live = state;
    this.forces.state(state);
    showAlarms(state.alarms ?? []);
    this.setTimes(state.times);
    this.sayConnection();
    if (this.shownTimes().time === null) this.showState(state, false);
    const ground = JSON.stringify([state.cut_m3, state.change_m3, state.machines.map((m) => m.bucket_m3)]);
    if (ground !== this.ground && this.ground !== undefined && this.shownTimes().time === null) this.measures.groundChanged();
    this.ground = ground;
    if ((state.surveyed_m3 ?? null) !== null) this.legend.offerSigmas();
    this.wantSigmas();
  }

  /** Machines and totals of the shown time. */
  showState(state, jump) {
    this.shownState = state;
    if (!this.connected && this.site.live && this.shownTimes().time === null) {   // what they do now is not known
      state = {...state, machines: state.machines.map((m) => (m.state === 'unseen' ? m : {...m, link: 'lost'}))};
    }
    this.machines.update(state, jump);
    this.table.update(state);
    showTotals(state);
    showScans(state, this.site, this.shownTimes().time ?? state.time_s);
  }

  /** Whether the picture is still that of another time. */
  get loads() {
    return this.timeline.waits || this.views.coming !== null;
  }

  sayConnection() {
    if (!this.connected) return showConnection('lost', 'Not connected');
    const {time} = this.shownTimes(), fed = this.live?.machines.filter(({link}) => link && link !== 'none') ?? [];
    this.loaded = !this.loads;
    if (this.loaded) this.shownTime = this.timeline.time;
    $('time').setAttribute('aria-busy', String(!this.loaded));
    if (!this.loaded) showConnection('wait', 'Loading', format.time(this.timeline.time ?? this.live?.time_s ?? null));
    else if (time !== null) showConnection('past', 'Past', format.time(time));
    else if (fed.length > 0 && fed.every(({link}) => link === 'lost')) showConnection('lost', 'No feed', format.time(this.live.time_s));
    else if (this.site.live) showConnection('live', 'Live', format.time(this.live?.time_s ?? null));
    else showConnection('past', 'Recorded', format.time(this.timeline.times?.to ?? this.live?.time_s ?? null));
  }

  /** Called when another view is requested. */
  viewComes(view) {
    this.view = view;
    this.views.expect(view.id);
    this.comparing[view.against_s === null ? 'delete' : 'add'](view.id);
    if (view.state ?? this.live) this.showState(view.state ?? this.live, true);
    this.forces.wait(view.time_s !== null);
    this.wantSigmas();
    this.sayConnection();
    this.measures.again();
    this.timeline.answered();
    this.sceneView.changed();
  }

  /** Forces of live machines, or of those of the shown view. */
  forcesCome({id, machines}) {
    if (id === (this.shownTimes().time === null ? 0 : this.view.id)) this.forces.take(machines);
  }

  reconnected() {
    if (this.views.shown.seen) this.views.expect(0);
    this.view = null;
    this.connected = true;
    this.timeline.setConnected(true);
    this.forces.again();
    if (this.site.lines && !this.lines) this.drawLines();
  }

  /** What is shown stays, and is said to be old. */
  lost() {
    if (this.loads) this.timeline.time = this.shownTime;
    this.connected = false;
    this.timeline.setConnected(false);
    this.sayConnection();
    if (this.shownState) this.showState(this.shownState, false);
  }
}

let page = null;

function text(message) {
  if (message.type === 'site') {
    if (page && identity(message) !== identity(page.site)) {
      page.measures.keepForReload();
      location.reload();
    }
    if (page) page.reconnected();
    else page = new Page(message, link);
  } else if (message.type === 'error') {
    hint(message.error, 6);
    page?.timeline.answered();
  } else if (page) {
    if (message.type === 'state') page.state(message);
    if (message.type === 'measures') page.measuresCome(message);
    if (message.type === 'view') page.viewComes(message);
    if (message.type === 'force') page.forcesCome(message);
    if (message.type === 'whole') page.views.whole(message.id);
  }
}

/** Why there is no connection, if the server tells the reason. */
async function explain() {
  const {status, error} = await api.refusal();
  if (status === 401) notice('This site needs a token: open its address with #token=\u2026 at the end.');
  if (status === 403) notice(error);
}

const link = new Link({
  text,
  binary: (buffer) => page?.views.receive(buffer),
  opened: () => notice(null),
  lost: (seconds) => {
    if (page) page.lost();
    else showConnection('lost', 'Not connected');
    notice(`No connection to the site. Trying again in ${seconds} s.`, () => link.retry());
    if (!page) explain();
  },
});
addEventListener('hashchange', () => page?.openAsked());
startPanels();
startTheme($('theme'), (theme) => page?.setTheme(theme));
fillHelp(null);
$('help-open').addEventListener('click', () => $('help').showModal());
