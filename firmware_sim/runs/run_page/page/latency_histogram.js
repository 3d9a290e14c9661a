'use strict';
/** A histogram of the durations of the control steps, with their budget. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write, format} = stillwake;
  const HEIGHT = 130;
  const [LEFT, RIGHT, TOP, BOTTOM] = [8, 16, 16, 18];

  stillwake.LatencyHistogram = class {
    constructor(element) {
      this.canvas = make('canvas', {role: 'img', 'aria-label': 'Histogram of the control step’s time'});
      this.values = Object.fromEntries(['p50', 'p99', 'max', 'over', 'jets'].map((name) => [name, make('dd')]));
      const terms = {p50: 'median', p99: '99 %', max: 'longest', over: 'over budget', jets: 'sample to jets'};
      const list = make('dl', {class: 'figures'});
      for (const [name, value] of Object.entries(this.values)) {
        list.append(make('div', {}, make('dt', {}, terms[name]), value));
      }
      this.of = make('p', {class: 'note'});
      element.replaceChildren(make('div', {class: 'stage'}, this.canvas), list, this.of);
      this.canvas.style.height = `${HEIGHT}px`;
      this.request = stillwake.painter(this.canvas, () => this.draw());
      stillwake.onSize(this.canvas.parentElement, (width) => {
        this.width = width;
        this.request();
      });
      stillwake.onTheme(() => this.request());
    }

    /** Shows {edges, counts, budget_ms, p50, p99, max, over_budget, of, sample_to_jets_ms}, with times in ms. */
    show(latency) {
      this.latency = latency;
      const {p50, p99, max, over_budget: over, budget_ms: budget} = latency;
      const ms = (value) => (format.is(value) ? `${format.number(value, 2)} ms` : format.NONE);
      const jets = ms(latency.sample_to_jets_ms);
      const texts = {p50: ms(p50), p99: ms(p99), max: ms(max), over: format.count(over), jets};
      for (const [name, text] of Object.entries(texts)) write(this.values[name], text);
      const beyond = max > latency.edges.at(-1) ? '; the last bar: that or longer' : '';
      write(this.of, latency.of ? `${latency.of}; budget ${format.short(budget)} ms${beyond}` : '');
      this.request();
    }

    draw() {
      if (!this.width) return;
      const context = stillwake.context(this.canvas, this.width, HEIGHT);
      context.clearRect(0, 0, this.width, HEIGHT);
      if (!this.latency) return;
      const {edges, counts, budget_ms: budget} = this.latency;
      const filled = counts.reduce((last, count, i) => (count ? i + 1 : last), 0);
      const end = Math.max(1.15 * budget, edges[filled] || 0);
      const most = Math.max(1, ...counts);
      const x = (ms) => LEFT + ((this.width - LEFT - RIGHT) * ms) / end;
      const floor = HEIGHT - BOTTOM;
      context.font = '11px system-ui, sans-serif';
      context.fillStyle = stillwake.colour('--dim');
      context.textAlign = 'center';
      const step = [0.5, 1, 2, 5, 10, 20, 50, 100].find((size) => end / size <= 8) || 200;
      for (let ms = 0; ms <= end; ms += step) context.fillText(`${format.short(ms)}`, x(ms), HEIGHT - 4);
      context.fillStyle = stillwake.colour('--line');
      context.fillRect(LEFT, floor, this.width - LEFT - RIGHT, 1);
      counts.forEach((count, i) => {
        if (!count) return;
        // Every bar has a smallest height, so that a single slow step is visible among thousands.
        const high = Math.max(2, (floor - TOP) * (count / most));
        context.fillStyle = stillwake.colour(edges[i + 1] > budget ? '--alarm' : '--second');
        context.fillRect(x(edges[i]), floor - high, Math.max(1, x(edges[i + 1]) - x(edges[i]) - 0.5), high);
      });
      context.fillStyle = stillwake.colour('--alarm');
      context.fillRect(x(budget), 4, 1.5, floor - 4);
      context.textAlign = 'right';
      context.fillText(`budget ${format.short(budget)} ms`, x(budget) - 5, 13);
      this.describe();
    }

    describe() {
      const {p50, p99, budget_ms: budget} = this.latency;
      const [half, most, limit] = [format.number(p50, 1), format.number(p99, 1), format.short(budget)];
      const label = `Control step: median ${half} ms, 99 % within ${most} ms, budget ${limit} ms`;
      if (this.canvas.getAttribute('aria-label') !== label) this.canvas.setAttribute('aria-label', label);
    }
  };
})();
