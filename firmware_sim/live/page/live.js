'use strict';
/** The live page. It passes the messages of the channels to the widgets. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {write, format} = stillwake;
  const at = (id) => document.getElementById(id);
  const SPEAK_MS = 5000; // shortest time between changes of a picture's text alternative

  stillwake.LivePage = class {
    constructor() {
      this.stream = new stillwake.Stream((type, message) => this.came(type, message));
      this.requests = new stillwake.Requests(stillwake.channelUrl('control'));
      this.channel = new stillwake.Channel(stillwake.channelUrl('stream'), (what, data) => this.heard(what, data));
      this.headline = new stillwake.Headline(at('headline'));
      this.states = new stillwake.StateMachine(at('states'));
      this.bus = new stillwake.BusTable(at('bus'));
      this.events = new stillwake.EventLog(at('events'), {live: true});
      this.toolbar = new stillwake.Toolbar(this);
      this.request = stillwake.painter(document.body, () => this.draw());
      this.drawn = new stillwake.Rate();
      this.spoken = -Infinity;
      this.slow = false;
      this.span = Number(at('span').value);
      at('span').addEventListener('change', () => {
        this.span = Number(at('span').value);
        this.request();
      });
    }

    /** Sends a request to the loop, and shows an error to the viewer. */
    async ask(request) {
      const answer = await this.requests.ask(request);
      this.toolbar.answer(answer);
      if (answer.error && this.settings) this.controls?.show(this.settings);
      return answer;
    }

    heard(what, data) {
      if (what === 'message') {
        document.body.dataset.connection = 'live';
        this.stream.take(data);
      } else if (what === 'closed') {
        document.body.dataset.connection = 'lost';
        this.stream.now = null; // after a reconnection, another loop may answer
        const again = `trying again in ${format.number(data.wait_ms / 1000, 1)} s`;
        write(at('connection'), `${data.reason || 'no connection'}; ${again}`);
        this.headline.report({kind: 'lost', text: 'The loop cannot be reached. This page tries again by itself.'});
      } else {
        write(at('connection'), 'connected');
      }
    }

    came(type, message) {
      if (type === 'loop') this.wait(message);
      else if (type === 'hello') this.begin(message);
      else if (!this.stream.hello) return;
      else if (type === 'picture') this.wake.picture(message.levels, message.width, message.height);
      else if (type === 'bus') this.bus.show(message);
      else if (type === 'events') this.happened(message.items);
      else if (type === 'settings') this.follow(message.settings);
      else if (type === 'periods') this.passed(message.columns.mode);
      this.request();
    }

    /** Shows that the loop's process is starting, is building a controller, or has ended. */
    wait({state, text}) {
      this.toolbar.loop(state, text);
      if (state !== 'starting' && state !== 'ended') return;
      this.stream.now = null;
      this.headline.report({kind: state, text: state === 'ended' ? 'The loop has ended.' : 'The loop starts.'});
    }

    begin(hello) {
      this.events.clear();
      this.finer = hello.raster.length > 0 && hello.refinement > 0.75;
      const empty = hello.raster.length ? 'waiting for the flow' : 'this plant has no picture of the flow';
      const scene = {...hello, empty};
      if (this.wake) this.wake.show(scene);
      else this.wake = new stillwake.WakeView(at('wake'), scene);
      if (!this.curves || this.shaped !== `${hello.control_period} ${hello.action_limit}`) {
        this.shaped = `${hello.control_period} ${hello.action_limit}`;
        this.curves = new stillwake.Curves(at('curves'), {
          action_limit: hello.action_limit,
          period: hello.control_period,
          height: innerWidth < 1700 ? 116 : innerWidth < 2200 ? 150 : 200,
        });
      }
      // New controls would take the keyboard's focus away from a viewer who has started the plant again.
      const {used, plants, controllers, sliders, weights, weight_slider: slider} = hello;
      const offered = JSON.stringify([used, plants, controllers, sliders, weights, slider]);
      if (offered !== this.offered) {
        this.offered = offered;
        this.controls = new stillwake.Controls(at('controls'), at('goal'), hello, (request) => this.ask(request));
      }
      const {name, digest, precision, signer} = hello.bundle;
      const release = `Release ${name} (${precision}, ${digest}${signer ? '' : ', unsigned'})`;
      const plant = `${hello.plant}, Re = ${format.count(hello.reynolds)}`;
      write(at('about'), `${release} on ${plant}. stillwake ${hello.version}.`);
      this.follow(hello.settings);
    }

    follow(settings) {
      this.settings = settings;
      this.controls.show(settings);
    }

    happened(items) {
      this.events.add(items);
      if (items.length) this.headline.happened(items.at(-1));
    }

    /** HOLD and DECAY may last only one period each, so their boxes stay lit for longer. */
    passed(modes) {
      for (const [mode, state] of [[3, 'HOLD'], [4, 'DECAY']]) if (modes.includes(mode)) this.states.glow(state);
    }

    draw() {
      const {hello, now, periods} = this.stream;
      if (!hello || !now) return;
      this.headline.show(hello, now);
      this.states.show(now.state, stillwake.reasonOf(hello, now));
      this.wake.state({action: this.last('action'), cp: now.cp, read: now.read, marks: this.marks(now), t: now.t});
      const ahead = (hello.horizon + hello.delay_steps + 1) * hello.control_period;
      this.curves.data(periods.columns.t ? periods.columns : {t: []});
      const from_t = now.t + (now.plan_from - now.k) * hello.control_period;
      this.curves.ahead({plan: now.plan, forecast: now.forecast, from_t});
      const from = Math.max(0, now.t - this.span);
      this.curves.window(from, Math.max(now.t, from + this.span) + ahead);
      this.curves.truth(now);
      this.report(now);
    }

    last(name) {
      const column = this.stream.periods.columns[name];
      return column ? column.at(-1) : null;
    }

    marks(now) {
      const marks = {};
      if (this.settings.dead) marks[this.settings.dead] = 'dead';
      if (this.settings.biased) marks[this.settings.biased] = marks[this.settings.biased] ? 'dead, biased' : 'biased';
      for (const name of now.set_aside) marks[name] = marks[name] ? `${marks[name]}, set aside` : 'set aside';
      return marks;
    }

    report(now) {
      const pace = `${format.number(now.fps, 0)} periods/s, ${format.number(now.real_time, 2)} × real time`;
      const speed = now.paused ? 'paused' : pace;
      write(at('connection'), 'connected');
      write(at('speed'), `${speed}, drawn ${format.number(this.drawn.tick(now.k), 0)}/s`);
      write(at('clock'), `t = ${format.number(now.t, 1)}`);
      write(at('computed'), now.computed_by || '');
      // The hint suggests a grid of 0.75, which hardly changes the shipped plant's wake; coarser grids change it more.
      this.slow = !now.paused && this.finer && now.real_time < (this.slow ? 0.7 : 0.5);
      at('slow').hidden = !this.slow;
      this.toolbar.follow(now);
      const {drag, pressure, action} = this.curves;
      drag.report(`${format.number(this.last('Cd'), 3)}, over the last cycle ${format.number(now.drag_Cd, 3)}`);
      pressure.report(format.number(this.last('base_Cp'), 3));
      action.report(format.signed(this.last('action'), 3));
      if (performance.now() - this.spoken < SPEAK_MS) return;
      this.spoken = performance.now();
      const [t, Cd, free] = [format.number(now.t, 0), this.last('Cd'), now.uncontrolled_Cd];
      this.wake.describe(`Vorticity behind the truck at time ${t}. ${this.headline.text.textContent}`);
      drag.describe(`Drag over time: now ${format.number(Cd, 2)}, without control ${format.number(free, 2)}`);
      pressure.describe(`Base pressure over time: now ${format.number(this.last('base_Cp'), 2)}`);
      action.describe(`Action of the jets over time: now ${format.signed(this.last('action'), 3)}`);
    }
  };

  /** Measures how many periods per second were drawn recently. */
  stillwake.Rate = class {
    constructor() {
      this.times = [];
    }

    tick(k) {
      if (k !== this.k) {
        this.k = k;
        this.times.push(performance.now());
        if (this.times.length > 60) this.times.shift();
      }
      const span = this.times.at(-1) - this.times[0];
      return span > 0 ? (1000 * (this.times.length - 1)) / span : 0;
    }
  };
})();
