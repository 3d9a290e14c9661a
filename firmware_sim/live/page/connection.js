'use strict';
/** The page's WebSockets. They reconnect by themselves, each time after a longer wait. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  // The compilation of an ECU in C takes a minute, so ANSWER_MS is long; a closed connection ends the wait immediately.
  const [SHORTEST_MS, LONGEST_MS, ANSWER_MS] = [500, 8000, 300000];

  const OPEN_MS = 10000;
  const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

  /** Returns the address of a channel on the page's server, with the page's token. */
  stillwake.channelUrl = (name) => {
    const url = new URL(name, location.href);
    url.protocol = location.protocol === 'https:' ? 'wss:' : 'ws:';
    url.search = stillwake.tokenQuery();
    url.hash = '';
    return url.href;
  };

  /** Returns '?token=...' with the page's token; '' if the page has none. */
  stillwake.tokenQuery = () => {
    const token = new URLSearchParams(location.search).get('token');
    return token ? `?${new URLSearchParams({token})}` : '';
  };

  stillwake.Channel = class {
    /** @param {Function} on called with ('open'), ('message', data) or ('closed', {wait_ms, reason}). */
    constructor(url, on) {
      this.url = url;
      this.on = on;
      this.wait = SHORTEST_MS;
      this.open();
    }

    open() {
      this.socket = new WebSocket(this.url);
      this.socket.binaryType = 'arraybuffer';
      this.socket.addEventListener('open', () => this.on('open'));
      this.socket.addEventListener('message', (event) => {
        this.wait = SHORTEST_MS;
        this.on('message', event.data);
      });
      this.socket.addEventListener('close', (event) => {
        this.on('closed', {wait_ms: this.wait, reason: event.reason});
        setTimeout(() => this.open(), this.wait);
        this.wait = Math.min(LONGEST_MS, 2 * this.wait);
      });
    }

    get ready() {
      return this.socket.readyState === WebSocket.OPEN;
    }
  };

  /** Sends requests on a separate channel and returns the answer to each. */
  stillwake.Requests = class {
    constructor(url) {
      this.next = 1;
      this.waiting = new Map();
      /** A promise that resolves when the channel has opened for the first time. */
      this.opened = new Promise((resolve) => (this.isOpen = resolve));
      this.channel = new stillwake.Channel(url, (what, data) => {
        if (what === 'open') this.isOpen();
        if (what === 'message') this.answered(JSON.parse(data));
        if (what === 'closed') this.failAll('the server has closed the connection');
      });
    }

    /** Resolves to the answer, whose `error` states a failure. A new page waits up to OPEN_MS for the channel. */
    async ask(request) {
      if (!this.channel.ready) await Promise.race([this.opened, pause(OPEN_MS)]);
      if (!this.channel.ready) return {error: 'not connected to the loop'};
      const id = this.next;
      this.next += 1;
      return new Promise((resolve) => {
        const late = setTimeout(() => this.answered({id, error: 'no answer from the loop'}), ANSWER_MS);
        this.waiting.set(id, {resolve, late});
        this.channel.socket.send(JSON.stringify({id, ...request}));
      });
    }

    answered(answer) {
      const waiting = this.waiting.get(answer.id);
      if (!waiting) return;
      this.waiting.delete(answer.id);
      clearTimeout(waiting.late);
      waiting.resolve(answer);
    }

    failAll(error) {
      for (const id of [...this.waiting.keys()]) this.answered({id, error});
    }
  };
})();
