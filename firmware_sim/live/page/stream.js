'use strict';
/** The loop's data that the widgets read: the latest message of each type, and a ring of periods. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const HEAD = 12; // bytes of k, t, width, height: `firmware_sim.live.loop.live_run.pack_field`

  stillwake.Stream = class {
    /** @param {Function} on called with (type, message) after each message has been stored. */
    constructor(on) {
      this.on = on;
      this.hello = null;
      this.now = null;
      this.periods = new stillwake.Ring(1);
    }

    /** Stores a received message: JSON text, or the bytes of a picture. */
    take(data) {
      if (typeof data !== 'string') {
        this.picture = stillwake.unpackField(data);
        this.on('picture', this.picture);
        return;
      }
      const message = JSON.parse(data);
      if (message.type !== 'hello' && message.run !== undefined && message.run !== this.hello?.run) return;
      if (message.type === 'hello') {
        this.hello = message;
        this.now = null;
        this.picture = null;
        this.periods = new stillwake.Ring(message.kept);
      } else if (message.type === 'now') {
        this.now = message;
      } else if (message.type === 'periods') {
        this.periods.push(message.columns);
      }
      this.on(message.type, message);
    }
  };

  /** Returns {k, t, width, height, levels} from the bytes of a picture. */
  stillwake.unpackField = (buffer) => {
    const head = new DataView(buffer);
    const [width, height] = [head.getUint16(8, true), head.getUint16(10, true)];
    const levels = new Int8Array(buffer, HEAD, width * height);
    return {k: head.getUint32(0, true), t: head.getFloat32(4, true), width, height, levels};
  };
})();
