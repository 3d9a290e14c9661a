'use strict';
/** The live page's buttons for the whole loop, its colour theme, and the errors of requests. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {write} = stillwake;
  const at = (id) => document.getElementById(id);
  const SEEN = 'stillwake.seen';

  /** Stores a value in the browser, if one is given; returns the stored value, or null if there is no storage. */
  const kept = (name, value) => {
    try {
      if (value !== undefined) localStorage.setItem(name, value);
      return localStorage.getItem(name);
    } catch {
      return null;
    }
  };

  stillwake.Toolbar = class {
    /** @param {object} page with the function `ask`. */
    constructor(page) {
      at('clear').addEventListener('click', () => page.ask({clear: true}));
      at('pause').addEventListener('click', () => {
        page.ask({pause: at('pause').getAttribute('aria-pressed') !== 'true'});
      });
      at('theme').addEventListener('click', () => this.turn());
      at('toast-done').addEventListener('click', () => (at('toast').hidden = true));
      at('intro-done').addEventListener('click', () => {
        at('intro').hidden = true;
        kept(SEEN, 'yes');
      });
      at('intro').hidden = kept(SEEN) === 'yes';
    }

    follow(now) {
      at('pause').setAttribute('aria-pressed', String(now.paused));
      write(at('pause'), now.paused ? 'Go on' : 'Pause');
    }

    loop(state, text) {
      at('loop').dataset.kind = state === 'ended' ? 'bad' : '';
      write(at('loop'), text || '');
    }

    /** Shows why a request failed; the effects of a request appear among the events and on the controls. */
    answer({error}) {
      at('toast').hidden = !error;
      if (error) write(at('answer'), `Not done: ${error}`);
    }

    turn() {
      document.documentElement.dataset.theme = stillwake.isDark() ? 'light' : 'dark';
      kept('stillwake.theme', document.documentElement.dataset.theme);
    }
  };

  const theme = kept('stillwake.theme');
  if (theme) document.documentElement.dataset.theme = theme;
})();
