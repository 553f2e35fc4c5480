// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The WebSocket to the server. After a failure it reconnects after 1, 2, 4 s and so on, at most 30
// s; at once when the browser is online again, or on request.
import {address} from './api.js';

const kLongest_s = 30;
const kSilence_ms = 8000;   // the server sends a message each second

export class Link {
  #socket = null;
  #tries = 0;
  #timer = null;
  #heard = 0;

  /**
   * @param {Object} on text(message), binary(buffer), opened(), and lost(seconds) with the time
   *     until the next attempt
   */
  constructor(on) {
    this.on = on;
    addEventListener('online', () => this.retry());
    setInterval(() => {
      if (this.open && performance.now() - this.#heard > kSilence_ms) this.#socket.close();
    }, 2000);
    this.#connect();
  }

  get open() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  send(message) {
    if (!this.open) return false;
    this.#socket.send(JSON.stringify(message));
    return true;
  }

  /** Connects now. */
  retry() {
    if (this.#socket !== null) return;
    clearTimeout(this.#timer);
    this.#connect();
  }

  #connect() {
    const url = address('/view');
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    const socket = new WebSocket(url);
    this.#socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.#heard = performance.now();
      this.on.opened();
    };
    socket.onmessage = ({data}) => {
      this.#heard = performance.now();
      this.#tries = 0;
      if (typeof data === 'string') this.on.text(JSON.parse(data));
      else this.on.binary(data);
    };
    socket.onclose = () => {
      if (this.#socket !== socket) return;
      this.#socket = null;
      const wait_s = Math.min(kLongest_s, 2 ** this.#tries++);
      this.#timer = setTimeout(() => this.#connect(), 1000 * wait_s);
      this.on.lost(wait_s);
    };
  }
}
