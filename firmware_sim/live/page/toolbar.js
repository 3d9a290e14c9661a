'use strict';
/** The live page's buttons for the whole loop, its link, its theme, and what came of a request. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const {make, write} = stillwake;
  const at = (id) => document.getElementById(id);
  const SEEN = 'stillwake.seen';

  /** Kept by the browser, where it lets us. */
  const kept = (name, value) => {
    try {
      if (value !== undefined) localStorage.setItem(name, value);
      return localStorage.getItem(name);
    } catch {
      return null;
    }
  };

  stillwake.Toolbar = class {
    /** @param {object} page with `ask` and `query`. */
    constructor(page) {
      this.page = page;
      this.link = location.hash.slice(1);
      at('clear').addEventListener('click', () => page.ask({clear: true}));
      at('pause').addEventListener('click', () => {
        page.ask({pause: at('pause').getAttribute('aria-pressed') !== 'true'});
      });
      at('save').addEventListener('click', () => this.save());
      at('copy').addEventListener('click', () => this.copy());
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

    /** Why a request was not done, and what was saved; everything else shows in the events and on the controls. */
    answer({error, saved}) {
      if (error) this.toast([`Not done: ${error}`], 'bad');
      else if (saved) {
        const zip = `saved/${encodeURIComponent(saved)}.zip${stillwake.tokenQuery()}`;
        const link = make('a', {href: zip, download: ''}, 'Download the folder');
        this.toast(['Saved the run as ', make('code', {}, saved), '. ', link]);
      } else at('toast').hidden = true;
    }

    toast(words, kind = '') {
      at('toast').dataset.kind = kind;
      at('toast').hidden = false;
      at('link').hidden = true;
      at('answer').replaceChildren(...words);
    }

    async save() {
      at('save').disabled = true;
      await this.page.ask({save: true});
      at('save').disabled = false;
    }

    /** The settings of the link that opened this page, once; then the address is without them. */
    async openLink() {
      const query = this.link;
      if (!query) return;
      this.link = '';
      history.replaceState(null, '', location.pathname + location.search);
      await this.page.ask({query});
    }

    async copy() {
      const {origin, pathname, search} = location;
      const link = `${origin}${pathname}${search}${this.page.query ? `#${this.page.query}` : ''}`;
      const warning = stillwake.tokenQuery() ? ' It has the token: who has the link can act on the loop.' : '';
      try {
        await navigator.clipboard.writeText(link);
        this.toast([`Link copied.${warning}`]);
      } catch {
        this.toast([`A link with the present settings.${warning}`]);
      }
      at('link').value = link;
      at('link').hidden = false;
      at('link').select();
    }

    turn() {
      document.documentElement.dataset.theme = stillwake.isDark() ? 'light' : 'dark';
      kept('stillwake.theme', document.documentElement.dataset.theme);
    }
  };

  const theme = kept('stillwake.theme');
  if (theme) document.documentElement.dataset.theme = theme;
})();
