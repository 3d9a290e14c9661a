'use strict';
/** The still pictures of a recorded wake, decoded on request. If requests overlap, only the latest still is shown. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const MIDDLE = 128; // grey value of level 0
  const KEPT = 32; // number of decoded stills in memory

  stillwake.RecordedWake = class {
    /** @param {object} wake width, height, k (period of each still, rising), stills (WebP in base 64). */
    constructor(wake) {
      this.wake = wake;
      this.decoded = new Map();
      this.wanted = -1;
      this.busy = false;
      const canvas = document.createElement('canvas');
      [canvas.width, canvas.height] = [wake.width, wake.height];
      this.context = canvas.getContext('2d', {willReadFrequently: true});
    }

    /** Returns the index of the last still at or before a period; 0 if there is none. */
    index(period) {
      const {k} = this.wake;
      let [low, high] = [0, k.length];
      while (low < high) {
        const middle = (low + high) >> 1;
        if (k[middle] <= period) low = middle + 1;
        else high = middle;
      }
      return Math.max(0, low - 1);
    }

    /** Calls `draw(levels, width, height)` with the still of this period, unless a later call replaces the request. */
    show(period, draw) {
      this.wanted = this.index(period);
      this.draw = draw;
      if (!this.busy) this.next();
    }

    async next() {
      this.busy = true;
      try {
        for (let index = -1; index !== this.wanted; ) {
          index = this.wanted;
          const levels = await this.levels(index);
          if (index === this.wanted) this.draw(levels, this.wake.width, this.wake.height);
        }
      } finally {
        this.busy = false;
      }
    }

    async levels(index) {
      if (!this.decoded.has(index)) {
        this.decoded.set(index, await this.decode(this.wake.stills[index]));
        if (this.decoded.size > KEPT) this.decoded.delete(this.decoded.keys().next().value);
      }
      return this.decoded.get(index);
    }

    async decode(text) {
      const {width, height} = this.wake;
      const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
      const bitmap = await createImageBitmap(new Blob([bytes], {type: 'image/webp'}), {colorSpaceConversion: 'none'});
      this.context.drawImage(bitmap, 0, 0);
      bitmap.close();
      const pixels = this.context.getImageData(0, 0, width, height).data;
      return Int8Array.from({length: width * height}, (_, i) => Math.max(-127, pixels[4 * i] - MIDDLE));
    }
  };
})();
