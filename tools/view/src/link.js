// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The WebSocket to the server. After a failure it reconnects after 1, 2, 4 s and so on, at most 30
// s; at once when the browser is online again, or on request. A page that nobody sees for a while
// disconnects until it is seen again.
import {address, answers} from './api.js';

const kLongest_s = 30;
const kTick_ms = 500;
const kAsk = 4, kSilent = 7;   // ticks without a sign of life; the server sends a message each second
const kLongestMessage = 60;    // ticks until a message is here, or until the connection opens
const kHidden_ms = 10_000;     // that a page is hidden before it disconnects

export class Link {
  #socket = null;
  #tries = 0;
  #timer = null;
  // In ticks, not time: a page that was busy or asleep did not listen meanwhile.
  #quiet = 0;    // since the last sign of life
  #waited = 0;   // since the last message
  #sleep = null;   // timer to disconnect a hidden page

  /**
   * @param {Object} on text(message), binary(buffer), opened(), and lost(seconds) with the time
   *     until the next attempt
   */
  constructor(on) {
    this.on = on;
    addEventListener('online', () => document.hidden || this.retry());
    document.addEventListener('visibilitychange', () => this.#show(!document.hidden));
    if (document.hidden) this.#show(false);
    setInterval(() => this.#listen(), kTick_ms);
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
    if (this.open) return;
    this.#drop();
    clearTimeout(this.#timer);
    this.#connect();
  }

  #show(visible) {
    clearTimeout(this.#sleep);
    if (visible) this.retry();
    else this.#sleep = setTimeout(() => this.#rest(), kHidden_ms);
  }

  #rest() {
    this.#drop();
    clearTimeout(this.#timer);
  }

  #connect() {
    const url = address('/view');
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    const socket = new WebSocket(url);
    this.#socket = socket;
    this.#quiet = this.#waited = 0;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.#quiet = this.#waited = 0;
      this.on.opened();
    };
    socket.onmessage = ({data}) => {
      this.#quiet = this.#waited = this.#tries = 0;
      if (typeof data === 'string') this.on.text(JSON.parse(data));
      else this.on.binary(data);
    };
    socket.onclose = () => this.#lost();
  }

  /**
   * The browser hands over a message only when all of it is here, which takes a slow connection
   * long. A silent server is therefore asked by HTTP, too.
   */
  #listen() {
    const socket = this.#socket;
    if (socket === null) return;
    ++this.#quiet;
    ++this.#waited;
    if (this.open && this.#quiet === kAsk) {
      answers((kSilent - kAsk) * kTick_ms).then((alive) => {
        if (alive && socket === this.#socket) this.#quiet = 0;
      });
    }
    if ((this.open && this.#quiet >= kSilent) || this.#waited >= kLongestMessage) this.#lost();
  }

  /** Closes without waiting for the peer, whose answer to the close may never come. */
  #drop() {
    const socket = this.#socket;
    this.#socket = null;
    if (socket === null) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
  }

  #lost() {
    this.#drop();
    const wait_s = Math.min(kLongest_s, 2 ** this.#tries++);
    this.#timer = setTimeout(() => this.#connect(), 1000 * wait_s);
    this.on.lost(wait_s);
  }
}
