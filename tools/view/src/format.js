// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers of SI for people: in the units that they chose, with three significant digits, at most
// three decimals, units, a real minus sign.
import * as units from './units.js';

const kThin = '\u2009';
const kMostDecimals = 3, kLeast = 0.001;
const kPound_kg = 0.45359237;
const kLeastEpoch_s = 1e8;   // larger times count from 1970
export const kNone = '\u2013';

/** Three significant digits, with spaces between thousands; 0 is "0", and less than is shown "< 0.001". */
export function digits(value, significant = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return kNone;
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size < kLeast) return `<${kThin}${kLeast}`;
  const rounded = Number(size.toPrecision(significant));
  const decimals = Math.max(0, significant - 1 - Math.floor(Math.log10(rounded)));
  return (value < 0 ? '\u2212' : '') + grouped(rounded.toFixed(Math.min(decimals, kMostDecimals)));
}

/** "12 345.6" with thin spaces between thousands, from 10 000 on. */
export function grouped(text) {
  const [whole, part] = text.split('.');
  const apart = whole.length > 4 ? whole.replace(/\B(?=(\d{3})+$)/g, kThin) : whole;
  return part === undefined ? apart : `${apart}.${part}`;
}

/** A value with its unit, or a dash if there is none. */
export function withUnit(value, unit, significant = 3) {
  const text = digits(value, significant);
  return text === kNone ? text : `${text}${kThin}${unit}`;
}

const converted = (kind, value) => (value === null || value === undefined ? value : units.shown(kind, value));

/** @param {string} counted 'bank' or 'loose' if the volume is of such soil */
export const volume = (m3, counted = '') => withUnit(converted('volume', counted ? units.ofSoil(m3, counted) : m3), units.symbol('volume'));
export const area = (m2) => withUnit(converted('area', m2), units.symbol('area'));

/** Mass of a load: in kg or lb, and from 10 t on in tonnes, from 10 short tons on in these. */
export function mass(kg) {
  const pounds = units.unit('mass') === 'short_tons', small = pounds ? kg / kPound_kg : kg;
  if (Math.abs(small ?? 0) < (pounds ? 19999.5 : 9999.5)) return withUnit(kg === null || kg === undefined ? kg : small, pounds ? 'lb' : 'kg');
  return withUnit(units.shown('mass', kg), units.symbol('mass'));
}

/** Signed volume: + is fill. */
export function signedVolume(m3) {
  if (m3 === null || m3 === undefined) return kNone;
  return (units.shown('volume', m3) >= kLeast ? '+' : '') + volume(m3);
}

/** A volume per hour. */
export const rate = (m3) => (m3 === null || m3 === undefined ? kNone : `${signedVolume(m3).replace(/^\+/, '')}/h`);

/** A length in a unit of suitable size; feet have decimals, as in surveying. */
export function length(metres) {
  if (metres === null || metres === undefined || !Number.isFinite(metres)) return kNone;
  if (units.unit('length') !== 'm') return withUnit(units.shown('length', metres), units.symbol('length'));
  const size = Math.abs(metres);
  if (size >= 9999.5) return withUnit(metres / 1000, 'km');
  if (size >= 0.995 || size === 0) return withUnit(metres, 'm');
  if (size >= 0.00995) return withUnit(metres * 100, 'cm');
  return `${grouped((metres * 1000).toFixed(0)).replace('-', '\u2212')}${kThin}mm`;
}

/** As above, with a + for heights above. */
export const signedLength = (metres) => (metres > 0 ? '+' : '') + length(metres);

/** A coordinate or height without its unit, to the hundredth as in surveying. */
export function coordinate(metres, decimals = 2) {
  if (metres === null || metres === undefined || !Number.isFinite(metres)) return kNone;
  return (metres < 0 ? '\u2212' : '') + grouped(Math.abs(units.shown('length', metres)).toFixed(decimals));
}

/** As above with its unit. */
export const height = (metres, decimals = 2) => `${coordinate(metres, decimals)}${kThin}${units.symbol('length')}`;

/** A round length such as a step or scale without more digits than it needs. */
export const step = (metres) => `${Number(units.shown('length', metres).toPrecision(3))}${kThin}${units.symbol('length')}`;

