// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The lines of a design over the ground. They are seen through the ground, where a design is.
import {BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments} from 'three';

const kColor = 0xff00c8;   // unlike ground, machines and legends

/** @param {number[][][]} lines in the world @param {number[]} origin of the scene @return {LineSegments} */
export function designLines(lines, origin) {
  const segments = lines.reduce((sum, line) => sum + line.length - 1, 0), at = new Float32Array(6 * segments);
  let n = 0;
  for (const line of lines) {
    for (let i = 1; i < line.length; ++i) {
      for (const p of [line[i - 1], line[i]]) for (let axis = 0; axis < 3; ++axis) at[n++] = p[axis] - origin[axis];
    }
  }
  const geometry = new BufferGeometry().setAttribute('position', new BufferAttribute(at, 3));
  const drawn = new LineSegments(geometry, new LineBasicMaterial({color: kColor, depthTest: false, transparent: true}));
  drawn.renderOrder = 1;
  return drawn;
}
