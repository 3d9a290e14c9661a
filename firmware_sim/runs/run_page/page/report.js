'use strict';
/** The page of one run. */
(() => {
  const run = JSON.parse(document.getElementById('run').textContent);
  const place = (name) => document.getElementById(name);
  const {t} = run.columns;
  const count = t.length;
  const {requested} = run;

  /** Returns the number of the period at a time. */
  const at = (time) => Math.max(0, Math.min(count - 1, Math.floor((time - t[0]) / run.period + 0.5)));

  document.documentElement.classList.add('scripted');
  if (run.wake) document.documentElement.classList.add('with-wake');
  const view = new stillwake.RunView(place('wake'), run);
  const pick = (time) => player.go(at(time));
  const curves = new stillwake.Curves(place('curves'), {
    action_limit: run.action_limit, period: run.period, planned: false, onPick: pick,
  });
  const lift = new stillwake.Chart(place('lift'), {
    title: 'Lift Cl', x: false, height: 110, snap: 0.5, onPick: pick, series: [{label: '', colour: '--curve'}],
    lines: [{value: 0}],
  });
  // A run at constant speed has no chart of the speed.
  const speed = run.drive === null ? null : new stillwake.Chart(place('speed'), {
    title: `Speed of the vehicle / (m/s), drive ${run.drive}`, x: false, height: 110, snap: 5, onPick: pick,
    series: [{label: '', colour: '--second'}],
  });
  const strip = new stillwake.ModeStrip(place('modes'), {count, spans: run.spans}, (k) => player.go(k));
  const player = new stillwake.Player(place('player'), {
    count,
    period: run.period,
    marks: [['Start', 0], ...(requested === null ? [] : [['Control requested', requested]]), ['End', count - 1]],
    words: (k) => view.words(k),
    onChange: (k) => {
      view.show(k);
      strip.cursor(k);
      curves.cursor(t[k]);
      lift.cursor(t[k]);
      if (speed) speed.cursor(t[k]);
    },
  });
  const ends = [t[0], t[count - 1] + run.period];
  curves.data(run.columns);
  curves.truth({uncontrolled_Cd: run.uncontrolled_Cd});
  curves.window(...ends);
  lift.data([t, run.columns.Cl]);
  lift.window(...ends);
  if (speed) {
    speed.data([t, run.columns.speed]);
    speed.window(...ends);
  }
  new stillwake.LatencyHistogram(place('latency')).show(run.latency);
  const log = new stillwake.EventLog(place('events'), {kept: run.events.length, onPick: pick});
  log.add(run.events.map(([k, kind, text], n) => ({n, kind, text, t: t[k], time_s: k * run.period_s})));
  player.go(requested ?? 0);
})();
