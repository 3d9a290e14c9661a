'use strict';
/** The ECU's states, with the present state lit: a drawing on wide pages, a list on narrow pages. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write} = stillwake;
  const SVG = 'http://www.w3.org/2000/svg';
  const BOX = [112, 34];
  const AFTERGLOW_MS = 1500;

  /** Modes of `ecu.fail_safe.OperatingMode`, UNPOWERED and BOOT: upper left corner of the box, and a description. */
  const STATES = {
    UNPOWERED: [8, 20, 'The ECU has no supply. The jets are shut.'],
    BOOT: [8, 82, 'The ECU starts. The jets are shut.'],
    INIT: [8, 144, 'Since power-on no usable pressures have arrived.'],
    STANDBY: [8, 206, 'Pressures arrive. The vehicle’s request has been high since before: it must fall and rise again.'],
    ARMED: [8, 268, 'Ready. Control starts when the vehicle requests it.'],
    WARMUP: [238, 20, 'Control is requested; the controller fills its window of past pressures.'],
    CONTROL: [444, 20, 'The jets follow the controller.'],
    HOLD: [444, 98, 'Pressures are missing: the last command is held.'],
    DECAY: [444, 176, 'Pressures are missing for longer: the command is halved each period.'],
    FAULT: [238, 268, 'The jets are shut, and stay so until valid frames have arrived and the request rises again.'],
    UPDATE: [444, 268, 'A new release is being written. The jets are shut.'],
  };
  /** States that EcuStatus reports as OFF; every other state is reported with its own name. */
  const OFF = ['INIT', 'STANDBY', 'ARMED', 'UPDATE'];
  /** The main transitions; docs/reference/states.md has all of them. */
  const WAYS = [
    ['M64 54 V82'], ['M64 116 V144'], ['M64 178 V206'], ['M64 240 V268'],
    ['M120 280 H170 V37 H238', 'request rises', 164, 258, 'end'], ['M350 37 H444', 'window full', 396, 31, 'middle'],
    ['M464 54 V98', 'pressures missing', 470, 80], ['M464 132 V176', 'for longer', 470, 158],
    ['M556 193 H590 V37 H556', 'pressures', 597, 112], ['M556 115 H590', 'arrive again', 597, 128, 'start', 'joins'],
    ['M444 200 H320 V268', 'too many missing', 326, 193], ['M268 268 V54', 'request rises again', 274, 130],
    ['M238 292 H120', 'request ends', 179, 307, 'middle'],
  ];
  const KIND = {CONTROL: 'good', HOLD: 'warn', DECAY: 'warn', FAULT: 'bad', UNPOWERED: 'bad', BOOT: 'warn'};

  const svg = (name, attributes, text) => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text) element.textContent = text;
    return element;
  };

  stillwake.StateMachine = class {
    constructor(element) {
      this.boxes = new Map();
      this.items = new Map();
      this.present = null;
      const drawing = svg('svg', {viewBox: '0 0 680 328', class: 'states-drawing', 'aria-hidden': 'true'});
      const size = {viewBox: '0 0 8 8', refX: 7, refY: 4, markerWidth: 7, markerHeight: 7};
      const tip = svg('marker', {id: 'states-tip', orient: 'auto', ...size});
      tip.append(svg('path', {d: 'M0 0 L8 4 L0 8 z', class: 'tip'}));
      drawing.append(tip, svg('rect', {x: 432, y: 8, width: 242, height: 212, rx: 8, class: 'jets-may-run'}));
      drawing.append(svg('rect', {x: 2, y: 136, width: 124, height: 190, rx: 8, class: 'jets-may-not'}));
      drawing.append(svg('text', {x: 64, y: 319, class: 'way-label', 'text-anchor': 'middle'}, 'on the bus: OFF'));
      drawing.append(svg('text', {x: 668, y: 215, class: 'way-label', 'text-anchor': 'end'}, 'the jets may run'));
      for (const [path, label, x, y, anchor, joins] of WAYS) {
        const end = joins ? {} : {'marker-end': 'url(#states-tip)'};
        drawing.append(svg('path', {d: path, class: 'way', ...end}));
        if (label) drawing.append(svg('text', {x, y, class: 'way-label', 'text-anchor': anchor || 'start'}, label));
      }
      const list = make('ol', {class: 'states-list', 'aria-label': 'States of the ECU'});
      for (const [name, [x, y]] of Object.entries(STATES)) {
        const box = svg('g', {class: 'state', 'data-state': name, 'data-kind': KIND[name] || 'plain'});
        box.append(
          svg('rect', {x, y, width: BOX[0], height: BOX[1], rx: 6}),
          svg('text', {x: x + BOX[0] / 2, y: y + BOX[1] / 2 + 5, 'text-anchor': 'middle'}, name),
        );
        const item = make('li', {class: 'state', 'data-state': name, 'data-kind': KIND[name] || 'plain'}, name);
        drawing.append(box);
        list.append(item);
        this.boxes.set(name, [box, item]);
      }
      this.words = make('p', {class: 'states-words'});
      element.replaceChildren(make('div', {class: 'states'}, drawing, list, this.words));
    }

    /** @param {string} state name. @param {string} because the reason in words, or empty. */
    show(state, because = '') {
      const words = STATES[state] ? STATES[state][2] : '';
      const onBus = OFF.includes(state) ? ' (on the bus: OFF)' : '';
      write(this.words, `${state || '–'}${onBus}. ${words}${because ? ` Reason: ${because}.` : ''}`);
      if (state === this.present) return;
      this.light(this.present, false);
      this.light(state, true);
      if (this.present) this.glow(this.present);
      this.present = state;
    }

    /** Lights a state for a short time after the ECU has left this state. */
    glow(state) {
      for (const element of this.boxes.get(state) || []) {
        element.classList.remove('passed');
        // In a hidden tab no frame comes, but time passes; so the time begins with the frame.
        requestAnimationFrame(() => {
          element.classList.add('passed');
          clearTimeout(element.passing);
          element.passing = setTimeout(() => element.classList.remove('passed'), AFTERGLOW_MS);
        });
      }
    }

    light(state, present) {
      for (const element of this.boxes.get(state) || []) {
        element.classList.toggle('present', present);
        if (element.tagName !== 'LI') continue;
        if (present) element.setAttribute('aria-current', 'true');
        else element.removeAttribute('aria-current');
      }
    }
  };
  Object.assign(stillwake.StateMachine, {STATES: Object.keys(STATES), OFF, KIND});
})();
