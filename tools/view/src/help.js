// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The help dialog of the page.
import {$, h} from './dom.js';
import * as format from './format.js';
import {kUnits, unit} from './units.js';

const kKeys = [
  ['Move', ['↑', '↓', '←', '→'], 'with the ground in focus'],
  ['Turn and tilt', ['Shift', 'arrows'], ''],
  ['Zoom', ['+', '-'], ''],
  ['Look · Boundary · Section', ['V', 'B', 'S'], ''],
  ['Height · Distance', ['H', 'D'], ''],
  ['Place a point at the cross', ['Space'], 'with the ground in focus; Enter does so, too, until a boundary can be closed'],
  ['Go along a section', ['←', '→'], 'with its profile in focus'],
  ['Close a boundary · Undo a point · Cancel', ['Enter', 'Backspace', 'Esc'], ''],
  ['North up · From above', ['N', 'T'], ''],
  ['Whole site · Where the work is', ['F', 'G'], ''],
  ['Next colours', ['C'], ''],
  ['Force of the soil on the buckets', ['K'], 'if the scenario has soil'],
  ['Photo or map on the ground', ['O'], 'if the site has one'],
  ['Live · Compare from this time', ['L', 'A'], ''],
  ['Previous · next snapshot', ['[', ']'], ''],
  ['This help', ['?'], ''],
];

export function fillHelp(site) {
  const keys = h('dl', {}, ...kKeys.flatMap(([what, list, when]) => [
    h('dt', {}, ...list.flatMap((k, i) => [i > 0 ? ' ' : '', h('kbd', {}, k)])), h('dd', {}, what, when ? h('span', {class: 'faint'}, ` ${when}`) : null)]));
  $('help-body').replaceChildren(
    h('h3', {}, 'Moving'),
    h('p', {}, 'Drag to move, drag with the right button to turn and tilt, wheel to zoom. On a touch screen: one finger moves, two zoom, turn and tilt.'),
    h('h3', {}, 'Measuring'),
    h('p', {}, 'Choose a tool, then click on the ground. The server computes volumes and heights from the ground, not from the picture, and updates them while the site is live. Cut is soil taken away, fill is soil added, both against the ground before digging or, with Compare, against another time.'),
    h('p', {}, 'A measure that is given a name is kept by the site. All who look see it, and Link opens the page with it. Edit changes its name and moves its points: drag them, or type coordinates.'),
    h('h3', {}, 'Colours'),
    h('p', {}, 'Amber to red with stripes was cut, blue with dots was filled; clods are loose soil. Changes smaller than the band under Options are shown as ground.'),
    h('h3', {}, 'Force'),
    h('p', {}, 'With Force in the legend, an arrow at each lip is the force of the soil on the bucket, by the ground ahead and the scenario\u2019s soil, with the weight of the load. \u2248 is before a rough estimate, \u2265 before a force that is too low; the gauge says why. Load may be less than the weight of what the bucket holds: soil on the blade counts under Digging then. Not in the force: the rate of the dig, water, rock and the shape of teeth.'),
    h('h3', {}, 'Keys'), keys,
    site ? h('p', {class: 'faint'}, `Voxels of ${format.length(site.voxel_size_m)}. Coordinates E, N and height in ${kUnits.length[unit('length')][0].toLowerCase().replace(/^us/, 'US')}${site.crs ? `, ${site.crs}` : ''}.`) : '');
}
