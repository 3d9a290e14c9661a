'use strict';
/** Schedules drawing: at most once per frame of the browser, and at most once per second for elements out of sight. */
var stillwake = globalThis.stillwake || (globalThis.stillwake = {});

(() => {
  const SELDOM_MS = 1000;
  const waiting = new Set();
  const items = new WeakMap();
  let asked = false;

  const run = () => {
    asked = false;
    for (const item of [...waiting]) {
      if (!item.visible && performance.now() - item.drawn < SELDOM_MS) continue; // drawn later, or when in sight
      waiting.delete(item);
      item.drawn = performance.now();
      item.draw();
    }
  };
  const ask = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(run);
  };
  const sight = new IntersectionObserver(
    (entries) => {
      for (const entry of entries) {
        const item = items.get(entry.target);
        item.visible = entry.isIntersecting;
        if (item.visible && waiting.has(item)) ask();
      }
    },
    {rootMargin: '100px'},
  );

  /** Returns a function that requests `draw` in the next frame; out of sight, at most once per second. */
  stillwake.painter = (element, draw) => {
    const item = {draw, visible: true, drawn: -Infinity};
    items.set(element, item);
    sight.observe(element);
    return () => {
      waiting.add(item);
      ask();
    };
  };

  /** Calls `fit(width, height)` in CSS pixels whenever the element's size has changed. */
  stillwake.onSize = (element, fit) => {
    new ResizeObserver(([entry]) => fit(entry.contentRect.width, entry.contentRect.height)).observe(element);
  };

  /** Returns a canvas's context scaled to CSS pixels, with a bitmap of the screen's resolution. */
  stillwake.context = (canvas, width, height) => {
    const fine = Math.min(3, globalThis.devicePixelRatio || 1);
    const [wide, high] = [Math.max(1, Math.round(width * fine)), Math.max(1, Math.round(height * fine))];
    if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
    const context = canvas.getContext('2d');
    context.setTransform(wide / width, 0, 0, high / height, 0, 0);
    return context;
  };
})();
