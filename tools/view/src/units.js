// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The units that a viewer chose, and conversions from SI and back. The server's interfaces keep SI;
// format.js shows numbers in these units, and what people type is converted by `si`.

const kFoot_m = 0.3048, kSurveyFoot_m = 1200 / 3937;

/** By kind and word (the words of `/report?units=`): name, symbol and size in SI; the first is the default. */
export const kUnits = {
  length: {m: ['Metres', 'm', 1], ft: ['Feet', 'ft', kFoot_m], us_ft: ['US survey feet', 'ftUS', kSurveyFoot_m]},
  volume: {m3: ['Cubic metres', 'm³', 1], yd3: ['Cubic yards', 'yd³', 0.764554857984]},   // 0.9144³
  mass: {t: ['Tonnes', 't', 1000], short_tons: ['Short tons', 'short tons', 907.18474]},
  soil: {counted: ['As counted', '', null], bank: ['Bank', 'bank', null], loose: ['Loose', 'loose', null]},
};
const kMetric = Object.fromEntries(Object.entries(kUnits).map(([kind, all]) => [kind, Object.keys(all)[0]]));

let chosen = kMetric;
let loosePerBank = null;   // null: unknown

/** The chosen word of a kind. */
export const unit = (kind) => chosen[kind];
const squared = {area: 'length'};
const size = (kind) => kUnits[squared[kind] ?? kind][chosen[squared[kind] ?? kind]][2] ** (squared[kind] ? 2 : 1);

/** "m", "ft", "m²", "yd³", "short tons". */
export const symbol = (kind) => kUnits[squared[kind] ?? kind][chosen[squared[kind] ?? kind]][1] + (squared[kind] ? '²' : '');
/** A value of SI in the chosen unit of 'length', 'area', 'volume' or 'mass', and back. */
export const shown = (kind, value) => value / size(kind);
export const si = (kind, value) => value * size(kind);

/** @param {?number} swell of the site's soil; null: unknown. Rounded as the engine does, core/include/soilvdb/mass.h */
export function setSwell(swell) {
  loosePerBank = swell === null ? null : Math.round((1 + swell) * 65536) / 65536;
}

/** 'bank' or 'loose': the soil by which volumes are shown that are counted as one of these; '' if that is unknown. */
export const soilOf = (counted) => (loosePerBank === null ? '' : chosen.soil === 'counted' ? counted : chosen.soil);

/** A volume of soil that is counted as 'bank' or 'loose', m3, as the soil to be shown. */
export function ofSoil(m3, counted) {
  const wanted = soilOf(counted);
  if (wanted === '' || wanted === counted || m3 === null || m3 === undefined) return m3;
  return wanted === 'loose' ? m3 * loosePerBank : m3 / loosePerBank;
}

/**
 * Units of a text such as "ft,yd3"; others are the default.
 * @throws {Error} with one line for an unknown word, or two of a kind
 */
export function parsed(text) {
  const found = {};
  for (const word of text === '' ? [] : text.split(',')) {
    const kind = Object.keys(kUnits).find((k) => Object.hasOwn(kUnits[k], word));
    if (!kind || found[kind]) throw new Error(`units=${text}: at most one each of ${Object.values(kUnits).map((of) => Object.keys(of).join(' or ')).join(', ')}`);
    found[kind] = word;
  }
  return {...kMetric, ...found};
}

/** The text of the chosen units. Soil only where the site can tell bank from loose, or `always`. */
export const text = (always = false) => Object.keys(kUnits)
  .filter((kind) => kind !== 'soil' || (chosen.soil !== 'counted' && (always || loosePerBank !== null))).map((kind) => chosen[kind]).join(',');

/** @param {Object} units by kind */
export function choose(units) {
  chosen = {...kMetric, ...units};
}
