// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// window.soilvdb: read-only data of the drawn page, for tests and debugging.
import {Vector3} from 'three';

export function handle(page) {
  window.soilvdb = Object.freeze({
    site: () => structuredClone(page.site),
    /** {id, blocks, vertices, settled, rejected}: the view shown. */
    view: () => ({
      id: page.views.shown.id, blocks: page.views.shown.blocks.count, vertices: page.views.shown.blocks.vertices,
      settled: page.views.settled, rejected: page.views.rejected, error: page.views.lastError ?? null,
    }),
    terrain: () => ({settled: page.terrain.settled, tiles: page.terrain.drawnTiles, triangles: page.terrain.drawnTriangles, fromDesign_m: page.terrain.fromDesign_m}),
    /** The shown time, s. */
    time: () => page.shownTimes().time ?? page.live?.time_s ?? null,
    /** Name and drawn position of each machine, and the arrow of its force from there, m. */
    machines: () => page.machines.places.map(({name, position, arrow}) => ({name, position: position && page.world(position), arrow: arrow && arrow.toArray()})),
    /** Segments of the design's lines that are drawn. */
    lines: () => (page.lines ? page.lines.geometry.getAttribute('position').count / 2 : 0),
    /** Whether a photo lies on the ground. */
    draped: () => page.uniforms.values.draped.value,
    /** Whether the sigmas that are wanted are shown, the size of their cells, and how many were seen. */
    sigmas: () => ({settled: page.sigmas.settled, cell_m: page.sigmas.map?.cell_m ?? null, seen: page.sigmas.map?.sigmas_m.reduce((n, s) => n + (s >= 0), 0) ?? 0}),
    /** Sigma at a place of the world, m; null where it was not seen. */
    sigma: (x, y) => page.sigmas.at(x, y),
    frames: () => page.sceneView.frames,
    memory: () => ({...page.sceneView.renderer.info.memory}),
    /** Window pixel of a place in the world, or null. */
    project: ([x, y, z]) => {
      const at = page.sceneView.project(new Vector3(x - page.origin[0], y - page.origin[1], z - page.origin[2]));
      const box = page.sceneView.canvas.getBoundingClientRect();
      return at && [at[0] + box.left, at[1] + box.top];
    },
    /** Height of the drawn ground. */
    height: (x, y) => page.pick.heightAt(x - page.origin[0], y - page.origin[1]),
  });
}
