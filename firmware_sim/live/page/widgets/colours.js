'use strict';
/** The page's colours for canvases, in the light and the dark theme, and the palettes of vorticity and pressure. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const resolved = new Map();
  const listeners = new Set();
  let probe = null;

  /** Converts a custom property of theme.css, such as '--ink', to a colour that a canvas accepts. */
  stillwake.colour = (name) => {
    if (!resolved.has(name)) {
      if (!probe) {
        probe = stillwake.make('span', {'aria-hidden': 'true', hidden: true});
        document.body.append(probe);
      }
      probe.style.color = `var(${name})`;
      resolved.set(name, getComputedStyle(probe).color);
    }
    return resolved.get(name);
  };

  stillwake.isDark = () => {
    const chosen = document.documentElement.dataset.theme;
    return chosen ? chosen === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
  };

  /** Registers a function that is called after a change between the light and the dark theme. */
  stillwake.onTheme = (listener) => listeners.add(listener);

  const changed = () => {
    resolved.clear();
    listeners.forEach((listener) => listener());
  };
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', changed);
  new MutationObserver(changed).observe(document.documentElement, {attributeFilter: ['data-theme']});

  const NIGHT = [
    [0.0, 0xd4fcff], [0.12, 0x46c9ff], [0.28, 0x1a6bd0], [0.41, 0x0e2a58], [0.49, 0x0a0d14],
    [0.51, 0x0a0d14], [0.59, 0x541a18], [0.72, 0xcf3f20], [0.88, 0xffa040], [1.0, 0xfff6cf],
  ];
  const DAY = [
    [0.0, 0x06275c], [0.14, 0x1f63b5], [0.3, 0x6fa9dc], [0.43, 0xcfe2f3], [0.5, 0xffffff],
    [0.57, 0xf9d8cb], [0.7, 0xe88b6c], [0.86, 0xbd2f2a], [1.0, 0x5f0a1c],
  ];
  /** matplotlib's palette Viridis. */
  const PRESSURE = [
    [0.0, 0x440154], [0.2, 0x414487], [0.4, 0x2a788e], [0.6, 0x22a884], [0.8, 0x7ad151], [1.0, 0xfde725],
  ];

  const between = (stops, share) => {
    let i = 1;
    while (i < stops.length - 1 && stops[i][0] < share) i += 1;
    const [[a, from], [b, to]] = [stops[i - 1], stops[i]];
    const part = Math.min(1, Math.max(0, (share - a) / (b - a)));
    return [16, 8, 0].map((shift) => {
      const [low, high] = [(from >> shift) & 255, (to >> shift) & 255];
      return Math.round(low + part * (high - low));
    });
  };

  const inCss = (stops) => stops.map(([at, rgb]) => `#${rgb.toString(16).padStart(6, '0')} ${100 * at}%`).join(', ');

  const fieldOf = (stops) => {
    const bytes = new Uint8Array(4 * 256);
    for (let level = -128; level < 128; level += 1) {
      bytes.set([...between(stops, 0.5 + level / 254), 255], 4 * (level & 255));
    }
    return new Uint32Array(bytes.buffer);
  };
  const tables = {night: fieldOf(NIGHT), day: fieldOf(DAY)};

  /** Returns 256 pixels for the vorticity levels -127..127; the index of a pixel is the level's low byte. */
  stillwake.fieldPalette = () => (stillwake.isDark() ? tables.night : tables.day);

  /** Returns the palette of fieldPalette as CSS colours, for a legend. */
  stillwake.fieldGradient = () =>
    inCss(stillwake.isDark() ? NIGHT : DAY);

  /** Ends of the colour scale of wall Cp: the range of the sensors on the truck without control. */
  stillwake.PRESSURE_RANGE = [-0.9, 0.1];
  stillwake.pressureColour = (cp) => {
    const [least, greatest] = stillwake.PRESSURE_RANGE;
    return `rgb(${between(PRESSURE, (cp - least) / (greatest - least)).join(' ')})`;
  };
  stillwake.pressureGradient = () => inCss(PRESSURE);
})();