/** What somebody typed as a length in the chosen unit, in m; NaN for what is no number. */
export const typedLength = (text) => (text.trim() === '' ? NaN : units.si('length', Number(text.replace(',', '.'))));
/** A length for a field that is typed in: to a tenth of a millimetre, so that it comes back as it was. */
export const toType = (metres) => String(Number(units.shown('length', metres).toFixed(4)));

/** A share from 0 to 1, in per cent. */
export const percent = (share) =>
  share === null || share === undefined ? kNone : `${(100 * share).toFixed(0)}${kThin}%`;

/** Time of a site; seconds since 1970 become the date and time of day of this computer's time zone. */
export function time(seconds) {
  if (seconds === null || seconds === undefined) return kNone;
  if (seconds > kLeastEpoch_s) {
    return new Date(seconds * 1000).toLocaleString(undefined, {dateStyle: 'short', timeStyle: 'medium'});
  }
  const negative = seconds < 0 ? '\u2212' : '';
  const tenths = Math.round(Math.abs(seconds) * 10);
  const s = (tenths % 600) / 10, minutes = Math.floor(tenths / 600);
  const two = (n) => String(n).padStart(2, '0');
  if (minutes === 0) return `${negative}${s.toFixed(1)}${kThin}s`;
  const hours = Math.floor(minutes / 60);
  const tail = `${hours > 0 ? two(minutes % 60) : minutes}:${s < 10 ? '0' : ''}${s.toFixed(1)}`;
  return negative + (hours > 0 ? `${hours}:${tail}` : tail);
}

/** The time of day that ends time(); '' without a date. */
export function clock(seconds) {
  const text = seconds > kLeastEpoch_s ? new Date(seconds * 1000).toLocaleTimeString(undefined, {timeStyle: 'medium'}) : '';
  return text && time(seconds).endsWith(text) ? text : '';
}

/** As time(), but without the date if it is that of another time. */
export function timeBeside(seconds, other) {
  const text = time(seconds), hours = clock(seconds), date = text.slice(0, text.length - hours.length);
  return hours && time(other).startsWith(date) ? hours : text;
}

/** As time(), to the minute if it is a date. */
export const moment = (seconds) =>
  (seconds > kLeastEpoch_s ? new Date(seconds * 1000).toLocaleString(undefined, {dateStyle: 'short', timeStyle: 'short'}) : time(seconds));

/** A duration of work. */
export const hours = (h) => (h < 1 ? `${(60 * h).toFixed(0)}${kThin}min` : withUnit(h, 'h'));

/** How long ago something was. */
export function ago(seconds) {
  const s = Math.max(0, seconds), [size, unit] = s < 59.5 ? [1, 's'] : s < 3570 ? [60, 'min'] : s < 84600 ? [3600, 'h'] : [86400, 'd'];
  return `${(s / size).toFixed(0)}${kThin}${unit} ago`;
}

/** A signed length and its standard deviation, to the millimetre. */
export function estimate(mean, sigma) {
  const metric = units.unit('length') === 'm', text = (m) => (metric ? (1000 * m).toFixed(0) : units.shown('length', m).toFixed(3));
  const size = text(Math.abs(mean)), sign = Number(size) === 0 ? '' : mean < 0 ? '\u2212' : '+';
  return `${sign}${size} \u00b1 ${text(sigma)}${kThin}${metric ? 'mm' : units.symbol('length')}`;
}

/** 1, 2 or 5 times a power of ten of the chosen unit of length, at most, and at least, `about` metres. */
export const stepDown = (about) => units.si('length', roundDown125(units.shown('length', about)));
export const stepUp = (about) => units.si('length', roundUp125(units.shown('length', about)));

/** 1, 2 or 5 times a power of ten, at most `about`. */
export function roundDown125(about) {
  const decade = 10 ** Math.floor(Math.log10(about) + 1e-9);
  const mantissa = (about / decade) * (1 + 1e-9);
  return decade * (mantissa >= 5 ? 5 : mantissa >= 2 ? 2 : 1);
}

/** As above, but at least `about`. */
export function roundUp125(about) {
  const below = roundDown125(about);
  return below >= about * (1 - 1e-9) ? below : roundDown125(below * 2.5 * (1 + 1e-9));
}
