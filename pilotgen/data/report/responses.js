// Views of one pilot's response: Nyquist curve with its margins, Bode diagrams of feedthrough and loop.
"use strict";

pilotgen.responses = (() => {
  const { text, look, state, model } = pilotgen;
  const REFERENCES = [["--first", [7, 3]], ["--second", [2, 3]]];
  let references = null;
  const mayo = () => (references = references || model.referenceCurves());

  // who is drawn: chosen pilot on top of the nominal one
  function drawn() {
    const found = [];
    const { nominal } = model.data;
    if (nominal !== null && nominal !== state.pilot && model.hasCurves(nominal)) found.push({ pilot: nominal, colour: "--nominal", width: 1.6 });
    if (state.pilot !== null && model.hasCurves(state.pilot)) found.push({ pilot: state.pilot, colour: "--chosen", width: 2.4 });
    return found.map((one) => ({ ...one, curve: model.curve(one.pilot) }));
  }

  const nearestHz = (curve, hz) => {
    let k = 0;
    while (k + 1 < curve.hz.length && Math.abs(Math.log(curve.hz[k + 1] / hz)) <= Math.abs(Math.log(curve.hz[k] / hz))) k += 1;
    return k;
  };

  function readout(hz) {
    if (state.pilot === null || !model.hasCurves(state.pilot)) return "No curve is stored for this pilot.";
    if (hz === null) return "Move over a curve, or use Shift with the arrow keys, to read frequency, gain and phase.";
    const [re, im] = model.loop(state.pilot, hz);
    const G = model.grip(state.pilot, hz);
    const phase = Math.atan2(im, re) * 180 / Math.PI;
    return `${text.number(hz, 3)} Hz: loop gain ${text.number(20 * Math.log10(Math.hypot(re, im)), 2)} dB, phase ${text.number(phase, 1)}°; ` +
      `grip ${text.number(1e3 * Math.hypot(...G), 3)} mm per ${model.data.loop.per}, phase ${text.number(Math.atan2(G[1], G[0]) * 180 / Math.PI, 1)}°`;
  }

  function nyquist(host) {
    function box() {
      let [x0, x1, y] = [-1.25, 0.35, 0.6];
      for (const { curve } of drawn()) {
        for (let k = 0; k < curve.hz.length; k += 1) {
          x0 = Math.min(x0, Math.max(1.08 * curve.re[k], -6));
          x1 = Math.max(x1, Math.min(1.08 * curve.re[k], 6));
          y = Math.max(y, Math.min(1.08 * Math.abs(curve.im[k]), 6));
        }
      }
      return { x: [x0, x1], y: [-y, y] };
    }
    const view = pilotgen.chart.chart(host, {
      square: true,
      x: { label: () => "real part of L", range: () => box().x },
      y: { label: () => "imaginary part of L", range: () => box().y },
      draw(pen) {
        pen.across(0, look.css("--axis"));
        pen.along(0, look.css("--axis"));
        pen.arc(0, 0, 1, look.css("--quiet"), { width: 1.2 });
        margins(pen);
        for (const { curve, colour, width } of drawn()) {
          pen.line(curve.re, Array.from(curve.im, (v) => -v), look.css(colour), { width: 0.8, dash: [2, 3] });
          pen.line(curve.re, curve.im, look.css(colour), { width });
        }
        pen.line([-1.03, -0.97], [0, 0], look.css("--ink"), { width: 2 });
        pen.line([-1, -1], [-0.03, 0.03], look.css("--ink"), { width: 2 });
        pen.text(-1, 0, "−1", look.css("--ink"), { dx: -6, dy: 12, align: "right" });
        const own = drawn().at(-1);
        if (own && state.hz !== null) {
          const [re, im] = model.loop(own.pilot, state.hz);
          pen.dot(re, im, 6, look.css("--mark"), look.css("--paper"), 2);
        }
      },
      hover(place) {
        const own = drawn().at(-1);
        if (!own) return;
        const k = place.nearest((j) => own.curve.re[j], (j) => own.curve.im[j], own.curve.hz.length);
        if (k < 0) { pilotgen.tip.show(null); return; }
        state.setHz(own.curve.hz[k]);
        pilotgen.tip.show(view.u.over, place, [`${text.number(own.curve.hz[k], 3)} Hz`,
          `gain ${text.number(own.curve.db[k], 2)} dB`, `phase ${text.number(principal(own.curve.deg[k]), 1)}°`]);
      },
      leave: () => pilotgen.tip.show(null),
      pick() { /* one pilot only */ },
    });

    function margins(pen) {
      const pilot = state.pilot;
      if (pilot === null || !model.hasCurves(pilot)) return;
      const disk = model.disk(pilot).value / 2;
      if (disk > 0 && disk < 0.98) {
        const radius = 2 * disk / (1 - disk * disk);
        pen.arc(-(1 + disk * disk) / (1 - disk * disk), 0, radius, look.css("--limit"), { width: 1.2, dash: [6, 4], fill: look.css("--forbidden") });
      }
      const gain = model.value("gain_margin_db", pilot), gainHz = model.value("gain_margin_hz", pilot);
      if (Number.isFinite(gain) && Number.isFinite(gainHz)) {
        const re = model.loop(pilot, gainHz)[0];
        pen.line([re, -1], [0, 0], look.css("--mark"), { width: 3 });
        pen.dot(re, 0, 4.5, look.css("--paper"), look.css("--mark"), 2);
        pen.text((re - 1) / 2, 0, `${text.number(gain, 2)} dB`, look.css("--ink"), { dy: -13, align: "center" });
      }
      const phase = model.value("phase_margin_deg", pilot), phaseHz = model.value("phase_margin_hz", pilot);
      if (Number.isFinite(phase) && Number.isFinite(phaseHz)) {
        const [re, im] = model.loop(pilot, phaseHz);
        const angle = Math.atan2(im, re);
        const end = angle > 0 ? Math.PI : -Math.PI;
        pen.arc(0, 0, 1, look.css("--mark"), { from: angle, to: end, width: 3 });
        pen.dot(re, im, 4.5, look.css("--paper"), look.css("--mark"), 2);
        pen.text(re, im, `${text.number(phase, 1)}°`, look.css("--ink"), { dx: 10, dy: im > 0 ? -10 : 10 });
      }
    }
    return { view, again: () => view.reset() };
  }

  const principal = (deg) => deg - 360 * Math.round(deg / 360);

  // one diagram over frequency: pick is a column of the curve
  function bode(host, { field, label, log = false, every = null, lines = () => {}, limits = null }) {
    function range() {
      let [low, high] = [Infinity, -Infinity];
      for (const curve of [...drawn().map((one) => one.curve), ...mayo()]) {
        for (const v of curve[field]) if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); }
      }
      if (!(low < high)) return log ? [0.1, 10] : [-1, 1];
      if (limits) [low, high] = [Math.max(low, limits[0]), Math.min(high, limits[1])];
      return log ? [low / 1.15, high * 1.25] : [low - 0.05 * (high - low), high + 0.05 * (high - low)];
    }
    const view = pilotgen.chart.chart(host, {
      x: { label: () => "frequency [Hz]", log: true, range: () => [model.LOW_HZ, model.HIGH_HZ] },
      y: { label: () => label, log, range, every },
      draw(pen) {
        lines(pen);
        mayo().forEach((curve, k) => pen.line(curve.hz, curve[field], look.css(REFERENCES[k % 2][0]), { width: 1.4, dash: REFERENCES[k % 2][1] }));
        for (const { curve, colour, width } of drawn()) pen.line(curve.hz, curve[field], look.css(colour), { width });
        if (state.hz === null) return;
        pen.along(state.hz, look.css("--mark"), { width: 1 });
        const own = drawn().at(-1);
        if (own) pen.dot(state.hz, own.curve[field][nearestHz(own.curve, state.hz)], 4.5, look.css("--mark"), look.css("--paper"), 1.5);
      },
      hover(place) {
        if (place.x >= model.LOW_HZ && place.x <= model.HIGH_HZ) state.setHz(place.x);
        const own = drawn().at(-1);
        if (own) pilotgen.tip.show(view.u.over, place, [`${text.number(place.x, 3)} Hz`, `${label}: ${text.number(own.curve[field][nearestHz(own.curve, place.x)], 2)}`]);
      },
      leave: () => pilotgen.tip.show(null),
    });
    return { view, again: () => view.reset() };
  }

  return { nyquist, bode, readout, drawn };
})();
