'use strict';
/** The numbers in readable form. A missing value is a dash, and a negative number has a true minus sign. */
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

  /** Returns a number with about three significant digits. */
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

/** Creates an element with attributes and children; a string becomes text, never markup. */
stillwake.make = (name, attributes = {}, ...children) => {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    element.setAttribute(key, value === true ? '' : value);
  }
  element.append(...children);
  return element;
};

/** Sets a text only if it differs, so that an equal text causes no new layout and is not read aloud again. */
stillwake.write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};
