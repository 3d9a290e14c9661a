'use strict';
/** A list of events, the latest first, with a limited number of lines. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, format} = stillwake;
  const AT_ONCE = 5;
  const KINDS = {set: 'set', state: 'ECU', vehicle: 'vehicle', bus: 'bus', loop: 'loop'};

  stillwake.EventLog = class {
    /** @param {object} how kept: largest number of lines; live: whether it is read aloud; onPick: called with t. */
    constructor(element, {kept = 200, live = false, onPick = null} = {}) {
      this.kept = kept;
      this.onPick = onPick;
      this.latest = -Infinity;
      this.live = live;
      this.list = make('ol', {class: 'event-list'});
      this.none = make('p', {class: 'note'}, 'Nothing yet.');
      const role = live ? 'log' : 'region';
      const frame = {class: 'event-frame', tabindex: '0', role, 'aria-label': 'Events, the latest first'};
      this.frame = make('div', frame, this.list);
      element.replaceChildren(this.none, this.frame);
    }

    clear() {
      this.latest = -Infinity;
      this.list.replaceChildren();
      this.none.hidden = false;
    }

    /** Adds [{n, time_s, t, kind, text}] in rising order of n; events already listed are skipped. */
    add(items) {
      const later = items.filter((item) => item.n > this.latest).slice(-this.kept);
      if (!later.length) return;
      this.latest = later.at(-1).n;
      // A screen reader reads new events, but not the long list of earlier events.
      if (this.live) this.frame.setAttribute('aria-live', later.length > AT_ONCE ? 'off' : 'polite');
      this.none.hidden = true;
      this.list.prepend(...later.map((item) => this.line(item)).reverse());
      while (this.list.childElementCount > this.kept) this.list.lastElementChild.remove();
    }

    line({t, kind, text}) {
      const time = `${format.number(t, 1)}`;
      const word = make('span', {class: 'kind'}, KINDS[kind] || kind);
      if (!this.onPick) {
        return make('li', {'data-kind': kind}, make('span', {class: 'time'}, time), word, make('span', {}, text));
      }
      const button = make('button', {type: 'button', class: 'plain'}, time);
      button.addEventListener('click', () => this.onPick(t));
      return make('li', {'data-kind': kind}, button, word, make('span', {}, text));
    }
  };
})();
