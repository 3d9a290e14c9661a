'use strict';
/** A sentence that describes the present situation to a new viewer. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write, format} = stillwake;

  /** Returns a text about the drag; null if the drag is unknown. */
  const drag = (percent) => {
    if (!format.is(percent)) return null;
    const size = format.number(Math.abs(percent), 0);
    if (size === '0') return 'Drag is as without control';
    return `Drag is ${size} % ${percent > 0 ? 'below' : 'above'} the uncontrolled wake`;
  };

  /** Returns {kind, text}. Texts that differ only in their numbers have the same `kind`. */
  const sentence = (hello, now) => {
    const count = hello.used.length;
    const reason = stillwake.reasonOf(hello, now);
    const because = reason ? `: ${reason}` : '';
    const less = drag(now.reduction_percent);
    if (!hello.answers_jets && now.state === 'CONTROL' && !now.set_aside.length) {
      const text = `Recorded pressures: the ECU plans from ${count} sensors, and the wake does not respond.`;
      return {kind: 'recording', text};
    }
    const withheld = now.given_up ? ' The vehicle has withdrawn its request: “Clear all” renews it.' : '';
    switch (now.state) {
      case 'CONTROL':
        if (now.set_aside.length) {
          const left = count - now.set_aside.length;
          const aside = `The ECU has set ${now.set_aside.join(' and ')} aside and controls with ${left} sensors`;
          return {kind: `aside ${now.set_aside}`, text: `${less ? `${less}. ` : ''}${aside}.`};
        }
        return less
          ? {kind: 'control', text: `${less}; the ECU controls with ${count} sensors.`}
          : {kind: 'begun', text: `The ECU controls with ${count} wall-pressure sensors; the wake calms down.`};
      case 'HOLD':
      case 'DECAY':
        return {kind: 'missing', text: `Pressures are missing${because}. The ECU bridges a few periods.`};
      case 'FAULT':
        return {kind: `fault ${now.reason}`, text: `The ECU has shut the jets${because}.${withheld}`};
      case 'STANDBY':
        return {kind: 'standby', text: 'The ECU has started and waits for a new request: “Clear all” sends it.'};
      case 'WARMUP':
        return {kind: 'warmup', text: 'Control is requested; the ECU fills its window of past pressures.'};
      case 'UNPOWERED':
        return {kind: 'off', text: `The ECU has no supply: the jets are shut.${withheld}`};
      case 'BOOT':
        return {kind: 'boot', text: 'The ECU starts; the jets are shut.'};
      default:
        if (withheld) return {kind: 'given up', text: `The jets are shut.${withheld}`};
        return {kind: 'free', text: 'No control yet: vortices leave the two edges of the base in turn, and cost drag.'};
    }
  };

  /** Returns in words why the jets do not follow the controller. */
  stillwake.reasonOf = (hello, now) => (hello.reasons && hello.reasons[now.reason]) ?? now.reason;

  stillwake.Headline = class {
    /** The visible text always changes immediately. A screen reader reads the text only if its kind has changed. */
    constructor(element) {
      this.kind = null;
      this.state = make('span', {class: 'pill'});
      this.text = make('span');
      this.event = make('p', {class: 'note latest', 'aria-hidden': 'true'});
      this.heard = make('p', {class: 'heard', role: 'status'});
      element.replaceChildren(make('p', {class: 'sentence'}, this.state, this.text), this.event, this.heard);
    }

    show(hello, now) {
      const {kind, text} = sentence(hello, now);
      const paused = now.paused ? 'Paused. ' : '';
      this.report({kind: paused + kind, text: paused + text, state: now.state});
    }

    /** Shows the latest event in small type below the sentence. */
    happened({t, text}) {
      write(this.event, `t = ${format.number(t, 1)}: ${text}`);
    }

    report({kind, text, state = ''}) {
      write(this.state, state);
      this.state.dataset.kind = stillwake.StateMachine.KIND[state] || 'plain';
      write(this.text, text);
      if (kind === this.kind) return;
      this.kind = kind;
      write(this.heard, text);
    }
  };
})();
