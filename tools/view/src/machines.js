// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The machines in the picture: poses interpolated between states of the server, and a tag with name,
// load and force above each machine.
import {Box3, Group, Quaternion, Vector3} from 'three';
import {h, setText} from './dom.js';
import {ForceArrow} from './force_arrow.js';
import {arrowScale} from './force_values.js';
import * as format from './format.js';
import {MachineModel} from './machine_model.js';
import {boxAround, boxesOver, boxOf, placeTag} from './tag_place.js';

/** Okabe and Ito's colours, safe for colour-blind people; tags also have the name. */
export const kMachineColors = ['#e69f00', '#56b4e9', '#009e73', '#cc79a7', '#f0e442', '#0072b2', '#d55e00'];
/** The word for a machine of which nothing is heard. */
export const kLost = '\u2715 no link';
const kSmooth_ms = 110;   // states come ten times a second
const kArrowBoxes = 4, kArrow_px = 5;   // of an arrow, and half its width

export class Machines {
  group = new Group();
  #machines = [];
  following = null;

  /** @param {Object} site @param {number[]} origin @param {HTMLElement} tags @param {function(string)} pick */
  constructor(site, origin, sceneView, tags, pick) {
    this.sceneView = sceneView;
    this.origin = origin;
    const scale = arrowScale(site.machines);
    site.machines.forEach((machine, i) => {
      const color = kMachineColors[i % kMachineColors.length];
      const model = new MachineModel(machine, color), arrow = new ForceArrow(scale);
      const bar = h('span', {class: 'gauge-bar'});
      const text = h('span', {class: 'tag-load'}), link = h('span', {class: 'tag-link'}), forceText = h('span', {class: 'tag-force'});
      const tag = h('button', {class: 'tag', type: 'button', hidden: true, title: machine.name, onclick: () => pick(machine.name)},
        h('span', {class: 'swatch', style: `background:${color}`}), h('span', {class: 'tag-name'}, machine.name),
        h('span', {class: 'gauge', 'aria-hidden': 'true'}, bar), text, link, forceText);
      tags.append(tag);
      this.group.add(model.group, arrow.group);
      this.#machines.push({name: machine.name, capacity_m3: machine.capacity_m3, model, arrow, tag, bar, text, link, forceText, from: null, to: null, at: null, start: 0});
    });
  }

