'use strict';
/** A view of the wake of one run in one control period, with the other data of this period. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {format} = stillwake;
  const QUIET_MS = 600; // time without a change after which the text alternative is set, for screen readers

  stillwake.RunView = class {
    /** @param {Element|null} element for the wake. @param {object} run from `firmware_sim.runs.run_page.run_data`. */
    constructor(element, run) {
      this.run = run;
      this.count = run.columns.t.length;
      this.waiting = 0;
      if (!run.wake || !element) return;
      this.view = new stillwake.WakeView(element, run.scene);
      this.recorded = new stillwake.RecordedWake(run.wake);
      const places = new Map(run.scene.sensors.map((sensor, i) => [sensor.name, i]));
      this.columns = run.sensors.map((name) => places.get(name));
    }

    mode(k) {
      return (this.run.spans.find(([, first, after]) => first <= k && k < after) || ['', 0, 0])[0];
    }

    /** Returns a text of one line about a period. */
    words(k) {
      const {t, Cd, action} = this.run.columns;
      const parts = [`t = ${format.number(t[k], 1)} W/U∞`, this.mode(k), `Cd ${format.number(Cd[k], 3)}`];
      return [...parts, `action ${format.signed(action[k], 3)}`].join(', ');
    }

    /** Returns the disturbances of a period by sensor name. */
    marks(k) {
      const now = this.run.marks.filter(([, , first, after]) => first <= k && k < after);
      return Object.fromEntries(now.map(([name, kind]) => [name, kind]));
    }

    show(k) {
      if (!this.view) return;
      const {columns, wall, scene} = this.run;
      const cp = new Array(scene.sensors.length).fill(null);
      if (wall) this.columns.forEach((place, i) => (cp[place] = wall[i][k]));
      this.view.state({action: columns.action[k], cp, t: columns.t[k], marks: this.marks(k)});
      this.recorded.show(k, (levels, width, height) => this.view.picture(levels, width, height));
      clearTimeout(this.waiting);
      this.waiting = setTimeout(() => this.view.describe(`Vorticity behind the body. ${this.words(k)}`), QUIET_MS);
    }
  };
})();
