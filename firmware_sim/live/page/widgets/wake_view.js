'use strict';
/** A view of the wake from above: vorticity, the body, its jets as arrows, and its pressure sensors. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write, format} = stillwake;
  const ARROW = 1.6; // length of the arrow at the action's bound, in W
  const SHAFT = 0.05; // half the width of the arrow and of the slot, in W
  const NAMES_FROM = 56; // smallest scale at which names fit, in pixels per W

  const gradient = (words, colours) => {
    const bar = make('span', {class: 'scale'});
    bar.style.background = `linear-gradient(to right, ${colours})`;
    return [words[0], bar, words[1]];
  };

  stillwake.WakeView = class {
    /**
     * @param {Element} element to fill with the view.
     * @param {object} scene view [x0, x1, y0, y1] and outline of the body, in W; jets (upper, lower), sensors, names
     *   of the used sensors, action_limit.
     */
    constructor(element, scene) {
      this.canvas = make('canvas', {role: 'img', 'aria-label': 'The flow behind the truck'});
      this.legend = make('p', {class: 'legend note'});
      this.chips = make('ul', {class: 'sensors', 'aria-label': 'Sensors that the controller reads'});
      element.replaceChildren(make('div', {class: 'stage'}, this.canvas), this.legend, this.chips);
      this.request = stillwake.painter(this.canvas, () => this.draw());
      stillwake.onSize(this.canvas.parentElement, (width) => {
        this.width = width;
        this.fit();
      });
      stillwake.onTheme(() => {
        this.colourField();
        this.keys();
        this.request();
      });
      this.field = document.createElement('canvas');
      this.show(scene);
    }

    /** Shows another plant; the drawing of the previous plant is cleared. */
    show(scene) {
      const end = Math.max(...scene.body.map(([x]) => x));
      this.scene = {...scene, view: scene.view.length ? scene.view : [end - 3, end + 9, -2.25, 2.25]};
      this.levels = null;
      this.now = {action: null, cp: null, read: null, marks: {}, t: null};
      this.places = new Map(scene.sensors.map((sensor, i) => [sensor.name, i]));
      this.rows = scene.used.map((name) => {
        const [dot, value, mark] = ['dot', 'value', 'mark'].map((kind) => make('span', {class: kind}));
        this.chips.append(make('li', {}, dot, make('span', {class: 'name'}, name), value, mark));
        return {name, dot, value, mark};
      });
      this.chips.replaceChildren(...[...this.chips.children].slice(-this.rows.length));
      this.keys();
      this.fit();
    }

    /** Shows vorticity in levels -127..127, with the first row at the top; `levels` is null without a picture. */
    picture(levels, width, height) {
      if (!levels) {
        this.levels = null;
        this.request();
        return;
      }
      if (!this.levels || this.field.width !== width || this.field.height !== height) {
        [this.field.width, this.field.height] = [width, height];
        this.image = new ImageData(width, height);
      }
      this.levels = levels;
      this.stale = true;
      this.request();
    }

    /** Shows new values: action, cp of all sensors, read (readings of the used sensors), marks by sensor name, t. */
    state(now) {
      Object.assign(this.now, now);
      this.request();
    }

    /** Sets the text alternative of the picture. */
    describe(text) {
      if (this.canvas.getAttribute('aria-label') !== text) this.canvas.setAttribute('aria-label', text);
    }

    keys() {
      const limits = stillwake.PRESSURE_RANGE.map((value) => format.number(value, 1));
      const key = (...parts) => make('span', {class: 'key'}, ...parts);
      const jets = (kind, words) => key(make('i', {class: kind, 'aria-hidden': 'true'}), words);
      this.legend.replaceChildren(
        key(...gradient(['vorticity: clockwise', 'counter-clockwise'], stillwake.fieldGradient())),
        key(...gradient([`sensors: Cp ${limits[0]}`, limits[1]], stillwake.pressureGradient())),
        jets('blows', 'jet blows'),
        jets('sucks', 'jet sucks'),
      );
    }

    fit() {
      if (!this.width) return;
      const [x0, x1, y0, y1] = this.scene.view;
      this.scale = this.width / (x1 - x0);
      this.height = Math.round(this.scale * (y1 - y0));
      this.canvas.style.height = `${this.height}px`;
      this.request();
    }

    x(value) {
      return this.scale * (value - this.scene.view[0]);
    }

    y(value) {
      return this.scale * (this.scene.view[3] - value);
    }

    draw() {
      if (!this.width) return;
      const context = stillwake.context(this.canvas, this.width, this.height);
      context.fillStyle = stillwake.colour('--still');
      context.fillRect(0, 0, this.width, this.height);
      this.drawField(context);
      this.drawBody(context);
      this.scene.jets.forEach((place, i) => this.drawJet(context, place, i === 0 ? 1 : -1));
      this.drawSensors(context);
      this.report();
    }

    colourField() {
      if (!this.levels) return;
      const palette = stillwake.fieldPalette();
      const pixels = new Uint32Array(this.image.data.buffer);
      const levels = this.levels;
      for (let i = 0; i < levels.length; i += 1) pixels[i] = palette[levels[i] & 255];
      this.field.getContext('2d').putImageData(this.image, 0, 0);
      this.stale = false;
    }

    drawField(context) {
      if (!this.levels) {
        context.fillStyle = stillwake.colour('--dim');
        context.font = '13px system-ui, sans-serif';
        context.textAlign = 'center';
        context.fillText(this.scene.empty || 'no picture of the flow yet', 0.68 * this.width, 0.5 * this.height);
        return;
      }
      if (this.stale) this.colourField();
      context.imageSmoothingEnabled = true;
      context.imageSmoothingQuality = 'high';
      context.drawImage(this.field, 0, 0, this.width, this.height);
    }

    drawBody(context) {
      context.beginPath();
      this.scene.body.forEach(([x, y], i) => context[i ? 'lineTo' : 'moveTo'](this.x(x), this.y(y)));
      context.closePath();
      context.fillStyle = stillwake.colour('--body');
      context.strokeStyle = stillwake.colour('--edge');
      context.lineWidth = 1.5;
      context.fill();
      context.stroke();
    }

    /** Draws an arrow, away from the base for blowing and towards it for suction; its length shows the action. */
    drawJet(context, [x, y], side) {
      const share = format.is(this.now.action) ? (side * this.now.action) / this.scene.action_limit : 0;
      const blows = share >= 0;
      context.fillStyle = stillwake.colour(blows ? '--blow' : '--suck');
      const slot = Math.max(3, this.scale * SHAFT * 2);
      context.fillRect(this.x(x) - 2, this.y(y) - slot / 2, 4, slot);
      const length = ARROW * Math.abs(share);
      if (length < 0.02) return;
      const half = Math.max(SHAFT, 2.2 / this.scale);
      const head = Math.min(length, 3.2 * half);
      const [from, to] = blows ? [x, x + length] : [x + length, x];
      const neck = blows ? to - head : to + head;
      const points = [
        [from, half], [neck, half], [neck, 2.2 * half], [to, 0], [neck, -2.2 * half], [neck, -half], [from, -half],
      ];
      context.beginPath();
      points.forEach(([px, py], i) => context[i ? 'lineTo' : 'moveTo'](this.x(px), this.y(y + py)));
      context.closePath();
      context.strokeStyle = stillwake.colour('--still');
      context.lineWidth = 2;
      context.lineJoin = 'round';
      context.stroke();
      context.fill();
    }

    drawSensors(context) {
      const {sensors, used} = this.scene;
      sensors.forEach((sensor, i) => {
        if (!used.includes(sensor.name)) this.dot(context, sensor, i, Math.max(1.4, 0.022 * this.scale), 0);
      });
      for (const name of used) {
        const i = this.places.get(name);
        if (i === undefined) continue;
        const radius = Math.max(4.5, 0.075 * this.scale);
        this.dot(context, sensors[i], i, radius, 1.6);
        if (this.now.marks[name]) this.cross(context, sensors[i], radius + 3);
      }
      if (this.scale >= NAMES_FROM) this.drawNames(context);
    }

    dot(context, {x, y}, i, radius, ring) {
      const cp = this.now.cp ? this.now.cp[i] : null;
      context.beginPath();
      context.arc(this.x(x), this.y(y), radius, 0, 2 * Math.PI);
      context.fillStyle = format.is(cp) ? stillwake.pressureColour(cp) : stillwake.colour('--edge');
      context.fill();
      if (!ring) return;
      context.lineWidth = ring;
      context.strokeStyle = stillwake.colour('--ink');
      context.stroke();
    }

    /** Draws a cross over a sensor that reads wrongly or is excluded. */
    cross(context, {x, y}, size) {
      const [cx, cy] = [this.x(x), this.y(y)];
      for (const [width, colour] of [[5, '--body'], [2.5, '--alarm']]) {
        context.lineWidth = width;
        context.strokeStyle = stillwake.colour(colour);
        context.beginPath();
        context.moveTo(cx - size, cy - size);
        context.lineTo(cx + size, cy + size);
        context.moveTo(cx - size, cy + size);
        context.lineTo(cx + size, cy - size);
        context.stroke();
      }
    }

    /** Writes names inside the body, one below the other, each with a line to its sensor. */
    drawNames(context) {
      const named = this.scene.used
        .map((name) => this.scene.sensors[this.places.get(name)])
        .filter(Boolean)
        .sort((a, b) => b.y - a.y);
      const gap = Math.min(17, (0.86 * this.scale) / Math.max(1, named.length));
      const left = this.x(Math.max(...this.scene.body.map(([x]) => x))) - 0.42 * this.scale;
      context.font = `${Math.min(12.5, gap)}px system-ui, sans-serif`;
      context.textAlign = 'right';
      context.textBaseline = 'middle';
      named.forEach((sensor, i) => {
        const at = this.y(0) + gap * (i - (named.length - 1) / 2);
        const marked = this.now.marks[sensor.name];
        context.strokeStyle = stillwake.colour('--edge');
        context.lineWidth = 0.8;
        context.beginPath();
        context.moveTo(left + 4, at);
        context.lineTo(this.x(sensor.x) - 5, this.y(sensor.y));
        context.stroke();
        context.fillStyle = stillwake.colour(marked ? '--alarm' : '--ink');
        context.fillText(marked ? `${sensor.name}: ${marked}` : sensor.name, left, at);
      });
      context.textBaseline = 'alphabetic';
    }

    /** Returns a text with the reading of a used sensor if it differs from the wall pressure; otherwise ''. */
    misread(i, cp) {
      const read = this.now.read ? this.now.read[i] : null;
      return format.is(read) && format.is(cp) && Math.abs(read - cp) > 0.005 ? `reads ${format.number(read)}` : '';
    }

    report() {
      for (const [i, {name, dot, value, mark}] of this.rows.entries()) {
        const cp = this.now.cp ? this.now.cp[this.places.get(name)] : null;
        const colour = format.is(cp) ? stillwake.pressureColour(cp) : '';
        if (dot.style.background !== colour) dot.style.background = colour;
        write(value, format.number(cp, 2));
        write(mark, [this.now.marks[name], this.misread(i, cp)].filter(Boolean).join(', '));
      }
    }
  };
})();
