// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers for people: three significant digits, at most three decimals, units, a real minus sign.

const kThin = '\u2009';
const kMostDecimals = 3, kLeast = 0.001;
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

export const volume = (m3) => withUnit(m3, 'm³');
/** A volume per hour. */
export const rate = (m3) => (m3 === null || m3 === undefined ? kNone : `${signedVolume(m3).replace(/^\+/, '')}/h`);
export const area = (m2) => withUnit(m2, 'm²');

/** Mass of a load: in kg, or in tonnes from 10 t on. */
export const mass = (kg) => (Math.abs(kg ?? 0) >= 9999.5 ? withUnit(kg / 1000, 't') : withUnit(kg, 'kg'));

/** Signed volume: + is fill. */
export function signedVolume(m3) {
  if (m3 === null || m3 === undefined) return kNone;
  return (m3 >= kLeast ? '+' : '') + volume(m3);
}

/** A length in a unit of suitable size. */
export function length(metres) {
  if (metres === null || metres === undefined || !Number.isFinite(metres)) return kNone;
  const size = Math.abs(metres);
  if (size >= 9999.5) return withUnit(metres / 1000, 'km');
  if (size >= 0.995 || size === 0) return withUnit(metres, 'm');
  if (size >= 0.00995) return withUnit(metres * 100, 'cm');
  return `${grouped((metres * 1000).toFixed(0)).replace('-', '\u2212')}${kThin}mm`;
}

/** As above, with a + for heights above. */
export const signedLength = (metres) => (metres > 0 ? '+' : '') + length(metres);

/** A coordinate or height, to the centimetre as in surveying. */
export function coordinate(metres, decimals = 2) {
  if (metres === null || metres === undefined || !Number.isFinite(metres)) return kNone;
  return (metres < 0 ? '\u2212' : '') + grouped(Math.abs(metres).toFixed(decimals));
}

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

/** As time(), to the minute if it is a date. */
export const moment = (seconds) =>
  (seconds > kLeastEpoch_s ? new Date(seconds * 1000).toLocaleString(undefined, {dateStyle: 'short', timeStyle: 'short'}) : time(seconds));

/** A duration of work. */
export const hours = (h) => (h < 1 ? `${(60 * h).toFixed(0)}${kThin}min` : withUnit(h, 'h'));

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