  #local(p) {
    return new Vector3(p[0] - this.origin[0], p[1] - this.origin[1], p[2] - this.origin[2]);
  }

  /** @param {Object} state from the server @param {boolean} jump no interpolation: the state is of another time */
  update(state, jump = false) {
    for (const said of state.machines) {
      const m = this.#machines.find(({name}) => name === said.name);
      if (!m) continue;
      if (!said.position) {
        m.at = m.to = null;
        m.model.group.visible = false;
        m.arrow.show(null);
        m.tag.hidden = true;
        continue;
      }
      const to = {
        position: this.#local(said.position), rotation: new Quaternion(...said.rotation).normalize(),
        links: (said.links ?? []).map((p) => this.#local(p)),
      };
      if (m.to && m.to.position.equals(to.position) && m.to.rotation.equals(to.rotation)) m.from ??= to;
      else {
        m.from = m.at ?? to;
        m.start = performance.now();
      }
      m.to = to;
      if (jump) m.start = -Infinity;
      m.fill = said.fill ?? (m.capacity_m3 ? said.bucket_m3 / m.capacity_m3 : null);
      m.bar.style.width = `${Math.min(100, 100 * Math.max(0, m.fill ?? 0))}%`;
      m.bar.parentElement.hidden = m.fill === null;
      m.text.textContent = format.volume(said.bucket_m3, 'loose');
      m.holds = `holds ${m.text.textContent}${m.fill === null ? '' : `, ${format.percent(m.fill)} full`}`;
      const lost = said.link === 'lost';
      m.tag.classList.toggle('lost', lost);
      setText(m.link, lost ? kLost : '');
      this.#label(m);
      m.tag.hidden = false;
      m.moving = true;
    }
    this.sceneView.changed();
  }

  #label(m) {
    const force = m.forceText.textContent && `; force ${m.forceText.textContent}`;
    m.tag.setAttribute('aria-label', `${m.name}: ${m.link.textContent && 'no link; '}${m.holds}${force}; go there`);
  }

  /** @param {Map<string, {world_force_n: ?number[], text: string}>} forces by machine; of others there are none */
  showForces(forces) {
    for (const m of this.#machines) {
      const {world_force_n, text} = forces.get(m.name) ?? {world_force_n: null, text: ''};
      m.arrow.show(m.to && world_force_n);
      setText(m.forceText, text);
      if (m.to) this.#label(m);
    }
    this.sceneView.changed();
  }

  /** Fits the arrows to the picture, before it is drawn. */
  placeArrows() {
    for (const {at, arrow} of this.#machines) if (at) arrow.place(at.position, this.sceneView.pixelAt_m(at.position));
  }

  /** @return {boolean} whether something still moves */
  animate() {
    const now = performance.now();
    let moving = false;
    for (const m of this.#machines) {
      if (!m.moving || !m.to) continue;
      const t = Math.min(1, (now - m.start) / kSmooth_ms);
      m.moving = t < 1;
      moving = true;
      const same = m.from.links.length === m.to.links.length;
      const before = m.at?.position;
      m.at = {
        position: m.from.position.clone().lerp(m.to.position, t),
        rotation: m.from.rotation.clone().slerp(m.to.rotation, t),
        links: m.to.links.map((p, i) => (same ? m.from.links[i].clone().lerp(p, t) : p)),
      };
      m.model.pose(m.at.position, m.at.rotation, m.at.links, m.fill);
      if (this.following === m.name && before) this.sceneView.shift(m.at.position.clone().sub(before));
    }
    return moving;
  }

  /** Box around a place of the scene with the reach of nearby machines; null without any. @param {number} near_m */
  extentNear(place, near_m) {
    const box = new Box3();
    for (const {to} of this.#machines) {
      if (to && to.position.distanceTo(place) < near_m) [to.position, ...to.links].forEach((p) => box.expandByPoint(p));
    }
    return box.isEmpty() ? null : box;
  }

  /** Boxes of the arrows in the picture, some along each. */
  #arrowBoxes() {
    return this.#machines.flatMap(({at, arrow: {along}}) => {
      if (!at || !along) return [];
      const px = Array.from({length: kArrowBoxes + 1}, (_, i) => this.sceneView.project(at.position.clone().addScaledVector(along, -i / kArrowBoxes)));
      return px.slice(1).flatMap((b, i) => (b && px[i] ? [boxAround(px[i], b, kArrow_px)] : []));
    });
  }

  /** Places tags above the buckets, beside each other and the arrows. @param {Object[]} letters boxes of the measures' letters */
  placeTags(letters) {
    const over = [...boxesOver(), ...letters, ...this.#arrowBoxes()];
    for (const m of this.#machines) {
      if (!m.at) continue;
      const top = m.at.position.clone();
      top.z += 1.3 * (m.model.machine.height_m ?? 1);
      const px = this.sceneView.project(top);
      const inside = px && px[0] > -40 && px[0] < this.sceneView.width + 40 && px[1] > -20 && px[1] < this.sceneView.height + 20;
      // Its sides may lie between pixels, but these are integers.
      const size = {width: m.tag.offsetWidth + 1, height: m.tag.offsetHeight + 1};
      const place = inside && placeTag(px, size, this.sceneView, over);
      m.tag.classList.toggle('away', !place);
      if (!place) continue;
      over.push(boxOf(place, size));
      m.tag.style.transform = `translate(${place[0].toFixed(1)}px, ${place[1].toFixed(1)}px) translate(-50%, -100%)`;
    }
  }

  get places() {
    return this.#machines.map(({name, to, arrow}) => ({name, position: to?.position ?? null, arrow: arrow.along}));
  }

  positionOf(name) {
    return this.#machines.find((m) => m.name === name)?.to?.position ?? null;
  }
}
