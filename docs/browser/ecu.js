'use strict';
/** The ECU's C code as WebAssembly, and a simulated vehicle that sends it a recorded drive in CAN frames. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const MOST_FRAMES = 4;
  const ALIGNMENT = 64;
  const aligned = (address) => Math.ceil(address / ALIGNMENT) * ALIGNMENT;
  const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stepsOf = (text) => new Int16Array(bytesOf(text).buffer);

  /** Writes a signal [first bit, bits, ...]; bits count from the lowest bit of the first byte, as in the DBC. */
  const put = (data, [start, bits], steps) => {
    for (let i = 0; i < bits; i += 1) data[(start + i) >> 3] |= ((steps >> i) & 1) << ((start + i) & 7);
  };
  const taken = (data, [start, bits, isSigned, scale]) => {
    let steps = 0;
    for (let i = 0; i < bits; i += 1) steps += ((data[(start + i) >> 3] >> ((start + i) & 7)) & 1) * 2 ** i;
    return (isSigned && steps >= 2 ** (bits - 1) ? steps - 2 ** bits : steps) * scale;
  };

  /** Returns all signals of a frame by name, in their units. */
  stillwake.signalsOf = (message, data) =>
    Object.fromEntries(Object.entries(message.signals).map(([name, signal]) => [name, taken(data, signal)]));

  stillwake.EcuInWasm = class {
    static async load({wasm, facts}) {
      const {instance} = await WebAssembly.instantiate(bytesOf(wasm));
      return new this(instance.exports, facts);
    }

    /** Places the memory of the ECU and of its frames after the program's own memory. */
    constructor(code, facts) {
      const frames = MOST_FRAMES * facts.layout.frame;
      this.code = code;
      this.facts = facts;
      this.ecu = aligned(code.__heap_base.value);
      this.received = aligned(this.ecu + code.sw_ecu_bytes());
      this.sent = aligned(this.received + frames);
      this.values = aligned(this.sent + frames);
      const missing = this.values + facts.layout.calibration - code.memory.buffer.byteLength;
      if (missing > 0) code.memory.grow(Math.ceil(missing / 65536));
      this.view = new DataView(code.memory.buffer);
      this.powerOn();
    }

    /** Throws an Error if this machine does not compute as the ECU requires. */
    powerOn() {
      const refused = this.code.sw_ecu_init(this.ecu);
      if (refused !== this.facts.none) throw new Error(`the ECU refuses to run: ${this.facts.reasons[refused]}`);
    }

    /** Sets a calibration, in its order; returns 0, or the number of the first value that is out of range. */
    calibrate(values) {
      values.slice(0, -1).forEach((value, i) => this.view.setFloat32(this.values + 4 * i, value, true));
      this.view.setUint32(this.values + 4 * (values.length - 1), values.at(-1), true);
      return this.code.sw_ecu_calibrate(this.ecu, this.values);
    }

    /** Runs a control period on received frames [{id, data}]; returns the frames that the ECU sends. */
    step(period, frames) {
      const now = BigInt(period) * BigInt(this.facts.period_ns);
      frames.forEach((frame, i) => this.write(this.received + i * this.facts.layout.frame, frame, now));
      const count = this.code.sw_ecu_step(this.ecu, now, this.received, frames.length, this.sent);
      return Array.from({length: count}, (_, i) => this.read(this.sent + i * this.facts.layout.frame));
    }

    /** Returns the name of the operating mode; the frames on the bus contain less detail. */
    get state() {
      return this.facts.states[this.view.getUint8(this.ecu + this.facts.layout.mode)];
    }

    /** Writes the end-to-end protection of a message into its data. */
    protect(message, data, counter) {
      const place = new Uint8Array(this.code.memory.buffer, this.received, data.length);
      place.set(data);
      this.code.sw_e2e_protect(this.received, data.length, message.data_id, counter);
      data.set(place);
    }

    write(at, {id, data}, now) {
      const {layout, is_fd} = this.facts;
      this.view.setBigInt64(at + layout.timestamp_ns, now, true);
      this.view.setUint32(at + layout.id, id, true);
      this.view.setUint8(at + layout.is_extended, 0);
      this.view.setUint8(at + layout.is_fd, is_fd);
      this.view.setUint8(at + layout.length, data.length);
      new Uint8Array(this.view.buffer, at + layout.data, data.length).set(data);
    }

    read(at) {
      const {layout} = this.facts;
      const data = new Uint8Array(this.view.buffer, at + layout.data, this.view.getUint8(at + layout.length));
      return {id: this.view.getUint32(at + layout.id, true), data: data.slice()};
    }
  };

  /** Returns a generator of numbers from 0 to 1 (mulberry32), whose sequence depends only on the seed. */
  const random = (seed) => () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };

  /** Settings of a reader: speed in m/s; number of a faulty sensor, or -1; shares of the pressure frames. */
  stillwake.SOUND = {request: false, speed: 0, sensor: -1, fault: 'zero', lost: 0, damaged: 0};

  stillwake.Vehicle = class {
    /** @param {EcuInWasm} ecu protects the frames. */
    constructor(ecu, drive = 0) {
      this.ecu = ecu;
      this.facts = ecu.facts;
      this.settings = {...stillwake.SOUND, speed: this.facts.speed};
      this.choose(drive);
    }

    /** Begins a recorded drive, at the speed that is set. */
    choose(number) {
      const {pressures, flow} = this.facts.drives[number];
      [this.drive, this.recorded] = [stepsOf(pressures), stepsOf(flow)];
      [this.row, this.sent, this.ratio, this.stuck] = [0, 0, this.settings.speed / this.facts.speed, null];
      this.random = random(1);
    }

    get ended() {
      return this.row > this.recorded.length - 2;
    }

    /** Returns the command that the jets followed in the recording, in m2/s at the present speed. */
    get command() {
      return this.recorded[Math.floor(this.row)] * this.facts.messages.command.signals.Flow[3] * this.ratio;
    }

    /** Returns the sensors' readings, in steps of the message: as recorded, times the square of the speed ratio. */
    pressures() {
      const {sensors, pressure_limit: limit} = this.facts;
      const [row, part] = [Math.floor(this.row), this.row % 1];
      const steps = sensors.map((_, i) => {
        const [now, next] = [row, row + 1].map((at) => this.drive[at * sensors.length + i]);
        const value = (part ? now + part * (next - now) : now) * this.ratio ** 2;
        return Math.round(Math.min(limit, Math.max(-limit, value)));
      });
      const {sensor, fault} = this.settings;
      if (sensor < 0 || fault !== 'stuck') this.stuck = null;
      else this.stuck ??= steps[sensor];
      if (sensor >= 0 && fault !== 'invalid') steps[sensor] = this.stuck ?? 0;
      return steps;
    }

    /** Returns the frames of the next control period that reach the ECU. */
    frames() {
      const {messages, sensors, speed} = this.facts;
      const {request, sensor, fault, lost, damaged, speed: wanted} = this.settings;
      const pressure = {id: messages.pressure.id, data: new Uint8Array(messages.pressure.bytes)};
      const cruise = {id: messages.speed.id, data: new Uint8Array(messages.speed.bytes)};
      const signals = messages.pressure.signals;
      this.pressures().forEach((steps, i) => put(pressure.data, signals[`Pressure${i}`], steps));
      sensors.forEach((_, i) => put(pressure.data, signals[`Valid${i}`], i !== sensor || fault !== 'invalid'));
      put(pressure.data, signals.EnableRequest, request);
      const {Speed} = messages.speed.signals;
      put(cruise.data, Speed, Math.round((this.ratio * speed) / Speed[3]));
      this.ecu.protect(messages.pressure, pressure.data, this.sent % messages.pressure.counters);
      this.ecu.protect(messages.speed, cruise.data, this.sent % messages.speed.counters);
      this.row += this.ratio;
      this.sent += 1;
      const most = 0.1 / speed; // an acceleration of 5 m/s2
      this.ratio += Math.min(most, Math.max(-most, wanted / speed - this.ratio));
      const [a, b, place] = [this.random(), this.random(), Math.floor(this.random() * 8 * pressure.data.length)];
      if (b < damaged) pressure.data[place >> 3] ^= 1 << (place & 7);
      return a < lost ? [cruise] : [pressure, cruise];
    }
  };
})();
