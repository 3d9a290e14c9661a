'use strict';
/** A player of a run: a slider over its periods, play and pause, and the speed. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write, format} = stillwake;
  const SPEEDS = [0.5, 1, 2, 5, 10, 20]; // t_c per second
  const USUAL = 2;

  stillwake.Player = class {
    /**
     * @param {object} what number of periods, length of a period in t_c, marks [[label, period]] as buttons, words
     *   (returns the readout's text for a period), onChange (called with the period).
     */
    constructor(element, {count, period, marks = [], words, onChange}) {
      Object.assign(this, {count, period, words, onChange, at: 0, playing: false});
      this.button = make('button', {type: 'button', class: 'main'}, 'Play');
      this.slider = make('input', {type: 'range', min: 0, max: count - 1, step: 1, value: 0, 'aria-label': 'Time in the run'});
      this.speed = make('select', {'aria-label': 'Speed'});
      for (const speed of SPEEDS) {
        this.speed.append(make('option', {value: speed, selected: speed === USUAL}, `${speed} W/U∞ a second`));
      }
      const jumps = marks.map(([label, to]) => {
        const jump = make('button', {type: 'button'}, label);
        jump.addEventListener('click', () => this.go(to));
        return jump;
      });
      this.readout = make('output', {class: 'readout'});
      element.replaceChildren(
        make('div', {class: 'player-buttons'}, this.button, ...jumps, this.speed), this.slider, this.readout,
      );
      this.button.addEventListener('click', () => (this.playing ? this.pause() : this.play()));
      this.slider.addEventListener('input', () => this.go(Number(this.slider.value)));
    }

    /** Moves the player to a period; if it is playing, it continues from this period. */
    go(period) {
      this.since = null;
      this.show(period);
    }

    show(period) {
      this.at = Math.min(this.count - 1, Math.max(0, Math.round(period)));
      const text = this.words(this.at);
      this.slider.value = this.at;
      this.slider.setAttribute('aria-valuetext', text);
      write(this.readout, text);
      this.onChange(this.at);
    }

    play() {
      this.playing = true;
      this.button.textContent = 'Pause';
      if (this.at === this.count - 1) this.show(0);
      this.since = null;
      requestAnimationFrame((now) => this.tick(now));
    }

    pause() {
      this.playing = false;
      this.button.textContent = 'Play';
    }

    tick(now) {
      if (!this.playing) return;
      if (this.since === null) [this.since, this.from, this.pace] = [now, this.at, Number(this.speed.value)];
      const to = this.from + Math.floor(((now - this.since) / 1000) * (this.pace / this.period));
      if (to > this.at) this.show(to);
      if (this.pace !== Number(this.speed.value)) this.since = null;
      if (this.at === this.count - 1) this.pause();
      else requestAnimationFrame((later) => this.tick(later));
    }
  };
})();
