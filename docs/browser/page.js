'use strict';
/** The page: it runs a drive in real time, shows the frames on the bus, and applies the reader's settings. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write, format, Chart, Switch, Choice, Slider, SOUND} = stillwake;
  const at = (id) => document.getElementById(id);
  const SHOWN_S = 8;
  const REQUEST_S = 1;
  const RENEW_S = 0.2;
  const LONGEST_WAIT_MS = 100;
  const COLOURS = ['--curve', '--second', '--third', '--ahead'];
  const SHADED = {CONTROL: 'control', HOLD: 'hold', DECAY: 'hold', FAULT: 'fault'};
  const FAULTS = [
    {name: 'zero', label: 'reads 0 Pa'},
    {name: 'stuck', label: 'stands still'},
    {name: 'invalid', label: 'is marked invalid'},
  ];
  const FIGURES = {
    set_aside: 'sensors set aside',
    missed: 'periods without pressures',
    crc: 'frames with a wrong CRC',
    refused: 'frames refused',
    reason: 'reason on the bus',
  };

  stillwake.TryPage = class {
    constructor(ecu) {
      this.ecu = ecu;
      this.facts = ecu.facts;
      this.period_s = this.facts.period_ns / 1e9;
      this.number = 0;
      this.vehicle = new stillwake.Vehicle(ecu);
      this.values = [...this.facts.calibration];
      this.paused = matchMedia('(prefers-reduced-motion: reduce)').matches;
      this.fields = new Map();
      this.headline = new stillwake.Headline(at('headline'));
      this.states = new stillwake.StateMachine(at('states'));
      this.events = new stillwake.EventLog(at('events'));
      this.charts();
      this.controls();
      this.goal();
      this.buttons();
      write(at('release'), this.facts.release);
      this.begin();
      [this.last, this.due] = [performance.now(), 0];
      requestAnimationFrame((now) => this.tick(now));
    }

    charts() {
      const {sensors, action_limit: limit} = this.facts;
      this.pressures = new Chart(at('pressures'), {
        title: 'Pressures / Pa', x: false, height: 170, snap: 100, digits: 0, sync: 'try',
        series: sensors.map((label, i) => ({label, colour: COLOURS[i % COLOURS.length]})),
      });
      this.command = new Chart(at('command'), {
        title: 'Jet command / (m²/s)', height: 170, digits: 1, sync: 'try', least: -1.25 * limit, greatest: 1.25 * limit,
        series: [{label: 'of this ECU', colour: '--blow', step: true}, {label: 'recorded', colour: '--dim', dash: [3, 3]}],
        lines: [{value: limit, label: 'bound'}, {value: -limit}],
      });
    }

    controls() {
      const {sensors, speed, speeds} = this.facts;
      const range = speeds ? `The release serves ${speeds.map((one) => format.short(one)).join(' to ')} m/s.` : '';
      const names = [{name: '-1', label: 'none'}, ...sensors.map((label, i) => ({name: String(i), label}))];
      const share = {least: 0, greatest: 1, step: 0.05, unit: ''};
      const set = (name) => (value) => this.set(name, value);
      const request = {
        label: 'The vehicle requests control',
        help: 'Off: the ECU shuts the jets. After a FAULT, off and on again.',
      };
      const drive = new Choice({label: 'Recorded drive'}, this.facts.drives.map(({label}, i) => ({name: String(i), label})),
        (value) => this.begin(Number(value)));
      at('controls').replaceChildren(
        this.group('Vehicle',
          this.field('request', new Switch(request, set('request'))), drive.element,
          this.field('speed', new Slider(
            {label: 'Speed', help: `It changes by 5 m/s each second. ${range}`},
            {least: 0.4 * speed, greatest: 1.8 * speed, step: 0.02 * speed, unit: 'm/s'}, set('speed')))),
        this.group('Sensors',
          this.field('sensor', new Choice({label: 'Broken sensor'}, names, (value) => this.set('sensor', Number(value)))),
          this.field('fault', new Choice({label: 'What is wrong with it'}, FAULTS, set('fault')))),
        this.group('Bus',
          this.field('lost', new Slider({label: 'Lost pressure frames'}, share, set('lost'))),
          this.field('damaged', new Slider(
            {label: 'Damaged pressure frames', help: 'One bit is wrong.'}, share, set('damaged')))),
      );
    }

    goal() {
      const {terms, largest_weight: greatest} = this.facts;
      this.weights = terms.map((name, i) => new Slider({label: stillwake.WEIGHTS[name] || name},
        {least: 0, greatest, step: 0.01, unit: ''}, (value) => this.weigh(i, value), stillwake.byRatio(greatest)));
      const own = make('button', {type: 'button', id: 'own'}, 'The release’s goal');
      own.addEventListener('click', () => {
        this.values = [...this.facts.calibration];
        this.weigh(0, this.values[0]);
      });
      at('goal').replaceChildren(...this.weights.map((field) => field.element), make('div', {class: 'act'}, own));
    }

    buttons() {
      const theme = () => (document.documentElement.dataset.theme = stillwake.isDark() ? 'light' : 'dark');
      const pause = () => this.pause(!this.paused);
      const clear = () => this.clear();
      const actions = {pause, clear, theme, one: () => this.one(), again: () => this.begin()};
      for (const [id, act] of Object.entries(actions)) at(id).addEventListener('click', () => act());
      this.pause(this.paused);
    }

    group(name, ...items) {
      return make('fieldset', {}, make('legend', {}, name), ...items);
    }

    field(name, field) {
      this.fields.set(name, field);
      field.input.dataset.setting = name;
      return field.element;
    }

    set(name, value) {
      this.vehicle.settings[name] = value;
      for (const [key, field] of this.fields) field.show(this.vehicle.settings[key]);
    }

    weigh(number, value) {
      this.values[number] = value;
      const wrong = this.ecu.calibrate(this.values);
      if (wrong) this.note('set', `refused: value ${wrong} of the calibration is out of its range`);
      this.weights.forEach((field, i) => field.show(this.values[i]));
    }

    pause(paused) {
      this.paused = paused;
      at('pause').setAttribute('aria-pressed', String(paused));
      write(at('pause'), paused ? 'Go on' : 'Pause');
    }

    /** Powers the ECU on at the beginning of a drive; control is requested REQUEST_S later. */
    begin(number = this.number) {
      this.number = number;
      this.k = 0;
      this.rows = {t: [], flow: [], recorded: [], mode: [], pressures: this.facts.sensors.map(() => [])};
      this.vehicle.choose(number);
      this.events.clear();
      this.count = 0;
      this.powerOn();
      this.set('request', false);
      this.request_at = REQUEST_S;
      this.one();
    }

    powerOn() {
      this.ecu.powerOn();
      this.weigh(0, this.values[0]);
      this.state = this.aside = '';
      this.status = null;
    }

    /** Ends all faults and renews the request. A restart includes an excluded sensor again. */
    clear() {
      if (this.aside) this.powerOn();
      Object.assign(this.vehicle.settings, SOUND, {speed: this.facts.speed});
      this.set('request', false);
      this.request_at = this.time + RENEW_S;
    }

    get time() {
      return this.k * this.period_s;
    }

    tick(now) {
      this.due += this.paused ? 0 : Math.min(now - this.last, LONGEST_WAIT_MS) / 1e3 / this.period_s;
      this.last = now;
      for (; this.due >= 1; this.due -= 1) this.period();
      this.show();
      requestAnimationFrame((later) => this.tick(later));
    }

    one() {
      this.period();
      this.show();
    }

    /** Simulates one control period of the vehicle and the ECU. */
    period() {
      if (this.vehicle.ended) this.begin();
      if (this.time >= this.request_at) {
        this.request_at = Infinity;
        this.set('request', true);
        this.note('vehicle', 'The vehicle requests control.');
      }
      const {messages, modes} = this.facts;
      const resolution = messages.pressure.signals.Pressure0[3];
      const pressures = this.vehicle.pressures().map((steps) => steps * resolution);
      const recorded = this.vehicle.command;
      const frames = this.vehicle.frames();
      const began = performance.now();
      const answers = this.ecu.step(this.k, frames);
      this.cost = 0.95 * (this.cost ?? performance.now() - began) + 0.05 * (performance.now() - began);
      const heard = (message) => {
        const frame = answers.find(({id}) => id === message.id);
        return frame && stillwake.signalsOf(message, frame.data);
      };
      this.status = heard(messages.status) || this.status;
      const command = heard(messages.command);
      const {rows} = this;
      rows.t.push(this.time);
      rows.flow.push(command ? command.Flow : null);
      rows.recorded.push(recorded);
      rows.mode.push(command ? modes[command.Mode] : '');
      pressures.forEach((value, i) => rows.pressures[i].push(value));
      this.noticed();
      this.k += 1;
    }

    noticed() {
      const {state} = this.ecu;
      const reason = this.reason[1];
      if (state !== this.state) this.note('state', `${this.state || 'power-on'} → ${state}${reason ? `: ${reason}` : ''}`);
      const aside = this.aside_names.join(' and ');
      if (aside !== this.aside) this.note('state', aside ? `sets ${aside} aside` : 'uses all sensors again');
      [this.state, this.aside] = [state, aside];
    }

    get reason() {
      return this.facts.reasons[this.status ? this.status.Reason : this.facts.none];
    }

    get aside_names() {
      return this.facts.sensors.filter((_, i) => this.status && this.status[`SetAside${i}`]);
    }

    note(kind, text) {
      this.count += 1;
      this.events.add([{n: this.count, t: this.time, kind, text}]);
    }

    show() {
      const {rows, facts} = this;
      const first = Math.max(0, rows.t.length - SHOWN_S / this.period_s);
      const cut = (list) => list.slice(first);
      const times = cut(rows.t);
      const to = Math.max(SHOWN_S, this.time);
      this.pressures.data([times, ...rows.pressures.map(cut)]);
      this.command.data([times, cut(rows.flow), cut(rows.recorded)]);
      for (const chart of [this.pressures, this.command]) {
        chart.window(to - SHOWN_S, to);
        chart.shade(this.spans(times, cut(rows.mode)));
      }
      const {Missed, CrcErrors, Refused} = this.status || {};
      const flow = rows.flow.at(-1);
      this.pressures.report(`${rows.pressures.map((list) => format.number(list.at(-1), 0)).join(' · ')} Pa`);
      this.command.report(`${format.number(flow, 2)} m²/s`);
      this.states.show(this.state, this.reason[1]);
      const now = {state: this.state, reason: this.reason[0], set_aside: this.aside_names, paused: this.paused};
      const reasons = Object.fromEntries(Object.values(facts.reasons));
      this.headline.show({used: facts.sensors, answers_jets: false, reasons}, now);
      write(at('clock'), `${format.number(this.time, 1)} s`);
      write(at('cost'), `${format.number(this.cost, 1)} ms a step of ${format.short(facts.period_ns / 1e6)}`);
      const [reason] = this.reason;
      const figures = {set_aside: this.aside || 'none', missed: Missed, crc: CrcErrors, refused: Refused, reason};
      const pairs = Object.entries(FIGURES).map(([name, label]) => [label, String(figures[name] ?? format.NONE)]);
      const text = JSON.stringify(pairs);
      if (text === this.shown) return;
      this.shown = text;
      at('figures').replaceChildren(...pairs.map((pair) => make('div', {}, make('dt', {}, pair[0]), make('dd', {}, pair[1]))));
    }

    spans(times, modes) {
      const spans = [];
      modes.forEach((mode, i) => {
        const kind = SHADED[mode];
        const end = times[i] + this.period_s;
        if (kind && spans.at(-1)?.kind === kind && modes[i - 1] && SHADED[modes[i - 1]] === kind) spans.at(-1).to = end;
        else if (kind) spans.push({from: times[i], to: end, kind});
      });
      return spans;
    }
  };

  const failed = (error) => at('headline').replaceChildren(make('p', {class: 'sentence', role: 'alert'}, String(error)));
  stillwake.EcuInWasm.load(globalThis.stillwakeProgram)
    .then((ecu) => (stillwake.page = new stillwake.TryPage(ecu)))
    .catch(failed);
})();
