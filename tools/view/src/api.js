// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The server's answers by HTTP: queries as JSON, tiles as bytes, addresses of downloads. The token
// comes from the page's own address, #token=...

const inHash = (name) => new URLSearchParams(location.hash.slice(1)).get(name);
export const token = inHash('token');
/** The number of the measure that the page's address asks for, #measure=..., or null. */
export const measureAsked = () => inHash('measure');

/**
 * A path with its query and token, relative to the page: a proxy may serve the page below any path.
 */
export function address(path, query = {}) {
  const url = new URL(`.${path}`, location.href);
  url.hash = '';
  for (const [key, value] of Object.entries(query)) {
    if (value !== null && value !== undefined) url.searchParams.set(key, value);
  }
  if (token) url.searchParams.set('token', token);
  return url;
}

async function reasonOf(response) {
  let reason = `${response.status} ${response.statusText}`;
  try {
    reason = (await response.json()).error ?? reason;
  } catch { /* it said nothing more */ }
  return reason;
}

/** fetch() that throws an error with `offline` where there is no connection. */
async function fetched(url, options) {
  try {
    return await fetch(url, options);
  } catch (error) {
    throw error instanceof TypeError ? Object.assign(new Error('No connection'), {offline: true}) : error;
  }
}

async function get(path, query, within_ms = 30000) {
  const response = await fetched(address(path, query), {signal: AbortSignal.timeout(within_ms)});
  if (response.ok) return response;
  throw Object.assign(new Error(await reasonOf(response)), {status: response.status});
}

/**
 * Why the server refuses the view. Browsers hide the reason for a WebSocket, but the server checks
 * a POST in the same way, because it has an Origin, too.
 */
export async function refusal() {
  try {
    const response = await fetch(address('/view'), {method: 'POST'});
    return {status: response.status, error: await reasonOf(response)};
  } catch {
    return {status: null, error: null};   // there is no server
  }
}

/** Whether the server answers a small query in time. */
export async function answers(within_ms) {
  try {
    return (await fetch(address('/machines.csv'), {cache: 'no-store', signal: AbortSignal.timeout(within_ms)})).ok;
  } catch {
    return false;
  }
}

/** Sends JSON. @return what the server answers */
export async function postJson(path, json) {
  const response = await fetched(address(path), {method: 'POST', body: JSON.stringify(json), signal: AbortSignal.timeout(30000)});
  if (!response.ok) throw new Error(await reasonOf(response));
  return response.json();
}

export const getJson = async (path, query, within_ms) => (await get(path, query, within_ms)).json();
export const getBytes = async (path, query) => (await get(path, query)).arrayBuffer();
