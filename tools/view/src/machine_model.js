// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine's model: its bucket from profile and width, its load, and beams from joint to joint.
import {BoxGeometry, BufferGeometry, CylinderGeometry, DoubleSide, Float32BufferAttribute, Group, Mesh, MeshLambertMaterial, Quaternion, ShapeUtils, Vector2, Vector3} from 'three';

const kSoil = 0x8a6f50;

/** Outline of the body from the lip along the back to the upper edge, in the bucket frame. */
function outline(machine) {
  if (machine.profile?.length >= 3) return machine.profile;
  const h = machine.height_m ?? machine.width_m * 0.7;
  return [[0, 0], [-0.75 * h, 0.02 * h], [-0.95 * h, 0.45 * h], [-0.7 * h, h], [0, h]];
}

/** Side plates and the sheet along a line between them. @param {boolean} closed also from its end to its begin */
function bodyGeometry(line, half, closed) {
  const positions = [], points = line.map(([x, z]) => new Vector2(x, z));
  for (let i = 0; i < line.length - (closed ? 0 : 1); ++i) {
    const a = line[i], b = line[(i + 1) % line.length];
    const p = [[a[0], -half, a[1]], [b[0], -half, b[1]], [b[0], half, b[1]], [a[0], half, a[1]]];
    for (const k of [0, 1, 2, 0, 2, 3]) positions.push(...p[k]);
  }
  for (const triangle of ShapeUtils.triangulateShape(points, [])) {
    for (const y of [-half, half]) for (const k of triangle) positions.push(line[k][0], y, line[k][1]);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new Float32BufferAttribute(positions, 3));
  geometry.computeVertexNormals();
  return geometry;
}

/** The load as a body between the plates: the outline, scaled towards the back. */
function loadGeometry(machine) {
  const line = outline(machine), deepest = line.reduce((a, b) => (b[0] < a[0] ? b : a));
  const geometry = bodyGeometry(line, 0.97 * (machine.width_m / 2), true).translate(-deepest[0], 0, -deepest[1]);
  return {geometry, anchor: new Vector3(deepest[0], 0, deepest[1])};
}

export class MachineModel {
  group = new Group();
  bucket = new Group();
  #beams = [];

  /** @param {Object} machine from the site's message @param {number} color */
  constructor(machine, color) {
    this.machine = machine;
    const steel = new MeshLambertMaterial({color, side: DoubleSide});
    this.paint = new MeshLambertMaterial({color});
    this.bucket.add(new Mesh(bodyGeometry(outline(machine), machine.width_m / 2, false), steel));
    const load = loadGeometry(machine);
    this.load = new Mesh(load.geometry, new MeshLambertMaterial({color: kSoil, side: DoubleSide}));
    this.load.position.copy(load.anchor);
    this.bucket.add(this.load);
    this.group.add(this.bucket);
    this.group.visible = false;
  }

  /**
   * @param {Vector3} position of the lip's middle, in the scene @param {Quaternion} rotation
   * @param {Vector3[]} links origins of the joints from the base on, in the scene
   * @param {?number} fill share of the capacity
   */
  pose(position, rotation, links, fill) {
    this.group.visible = true;
    this.bucket.position.copy(position);
    this.bucket.quaternion.copy(rotation);
    const share = Math.min(1, Math.max(0, fill ?? 0));
    this.load.visible = share > 0.02;
    this.load.scale.set(0.97 * Math.cbrt(share), 1, 0.97 * Math.cbrt(share));
    this.#poseLinks(links);
  }

  #poseLinks(links) {
    const wide = Math.max(0.12, 0.22 * this.machine.width_m);
    const joints = links.filter((p, i) => i === 0 || p.distanceTo(links[i - 1]) > 0.05);
    const parts = Math.max(0, joints.length - 1) + (joints.length > 0 ? 1 : 0);
    while (this.#beams.length < parts) {
      const beam = new Mesh(this.#beams.length === 0 ? new CylinderGeometry(1, 1, 1, 24).rotateX(Math.PI / 2) : new BoxGeometry(1, 1, 1), this.paint);
      this.#beams.push(beam);
      this.group.add(beam);
    }
    this.#beams.forEach((beam, i) => { beam.visible = i < parts; });
    if (joints.length === 0) return;
    this.#beams[0].position.copy(joints[0]);   // the part that it turns on
    this.#beams[0].scale.set(4 * wide, 4 * wide, wide);
    for (let i = 1; i < joints.length; ++i) {
      const beam = this.#beams[i], along = joints[i].clone().sub(joints[i - 1]), length = along.length();
      beam.position.copy(joints[i - 1]).addScaledVector(along, 0.5);
      beam.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(1, 0, 0), along.normalize()));
      const thick = wide * (1.4 - (0.6 * i) / joints.length);
      beam.scale.set(length + 0.3 * thick, thick, thick);
    }
  }
}
