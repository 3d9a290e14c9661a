'use strict';
/** The settings of the running loop that a viewer can change. Every control shows the loop's present value. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, Switch, Choice, Slider} = stillwake;

  const WORDS = {
    enable: {label: 'The vehicle requests control', help: 'Off: the ECU shuts the jets and the vortices return.'},
    plant: {label: 'Plant', help: 'A change starts the plant again.'},
    noise: {label: 'Noise on all sensors', help: 'Watch the action get rougher, and the drag rise.'},
    dead: {label: 'Dead sensor', help: 'It reads Cp 0. Watch the ECU set it aside and continue with the others.'},
    biased: {label: 'Biased sensor', help: 'Watch the ECU set it aside if it contradicts the others.'},
    bias: {label: 'Bias', help: 'Offset of the biased sensor.'},
    loss: {label: 'Lost pressure frames', help: 'Watch HOLD and DECAY appear, and FAULT if too many are lost.'},
    delay_ms: {label: 'Late jet commands', help: 'Watch the drag rise; commands that are too late shut the jets.'},
    babble: {
      label: 'Babbling node',
      help: 'It fills the bus at the highest priority. Watch the load, and the ECU’s FAULT.',
    },
    controller: {
      label: 'Controller',
      help: 'The same release on another machine; “off” cuts the ECU’s supply. Watch the time of a step.',
    },
  };
  const GOAL = 'Weights of the cost. A larger weight on side force costs drag; one on jet effort spares the jets.';

  stillwake.Controls = class {
    /**
     * @param {Element} element is filled with the settings, and the element `goal` with the weights.
     * @param {object} hello message with choices, bounds and settings.
     * @param {Function} ask function that sends a request, such as {set: {...}} or {clear: true}.
     */
    constructor(element, goal, hello, ask) {
      this.hello = hello;
      this.ask = ask;
      this.fields = new Map();
      this.weights = new Map();
      const sensors = [{name: '', label: 'none'}, ...hello.used.map((name) => ({name, label: name}))];
      element.replaceChildren(
        this.group(
          'Vehicle',
          this.switch('enable'),
          this.choice('plant', hello.plants),
          this.button('restart', 'Restart the plant', 'Begins from its initial state with the present settings.'),
        ),
        this.group(
          'ECU',
          this.choice('controller', hello.controllers),
          this.button('power_cycle', 'Power cycle the ECU', 'Watch it boot, and wait for a new request in STANDBY.'),
        ),
        this.group(
          'Sensors',
          this.slider('noise'),
          this.choice('dead', sensors),
          this.choice('biased', sensors),
          this.slider('bias'),
        ),
        this.group('Bus', this.slider('loss'), this.slider('delay_ms'), this.switch('babble')),
      );
      goal.replaceChildren(...this.goal());
      this.show(hello.settings);
    }

    /** Shows the loop's settings. They replace the settings that the viewer has just chosen. */
    show(settings) {
      for (const [name, field] of this.fields) field.show(settings[name]);
      const weights = settings.weights || this.hello.weights;
      for (const [name, field] of this.weights) field.show(weights[name]);
      this.own.disabled = !settings.weights;
    }

    group(name, ...items) {
      return make('fieldset', {}, make('legend', {}, name), ...items);
    }

    words(name) {
      return {name, ...WORDS[name]};
    }

    set(name) {
      return (value) => this.ask({set: {[name]: value}});
    }

    switch(name) {
      return this.keep(name, new Switch(this.words(name), this.set(name)));
    }

    choice(name, choices) {
      return this.keep(name, new Choice(this.words(name), choices, this.set(name)));
    }

    slider(name) {
      return this.keep(name, new Slider(this.words(name), this.bounds(this.hello.sliders[name]), this.set(name)));
    }

    /** Returns a slider's bounds with a short unit: 'ms', 'σ', or no unit for a share. */
    bounds(slider) {
      const unit = slider.unit.split(' ')[0];
      return {...slider, unit: unit === 'ms' ? 'ms' : unit === 'deviations' ? 'σ' : ''};
    }

    keep(name, field) {
      this.fields.set(name, field);
      field.input.dataset.setting = name;
      return field.element;
    }

    button(request, label, help) {
      const button = make('button', {type: 'button', 'data-request': request}, label);
      button.addEventListener('click', () => this.ask({[request]: true}));
      return make('div', {class: 'act'}, button, make('p', {class: 'note'}, help));
    }

    /** Returns the controls for the weights of the cost. The weights are part of the release's calibration. */
    goal() {
      const {least, greatest, step} = this.hello.weight_slider;
      const fields = Object.keys(this.hello.weights).map((name) => {
        const field = new Slider(
          {name, label: stillwake.WEIGHTS[name] || name},
          {least, greatest, step, unit: ''},
          (value) => this.ask({set: {weights: {[name]: value}}}),
          stillwake.byRatio(greatest),
        );
        field.input.dataset.weight = name;
        this.weights.set(name, field);
        return field.element;
      });
      this.own = make('button', {type: 'button', 'data-request': 'weights'}, 'The release’s goal');
      this.own.addEventListener('click', () => this.ask({set: {weights: null}}));
      const weights = make('div', {class: 'weights'}, ...fields, make('div', {class: 'act'}, this.own));
      return [make('p', {class: 'note'}, GOAL), weights];
    }
  };
})();
