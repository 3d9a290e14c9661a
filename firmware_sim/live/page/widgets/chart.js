'use strict';
/** A chart of curves over time, drawn with uPlot, with level lines, shaded spans and a cursor. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write, format} = stillwake;
  const SHADES = {control: '--wash', hold: '--amber-wash', fault: '--alarm-wash'};
  const FONT = '11px system-ui, sans-serif';
  /** Pixels at the right of the plot: half the width of the last time label, which has at most five characters. */
  const EDGE = 18;

  stillwake.Chart = class {
    /**
     * @param {Element} element to fill with the chart.
     * @param {object} what title, series [{label, colour, dash, width, step, gaps}] (`gaps` 'join' draws across
     *   nulls), lines [{label, value, colour}], least and greatest of the axis (otherwise multiples of `snap` around
     *   the data), height, sync (charts with equal sync share a cursor), x (whether times are labelled), onPick.
     */
    constructor(element, what) {
      this.what = {height: 150, snap: 0.1, x: true, digits: 2, ...what};
      this.spans = [];
      this.lineList = what.lines || [];
      this.range = [0, 1];
      this.at = null;
      this.readout = make('span', {class: 'readout'});
      this.box = make('div', {class: 'plot', role: 'img', 'aria-label': what.title});
      element.replaceChildren(this.head(), this.box);
      this.given = [[], ...this.what.series.map(() => [])];
      this.plot = new uPlot(this.options(), this.given, this.box);
      this.request = stillwake.painter(this.box, () => this.plot.setData(this.given));
      stillwake.onSize(this.box, (width) => width && this.plot.setSize({width, height: this.what.height}));
      stillwake.onTheme(() => this.plot.redraw(false));
      if (this.what.onPick) {
        this.plot.over.addEventListener('click', () => {
          if (this.plot.cursor.left >= 0) this.what.onPick(this.plot.posToVal(this.plot.cursor.left, 'x'));
        });
      }
    }

    /** Shows aligned lists: the times, then one list for each series; null marks a missing value. */
    data(lists) {
      this.given = lists;
      this.request();
    }

    /** Sets the times at the ends of the axis. */
    window(from, to) {
      this.range = [from, to];
      this.request();
    }

    /** Shades spans [{from, to, kind}], where `kind` is control, hold or fault. */
    shade(spans) {
      this.spans = spans;
      this.request();
    }

    lines(lines) {
      this.lineList = lines;
      this.request();
    }

    /** Draws a vertical line at this time; null removes the line. */
    cursor(t) {
      this.at = t;
      this.request();
    }

    describe(text) {
      this.box.setAttribute('aria-label', text);
    }

    /** Shows the latest values, as text, next to the title. */
    report(text) {
      write(this.readout, text);
    }

    head() {
      const keys = this.what.series
        .filter((item) => item.label)
        .map((item) => {
          const mark = make('i', {class: item.dash ? 'dashed' : '', 'aria-hidden': 'true'});
          mark.style.borderTopColor = `var(${item.colour})`;
          return make('span', {class: 'key'}, mark, item.label);
        });
      const title = make('strong', {}, this.what.title);
      return make('p', {class: 'chart-head'}, title, this.readout, make('span', {class: 'keys note'}, ...keys));
    }

    options() {
      const {series, height, sync, x, digits} = this.what;
      const times = (t) => format.short(t);
      // Between multiples of 0.05 or 0.1 the usual decimals are enough, but not between multiples of 0.025.
      const decimals = (step) => Math.max(digits, (String(step).split('.')[1] ?? '').length);
      const levels = (ticks, step) => ticks.map((y) => format.number(y, decimals(step)));
      const axis = {
        stroke: () => stillwake.colour('--dim'),
        font: FONT,
        grid: {stroke: () => stillwake.colour('--line'), width: 1},
        ticks: {show: false},
      };
      return {
        width: 300, height,
        padding: [6, EDGE, x ? 0 : 4, 0],
        legend: {show: false},
        cursor: {y: false, drag: {x: false, y: false}, points: {size: 6}, sync: sync ? {key: sync} : undefined},
        scales: {
          x: {time: false, range: () => this.range},
          y: {range: (_, least, greatest) => this.fit(least, greatest)},
        },
        axes: [
          {...axis, size: x ? 24 : 0, gap: 3, space: 60, values: (_, ticks) => (x ? ticks.map(times) : [])},
          {...axis, size: 46, gap: 4, space: 17, values: (_, ticks, place, space, step) => levels(ticks, step)},
        ],
        series: [
          {},
          ...series.map(({label, colour, width, dash, step, gaps}) => ({
            label,
            stroke: () => stillwake.colour(colour),
            width: width || 1.5,
            dash,
            points: {show: false},
            spanGaps: gaps === 'join',
            paths: step ? uPlot.paths.stepped({align: 1}) : undefined,
          })),
        ],
        hooks: {drawClear: [(plot) => this.drawSpans(plot)], draw: [(plot) => this.drawLines(plot)]},
      };
    }

    fit(least, greatest) {
      const {snap} = this.what;
      const levels = this.lineList.map((line) => line.value).filter((value) => format.is(value));
      const low = this.what.least ?? Math.min(least ?? Infinity, ...levels);
      const high = this.what.greatest ?? Math.max(greatest ?? -Infinity, ...levels);
      if (!format.is(low) || !format.is(high)) return [0, 1];
      return [
        this.what.least ?? snap * Math.floor(low / snap - 0.2),
        this.what.greatest ?? snap * Math.ceil(high / snap + 0.2),
      ];
    }

    drawSpans(plot) {
      const {ctx, bbox} = plot;
      for (const {from, to, kind} of this.spans) {
        const left = Math.max(bbox.left, plot.valToPos(from, 'x', true));
        const right = Math.min(bbox.left + bbox.width, plot.valToPos(to, 'x', true));
        if (!(right > left)) continue;
        ctx.fillStyle = stillwake.colour(SHADES[kind]);
        ctx.fillRect(left, bbox.top, right - left, bbox.height);
      }
    }

    drawLines(plot) {
      const {ctx, bbox} = plot;
      const fine = plot.pxRatio || globalThis.devicePixelRatio || 1;
      ctx.save();
      ctx.lineWidth = fine;
      for (const {label, value, colour} of this.lineList) {
        if (!format.is(value)) continue;
        const y = Math.round(plot.valToPos(value, 'y', true));
        ctx.strokeStyle = ctx.fillStyle = stillwake.colour(colour || '--dim');
        ctx.setLineDash([5 * fine, 4 * fine]);
        this.stroke(ctx, [bbox.left, y], [bbox.left + bbox.width, y]);
        if (!label) continue;
        ctx.font = `${11 * fine}px system-ui, sans-serif`;
        // The label is at the newest end of the line. A curve that began at the line has usually left the line there.
        ctx.textAlign = 'right';
        const end = bbox.left + bbox.width - 6 * fine;
        ctx.setLineDash([]);
        ctx.strokeStyle = stillwake.colour('--panel');
        ctx.lineWidth = 4 * fine;
        ctx.strokeText(label, end, y - 4 * fine);
        ctx.lineWidth = fine;
        ctx.fillText(label, end, y - 4 * fine);
      }
      if (format.is(this.at)) {
        const x = Math.round(plot.valToPos(this.at, 'x', true));
        ctx.setLineDash([]);
        ctx.strokeStyle = stillwake.colour('--accent');
        this.stroke(ctx, [x, bbox.top], [x, bbox.top + bbox.height]);
      }
      ctx.restore();
    }

    stroke(ctx, from, to) {
      ctx.beginPath();
      ctx.moveTo(...from);
      ctx.lineTo(...to);
      ctx.stroke();
    }
  };
})();
