'use strict';
/** The columns of the latest control periods. Their memory does not grow while the page is open. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

stillwake.Ring = class {
  /** @param {number} kept number of rows to store; the oldest are deleted when a quarter more are stored. */
  constructor(kept) {
    this.kept = Math.max(1, kept);
    this.clear();
  }

  clear() {
    this.columns = {};
    this.length = 0;
  }

  /** Appends rows, given as columns of equal length; drops rows whose `k` is not greater than the last stored `k`. */
  push(columns) {
    const last = this.length ? this.columns.k[this.length - 1] : -1;
    const first = columns.k.findIndex((k) => k > last);
    if (first < 0) return;
    for (const [name, values] of Object.entries(columns)) {
      const kept = (this.columns[name] ??= new Array(this.length).fill(null));
      for (let i = first; i < columns.k.length; i += 1) kept.push(values[i] ?? null);
    }
    this.length = this.columns.k.length;
    if (this.length <= 1.25 * this.kept) return;
    for (const name of Object.keys(this.columns)) this.columns[name] = this.columns[name].slice(-this.kept);
    this.length = this.kept;
  }
};
