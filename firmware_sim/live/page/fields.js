'use strict';
/** The native form controls with label and help. They show the loop's value and pass on the viewer's changes. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write, format} = stillwake;
  let count = 0;

  /** Returns a block of label, control, value and help. */
  const block = (kind, {label, help}, control, ...more) => {
    control.id = `field-${(count += 1)}`;
    const lines = [make('label', {for: control.id}, label)];
    const parts = kind === 'switch' ? [control, ...lines] : [...lines, ...more, control];
    const element = make('div', {class: `field ${kind}`}, ...parts);
    if (help) {
      const note = make('p', {class: 'note', id: `${control.id}-help`}, help);
      control.setAttribute('aria-describedby', note.id);
      element.append(note);
    }
    return element;
  };

  /** A switch: the viewer's change calls `set(true)` or `set(false)`; `show` shows the loop's value. */
  stillwake.Switch = class {
    constructor(words, set) {
      this.input = make('input', {type: 'checkbox', role: 'switch'});
      this.element = block('switch', words, this.input);
      this.input.addEventListener('change', () => set(this.input.checked));
    }

    show(value) {
      this.input.checked = Boolean(value);
    }
  };

  /** A choice from [{name, label, missing}]; if `missing` states a reason, the entry cannot be chosen. */
  stillwake.Choice = class {
    constructor(words, choices, set) {
      this.input = make('select', {name: words.name});
      for (const {name, label, missing} of choices) {
        const text = missing ? `${label} (not here)` : label;
        this.input.append(make('option', {value: name, disabled: Boolean(missing)}, text));
      }
      this.element = block('choice', words, this.input);
      const missing = choices.filter((choice) => choice.missing).map((choice) => `${choice.label}: ${choice.missing}`);
      if (missing.length) this.element.append(make('p', {class: 'note'}, missing.join(' · ')));
      this.input.addEventListener('change', () => set(this.input.value));
    }

    show(value) {
      this.input.value = value;
    }
  };

  /** Longest time in which a released slider waits for its value from the loop, and does not show older values. */
  const FOLLOWS_MS = 500;

  /**
   * A slider for a number, sent when the viewer releases the slider; soon after that it shows the loop's value again.
   * `scale` has two functions: `to` maps a value to the slider's position, `from` maps a position to the value.
   */
  stillwake.Slider = class {
    constructor(words, {least, greatest, step, unit}, set, scale = null) {
      this.unit = unit;
      this.scale = scale || {to: (value) => value, from: (value) => value};
      const ends = scale ? {min: 0, max: 100, step: 1} : {min: least, max: greatest, step};
      this.input = make('input', {type: 'range', name: words.name, ...ends});
      this.output = make('output');
      this.element = block('slider', words, this.input, this.output);
      this.held = false;
      // A slider that is moved back to where it was has no 'change', so the end of the pointer's press counts too.
      const release = () => {
        clearTimeout(this.following);
        this.following = setTimeout(() => {
          this.held = false;
          this.show(this.latest);
        }, FOLLOWS_MS);
      };
      this.input.addEventListener('input', () => {
        this.held = true;
        this.sent = null;
        clearTimeout(this.following);
        for (const end of ['pointerup', 'pointercancel']) addEventListener(end, release, {once: true});
        this.report(this.value);
      });
      this.input.addEventListener('change', () => {
        this.sent = this.value;
        release();
        set(this.sent);
      });
    }

    get value() {
      return this.scale.from(Number(this.input.value));
    }

    show(value) {
      this.latest = value;
      if (this.held && value !== this.sent) return;
      this.held = false;
      this.input.value = String(this.scale.to(value));
      this.report(value);
    }

    report(value) {
      const text = `${format.short(value)} ${this.unit}`.trim();
      write(this.output, text);
      this.input.setAttribute('aria-valuetext', text);
    }
  };

  /** Labels of the cost terms. */
  stillwake.WEIGHTS = {
    drag_mean: 'Mean drag',
    drag_fluctuation: 'Drag swings',
    lift: 'Side force',
    lift_mean: 'Mean side force',
    smoothness: 'Smooth plan',
    effort: 'Jet effort',
    rate: 'First step of the jets',
    prior: 'Distance from the learned plan',
  };

  /** Maps 0 to a slider's 0, and values from 0.01 to `greatest` logarithmically to its positions 1 to 100. */
  stillwake.byRatio = (greatest) => ({
    to: (value) => (value < 0.01 ? 0 : Math.round(1 + (99 * Math.log(value / 0.01)) / Math.log(greatest / 0.01))),
    from: (place) => (place < 1 ? 0 : Number((0.01 * (greatest / 0.01) ** ((place - 1) / 99)).toPrecision(2))),
  });
})();
