// Colours: of the page's theme, and of numbers. Viridis is legible with every common colour blindness.
"use strict";

pilotgen.look = (() => {
  const VIRIDIS = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99],
    [170, 220, 50], [230, 228, 40]];
  const dark = matchMedia("(prefers-color-scheme: dark)");

  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function viridis(t) {
    const x = Math.min(Math.max(t, 0), 1) * (VIRIDIS.length - 1);
    const k = Math.min(Math.floor(x), VIRIDIS.length - 2);
    return VIRIDIS[k].map((low, j) => Math.round(low + (x - k) * (VIRIDIS[k + 1][j] - low)));
  }

  // 0 is the worst: darkest on white paper, brightest on black; the end that would be lost on the paper is left out
  const danger = (t) => viridis(dark.matches ? 1 - 0.8 * t : 0.93 * t);
  const rgb = ([r, g, b], alpha = 1) => `rgba(${r},${g},${b},${alpha})`;

  // from pale to dark red: activation of a muscle, 0 to 1 of the scale
  const CALM = [[247, 214, 200], [244, 165, 130], [214, 96, 77], [178, 24, 43], [103, 0, 31]];
  function activation(t) {
    const x = Math.min(Math.max(t, 0), 1) * (CALM.length - 1);
    const k = Math.min(Math.floor(x), CALM.length - 2);
    return CALM[k].map((low, j) => Math.round(low + (x - k) * (CALM[k + 1][j] - low)));
  }

  dark.addEventListener("change", () => pilotgen.state.redraw());
  return { css, danger, viridis, activation, rgb, isDark: () => dark.matches };
})();
