'use strict';
/** The curves of drag, base pressure and action, with the uncontrolled drag, the plan, and shading of the modes. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, format} = stillwake;
  /** Shading of a span with a constant mode, by the mode's number in `can_bridge.wire.messages.Mode`. */
  const SHADED = {2: 'control', 3: 'hold', 4: 'hold', 5: 'fault'};

  /** Returns the first index with times[i] >= t. */
  const since = (times, t) => {
    let [low, high] = [0, times.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < t) low = middle + 1;
      else high = middle;
    }
    return low;
  };

  stillwake.Curves = class {
    /** @param {object} what action_limit in U_inf W, period in t_c, planned (whether plans are shown), onPick. */
    constructor(element, {action_limit, period, planned = true, onPick, height = 150}) {
      this.period = period;
      const places = [0, 1, 2].map(() => make('div', {class: 'chart'}));
      element.replaceChildren(...places, make('p', {class: 'note axis'}, 'time, t / (W / U∞)'));
      const common = {sync: `curves-${(stillwake.Curves.count = (stillwake.Curves.count || 0) + 1)}`, onPick, height};
      this.drag = new stillwake.Chart(places[0], {
        ...common, title: 'Drag Cd', x: false,
        series: [
          {label: 'measured', colour: '--curve'},
          {label: planned ? 'forecast' : '', colour: '--ahead', dash: [3, 3]},
        ],
      });
      this.pressure = new stillwake.Chart(places[1], {
        ...common, title: 'Base pressure Cp', x: false, height: Math.round(0.75 * height),
        series: [{label: 'mean over the base', colour: '--second'}],
      });
      this.action = new stillwake.Chart(places[2], {
        ...common, title: 'Action / (U∞ W)', digits: 3, least: -1.25 * action_limit, greatest: 1.25 * action_limit,
        series: [
          {label: 'of the jets', colour: '--blow'},
          {label: planned ? 'planned' : '', colour: '--ahead', dash: [3, 3]},
        ],
        lines: [{value: action_limit, label: 'bound'}, {value: -action_limit}],
      });
      this.charts = [this.drag, this.pressure, this.action];
      this.columns = {t: []};
      this.plan = null;
      this.range = [0, 1];
      this.request = stillwake.painter(element, () => this.lay());
    }

    /** Shows columns of the periods, lists of equal length, with null for a missing value. */
    data(columns) {
      this.columns = columns;
      this.request();
    }

    /** Shows {uncontrolled_Cd}: the mean drag without control, or null. */
    truth({uncontrolled_Cd}) {
      const known = format.is(uncontrolled_Cd);
      const label = `mean without control ${format.number(uncontrolled_Cd, 3)}`;
      this.drag.lines(known ? [{value: uncontrolled_Cd, label}] : []);
    }

    /** Shows {plan, forecast ([Cd, Cl] each), from_t: time of the first planned value}; null removes the plan. */
    ahead(plan) {
      this.plan = plan;
      this.request();
    }

    window(from, to) {
      this.range = [from, to];
      this.request();
    }

    cursor(t) {
      this.charts.forEach((chart) => chart.cursor(t));
    }

    lay() {
      const {t} = this.columns;
      const [first, last] = [Math.max(0, since(t, this.range[0]) - 1), Math.min(t.length, since(t, this.range[1]) + 1)];
      const cut = (name) => (this.columns[name] || []).slice(first, last);
      const times = cut('t');
      const plan = this.plan && this.plan.plan.length ? this.plan : null;
      const later = plan ? plan.plan.map((_, i) => plan.from_t + i * this.period) : [];
      const none = (count) => new Array(count).fill(null);
      const [before, after] = [none(times.length), none(later.length)];
      const all = [...times, ...later];
      const Cd = cut('Cd');
      const action = cut('action');
      const spans = this.spans(times, cut('mode'));
      const forecasts = plan && plan.forecast.length === later.length ? plan.forecast.map(([cd]) => cd) : after;
      this.drag.data([all, [...Cd, ...after], [...before, ...forecasts]]);
      this.pressure.data([times, cut('base_Cp')]);
      this.action.data([all, [...action, ...after], [...before, ...(plan ? plan.plan : after)]]);
      for (const chart of this.charts) {
        chart.window(...this.range);
        chart.shade(spans);
      }
    }

    spans(times, modes) {
      const spans = [];
      for (let i = 0; i < times.length; i += 1) {
        const kind = SHADED[modes[i]];
        if (!kind) continue;
        const last = spans.at(-1);
        const end = times[i] + this.period;
        if (last && last.kind === kind && times[i] - last.to < 0.5 * this.period) last.to = end;
        else spans.push({from: times[i], to: end, kind});
      }
      return spans;
    }
  };
  stillwake.Curves.SHADED = SHADED;
})();
