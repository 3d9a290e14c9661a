'use strict';
/** The ECU's modes over a run as a strip of colours, with the present time; a click selects a time. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make} = stillwake;
  const HEIGHT = 22;
  /** Modes in the order of the legend, each with the property of report.css that has its colour. */
  const COLOURS = {
    OFF: '--mode-off', WARMUP: '--mode-warmup', CONTROL: '--mode-control', HOLD: '--mode-hold', DECAY: '--mode-decay',
    FAULT: '--mode-fault', SKIPPED: '--mode-skipped',
  };

  stillwake.ModeStrip = class {
    /**
     * @param {object} run number of periods, spans [[mode, first period, period after the last]].
     * @param {function} onPick called with the clicked period.
     */
    constructor(element, {count, spans}, onPick = null) {
      [this.count, this.spans, this.at] = [count, spans, null];
      this.canvas = make('canvas', {class: 'mode-strip', role: 'img', 'aria-label': this.words()});
      element.replaceChildren(make('div', {class: 'stage'}, this.canvas), this.key());
      this.canvas.style.height = `${HEIGHT}px`;
      this.request = stillwake.painter(this.canvas, () => this.draw());
      stillwake.onSize(this.canvas.parentElement, (width) => {
        this.width = width;
        this.request();
      });
      stillwake.onTheme(() => this.request());
      if (onPick) {
        this.canvas.addEventListener('click', (event) => {
          onPick(Math.min(count - 1, Math.floor((count * event.offsetX) / this.canvas.clientWidth)));
        });
      }
    }

    cursor(period) {
      this.at = period;
      this.request();
    }

    totals() {
      const totals = new Map();
      for (const [mode, first, after] of this.spans) totals.set(mode, (totals.get(mode) || 0) + after - first);
      return Object.keys(COLOURS).filter((mode) => totals.has(mode)).map((mode) => [mode, totals.get(mode)]);
    }

    words() {
      return `Modes of the ECU: ${this.totals().map(([mode, periods]) => `${mode} for ${periods} periods`).join(', ')}`;
    }

    key() {
      const items = this.totals().map(([mode]) => {
        const mark = make('i', {'aria-hidden': 'true'});
        mark.style.background = `var(${COLOURS[mode]})`;
        return make('span', {class: 'key'}, mark, mode);
      });
      return make('p', {class: 'mode-keys note'}, 'mode of the ECU: ', ...items);
    }

    draw() {
      if (!this.width) return;
      const context = stillwake.context(this.canvas, this.width, HEIGHT);
      context.clearRect(0, 0, this.width, HEIGHT);
      const scale = this.width / this.count;
      for (const [mode, first, after] of this.spans) {
        context.fillStyle = stillwake.colour(COLOURS[mode] || '--mode-off');
        context.fillRect(scale * first, 3, Math.max(0.5, scale * (after - first)), HEIGHT - 6);
      }
      if (this.at === null) return;
      context.fillStyle = stillwake.colour('--ink');
      context.fillRect(scale * (this.at + 0.5) - 1, 0, 2, HEIGHT);
    }
  };
})();
