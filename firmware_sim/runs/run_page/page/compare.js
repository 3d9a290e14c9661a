'use strict';
/** The page that compares several runs on one time axis. The axis begins at the request for control. */
(() => {
  const {make, write, format} = stillwake;
  const runs = JSON.parse(document.getElementById('runs').textContent);
  const place = (name) => document.getElementById(name);
  const COLOURS = ['--curve', '--second', '--blow', '--third', '--accent', '--suck'];
  const CHARTS = [
    ['Drag Cd', 'Cd', {}],
    ['Lift Cl', 'Cl', {snap: 0.5}],
    ['Base pressure Cp', 'base_Cp', {}],
    ['Action / (U∞ W)', 'action', {snap: 0.02, digits: 3}],
  ];

  /** The runs on the common time axis. `at` returns the period at a time: -1 before the run, `count` after its end. */
  const lined = runs.map((run) => {
    const {t} = run.columns;
    const zero = t[run.requested ?? 0];
    const [count, first] = [t.length, t[0] - zero];
    const at = (time) => Math.max(-1, Math.min(count, Math.round((time - first) / run.period)));
    return {run, count, first, last: t[count - 1] - zero, at};
  });
  const period = Math.min(...runs.map((run) => run.period));
  const first = Math.min(...lined.map((one) => one.first));
  const last = Math.max(...lined.map((one) => one.last));
  const count = Math.round((last - first) / period) + 1;
  const times = Array.from({length: count}, (_, i) => first + i * period);

  const value = ({run, at}, column, time) => run.columns[column][at(time)] ?? null;
  /** The period of the request for control; `apart` is the first period in which two runs differ, or -1. */
  const asked = Math.round(-first / period);
  const apart = times.findIndex((time) =>
    CHARTS.some(([, column]) => lined.some((one) => value(one, column, time) !== value(lined[0], column, time))),
  );

  document.documentElement.classList.add('scripted');
  const pick = (time) => player.go((time - first) / period);
  const views = lined.map(({run}, i) => new stillwake.RunView(place(`wake-${i + 1}`), run));
  const strips = lined.map(
    ({run, ...one}, i) =>
      new stillwake.ModeStrip(place(`modes-${i + 1}`), {count: one.count, spans: run.spans}, (k) => pick(one.first + k * run.period)),
  );
  const charts = CHARTS.map(([title, column, how], i) => {
    const box = make('div', {class: 'chart'});
    place('charts').append(box);
    const chart = new stillwake.Chart(box, {
      title, height: 150, x: i === CHARTS.length - 1, sync: 'runs', onPick: pick, ...how,
      series: runs.map((run, n) => ({label: i ? '' : run.name, colour: COLOURS[n]})),
    });
    chart.data([times, ...lined.map((one) => times.map((time) => value(one, column, time)))]);
    chart.window(first, last + period);
    return chart;
  });
  place('charts').append(make('p', {class: 'note axis'}, 'time since control was requested, t / (W / U∞)'));

  /** Returns a text about one run at an instant. */
  const words = ({run, count: periods, at}, view, time) => {
    const k = at(time);
    if (k < 0) return 'not begun yet';
    if (k >= periods) return 'has ended';
    return `${view.mode(k)}, Cd ${format.number(run.columns.Cd[k], 3)}`;
  };
  const player = new stillwake.Player(place('player'), {
    count,
    period,
    marks: [['Start', 0], ['Control requested', asked], ...(apart < 0 ? [] : [['First difference', apart]]), ['End', count - 1]],
    words: (i) => {
      const time = `t = ${format.signed(times[i], 1)} W/U∞`;
      return [time, ...lined.map((one, n) => `${one.run.name}: ${words(one, views[n], times[i])}`)].join('; ');
    },
    onChange: (i) => {
      lined.forEach((one, n) => {
        const k = Math.max(0, Math.min(one.count - 1, one.at(times[i])));
        views[n].show(k);
        strips[n].cursor(k);
        write(place(`now-${n + 1}`), words(one, views[n], times[i]));
      });
      charts.forEach((chart) => chart.cursor(times[i]));
    },
  });
  player.go(apart < 0 ? asked : apart);
})();
