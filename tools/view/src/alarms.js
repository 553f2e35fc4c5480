// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Lines of alarms: few, so that the picture stays to be seen; lost links first.
import * as format from './format.js';
import * as units from './units.js';

const kMost = 3;   // lines, with that of all others
const kTogether = {   // what is said of several machines
  feed_lost: 'machines are silent', fix: 'machines have no fixed position and dig nothing', clock: 'machines have another time',
  below_design: 'machines are below the design', outside: 'machines are outside the boundary',
};

const line = ({machine, text, by_m}) => ({machine, text: by_m === undefined || units.unit('length') === 'm' ? text : text.replace(/[\d.]+ m\b/, format.length(by_m))});

/**
 * @param {{kind: string, machine: ?string, text: string, by_m: number=}[]} alarms
 * @param {boolean} all show each by itself
 * @return {{lines: {machine: ?string, text: string}[], more: number}} more: alarms that no line tells by itself
 */
export function alarmLines(alarms, all) {
  const sorted = [...alarms].sort((a, b) => (b.kind === 'feed_lost') - (a.kind === 'feed_lost'));
  if (all || alarms.length <= kMost) return {lines: sorted.map(line), more: 0};
  const lines = [];
  let told = 0;
  for (const kind of [...new Set(sorted.map((alarm) => alarm.kind))].slice(0, kMost - 1)) {
    const of = sorted.filter((alarm) => alarm.kind === kind), together = of.length > 1 && kTogether[kind];
    lines.push(together ? {machine: null, text: `${of.length} ${together}`} : line(of[0]));
    if (!together) ++told;
  }
  return {lines, more: alarms.length - told};
}
