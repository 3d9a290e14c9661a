'use strict';
/** Numbers as people read them; what is none is a dash, and a minus is a minus. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

stillwake.format = {
  NONE: '–',

  is(value) {
    return typeof value === 'number' && Number.isFinite(value);
  },

  number(value, digits = 2) {
    return this.is(value) ? value.toFixed(digits).replace('-', '−') : this.NONE;
  },

  signed(value, digits = 2) {
    return this.is(value) && value >= 0 ? `+${this.number(value, digits)}` : this.number(value, digits);
  },

  /** With about three digits, whatever its size. */
  short(value) {
    if (!this.is(value)) return this.NONE;
    const size = Math.abs(value);
    return this.number(value, size >= 100 || size === 0 ? 0 : size >= 10 ? 1 : size >= 0.1 ? 2 : 3);
  },

  count(value) {
    return this.is(value) ? Math.round(value).toLocaleString('en').replaceAll(',', ' ') : this.NONE;
  },

  hex(value) {
    return this.is(value) ? `0x${value.toString(16).toUpperCase().padStart(3, '0')}` : this.NONE;
  },
};

/** An element with attributes and children: what is text becomes text, never markup. */
stillwake.make = (name, attributes = {}, ...children) => {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    element.setAttribute(key, value === true ? '' : value);
  }
  element.append(...children);
  return element;
};

/** Set a text only where it differs, so that nothing is laid out or read aloud again. */
stillwake.write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};
