'use strict';
/** A table of the bus. It has a row for each CAN identifier, the bus load, and the error states of the nodes. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write, format} = stillwake;
  const HEADS = ['id', 'message', 'from', 'count', 'rate', 'age', 'E2E', 'errors'];
  const WORDS = [1, 2, 6];
  const BAD = {'': '', OK: 'good', INITIAL: 'good', VALID: 'good', INIT: 'warn', NODATA: 'warn', OK_SOME_LOST: 'warn'};

  stillwake.BusTable = class {
    constructor(element) {
      this.rows = new Map();
      this.body = make('tbody');
      const heads = HEADS.map((head, i) => make('th', {scope: 'col', class: WORDS.includes(i) ? 'word' : null}, head));
      const caption = make('caption', {class: 'heard'}, 'Frames on the bus, by identifier');
      const table = make('table', {}, caption, make('thead', {}, make('tr', {}, ...heads)), this.body);
      const scrolls = {class: 'scrolls', tabindex: '0', role: 'region', 'aria-label': 'Table of the bus'};
      this.frame = make('div', scrolls, table);
      this.load = make('p', {class: 'bus-load'});
      this.meter = make('meter', {min: 0, max: 1, high: 0.8, low: 0.6, optimum: 0.2, 'aria-label': 'Bus load'});
      this.percent = make('span');
      this.load.append('load ', this.meter, ' ', this.percent);
      this.nodes = make('p', {class: 'note nodes'});
      element.replaceChildren(this.frame, this.load, this.nodes);
    }

    /** Shows {rows, load, error_frames, nodes}. */
    show(bus) {
      const seen = new Set();
      for (const row of bus.rows) {
        const key = `${row.id}/${row.name}`;
        seen.add(key);
        this.fill(this.rows.get(key) || this.add(key), row);
      }
      for (const [key, cells] of this.rows) {
        if (seen.has(key)) continue;
        cells[0].parentElement.remove();
        this.rows.delete(key);
      }
      this.meter.value = bus.load ?? 0;
      const load = format.number(100 * (bus.load ?? NaN), 0);
      write(this.percent, `${load} %, error frames ${format.count(bus.error_frames)}`);
      write(this.nodes, (bus.nodes || []).map((node) => this.node(node)).join(' · '));
    }

    add(key) {
      const cells = HEADS.map((_, i) => {
        const look = {class: WORDS.includes(i) ? 'word' : null};
        return i === 1 ? make('th', {...look, scope: 'row'}) : make('td', look);
      });
      this.body.append(make('tr', {}, ...cells));
      this.rows.set(key, cells);
      return cells;
    }

    fill(cells, row) {
      const late = format.is(row.limit_ms) && format.is(row.age_ms) && row.age_ms > 1.5 * row.limit_ms;
      const e2e = [row.e2e_state, row.e2e].filter(Boolean).join(', ');
      const texts = [
        format.hex(row.id), row.name, row.sender, format.count(row.count),
        format.is(row.rate_hz) ? `${format.number(row.rate_hz, 0)} /s` : format.NONE,
        format.is(row.age_ms) ? `${format.number(row.age_ms, 0)} ms` : format.NONE,
        e2e || format.NONE, format.count(row.errors),
      ];
      texts.forEach((text, i) => write(cells[i], text));
      cells[5].dataset.kind = late ? 'bad' : '';
      const worst = [BAD[row.e2e_state || ''], BAD[row.e2e || '']].map((kind) => kind ?? 'bad');
      cells[6].dataset.kind = worst.includes('bad') ? 'bad' : worst.includes('warn') ? 'warn' : '';
    }

    node(node) {
      const errors = `errors sent ${format.count(node.tx_errors)}, received ${format.count(node.rx_errors)}`;
      return `${node.name}: ${String(node.state || '').toLowerCase().replaceAll('_', ' ')}, ${errors}`;
    }
  };
})();
