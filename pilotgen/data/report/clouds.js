// Views of many pilots: any two columns against each other, the front, a histogram of a margin.
"use strict";

pilotgen.clouds = (() => {
  const { text, look, state, model } = pilotgen;
  let colour = null; // {column, low, high}: the same in every cloud

  function colourBy(key) {
    const column = model.column(key);
    const rows = model.data.fair.filter((k) => Number.isFinite(column.values[k]));
    const sorted = rows.map((k) => column.values[k]).sort((a, b) => a - b);
    const every = Array.from(column.values.subarray(0, model.data.count)).filter(Number.isFinite);
    const low = every.reduce((a, b) => Math.min(a, b), Infinity);
    const high = sorted.length ? sorted[Math.floor(0.95 * (sorted.length - 1))] : low;
    const larger = column.worse === "larger"; // then the largest are the worst
    colour = { column, low, high: high > low ? high : low + 1, larger };
    legend();
    state.redraw();
  }

  function share(pilot) {
    const x = colour.column.values[pilot];
    const t = x === Infinity ? 1 : x === -Infinity ? 0 : (x - colour.low) / (colour.high - colour.low);
    return Math.min(Math.max(colour.larger ? 1 - t : t, 0), 1);
  }

  function legend() {
    const host = document.getElementById("colour-legend");
    if (!host) return;
    const stops = [0, 0.25, 0.5, 0.75, 1].map((t) => look.rgb(look.danger(colour.larger ? 1 - t : t)));
    const { column } = colour;
    host.replaceChildren(
      text.element("span", {}, text.axis(column)), text.element("span", { class: "number" }, text.number(colour.low, column.digits)),
      text.element("span", { class: "ramp", style: `background:linear-gradient(to right,${stops.join(",")})` }),
      text.element("span", { class: "number" }, `${text.number(colour.high, column.digits)} and more`));
  }

  const rowsOf = (x, y) => {
    const rows = [];
    for (let k = 0; k < model.data.count; k += 1) {
      if (model.evaluated(k) && !Number.isNaN(x.values[k]) && !Number.isNaN(y.values[k])) rows.push(k);
    }
    return rows;
  };

  // axes() gives two columns; front draws the Pareto front
  function cloud(host, axes, { front = false, limits = false } = {}) {
    let x, y, rows, px, py;
    function gather() {
      [x, y] = axes();
      rows = rowsOf(x, y);
      const more = (column) => (model.data.nominal === null ? [] : [column.values[model.data.nominal]]);
      px = pilotgen.chart.placed(x.values, rows, more(x));
      py = pilotgen.chart.placed(y.values, rows, more(y));
      rows.sort((a, b) => share(b) - share(a)); // the worst on top
    }
    gather();
    const X = (k) => px.of(x.values[k]), Y = (k) => py.of(y.values[k]);
    const all = () => (model.data.nominal === null ? rows : [...rows, model.data.nominal]);
    const view = pilotgen.chart.chart(host, {
      x: { label: () => text.axis(x), range: () => px.range, marks: (value) => px.marks(value) },
      y: { label: () => text.axis(y), range: () => py.range, marks: (value) => py.marks(value) },
      draw(pen) {
        strips(pen);
        if (limits) lines(pen);
        const edge = rows.length < 400 ? look.css("--paper") : null;
        for (const k of rows) pen.dot(X(k), Y(k), rows.length > 1200 ? 2.4 : 3.6, look.rgb(look.danger(share(k))), edge, 0.6);
        if (front) drawFront(pen);
        if (model.data.nominal !== null) pen.dot(X(model.data.nominal), Y(model.data.nominal), 4.5, look.css("--paper"), look.css("--nominal"), 2.4);
        if (state.pilot !== null && model.evaluated(state.pilot)) {
          pen.dot(X(state.pilot), Y(state.pilot), 9, null, look.css("--paper"), 4.5);
          pen.dot(X(state.pilot), Y(state.pilot), 9, null, look.css("--chosen"), 2.4);
        }
      },
      hover(place) {
        const k = place.nearest((j) => X(all()[j]), (j) => Y(all()[j]), all().length);
        pilotgen.tip.show(view.u.over, place, k < 0 ? null : brief(all()[k], [x, y]));
      },
      leave: () => pilotgen.tip.show(null),
      pick(place) {
        const k = place.nearest((j) => X(all()[j]), (j) => Y(all()[j]), all().length, 40);
        if (k >= 0) state.choose(all()[k]);
      },
    });

    function strips(pen) {
      const { u, ctx } = pen;
      ctx.fillStyle = look.css("--strip");
      const [left, right] = [u.scales.x.min, u.scales.x.max], [low, high] = [u.scales.y.min, u.scales.y.max];
      const shade = (a, b, c, d, words, where) => {
        ctx.fillRect(pen.X(a), pen.Y(d), pen.X(b) - pen.X(a), pen.Y(c) - pen.Y(d));
        pen.text(...where, words, look.css("--quiet"), { align: "center" });
        ctx.fillStyle = look.css("--strip");
      };
      if (px.above !== null && right > px.above) shade(px.above, right, low, high, "none", [(px.above + right) / 2, low + 0.04 * (high - low)]);
      if (px.below !== null && left < px.below) shade(left, px.below, low, high, "−∞", [(left + px.below) / 2, low + 0.04 * (high - low)]);
      if (py.above !== null && high > py.above) shade(left, right, py.above, high, "none", [left + 0.05 * (right - left), (py.above + high) / 2]);
      if (py.below !== null && low < py.below) shade(left, right, low, py.below, "−∞", [left + 0.05 * (right - left), (low + py.below) / 2]);
    }

    function lines(pen) {
      const dashed = { dash: [6, 4], width: 1.2 };
      if (x.limit !== null && x.limit !== undefined) pen.along(x.limit, look.css("--limit"), dashed);
      if (y.limit !== null && y.limit !== undefined) pen.across(y.limit, look.css("--limit"), dashed);
      if (x.role === "objective") pen.along(0, look.css("--ink"));
      if (y.role === "objective") pen.across(0, look.css("--ink"));
    }

    function drawFront(pen) {
      const members = model.data.front.filter((k) => rows.includes(k));
      members.sort((a, b) => x.values[a] - x.values[b] || y.values[a] - y.values[b]);
      pen.line(members.map(X), members.map(Y), look.css("--mark"), { width: 1 });
      members.forEach((k) => pen.diamond(X(k), Y(k), 5, look.css("--mark")));
    }

    function again() { gather(); view.reset(); }
    return { view, again, screen: (pilot) => [view.u.valToPos(X(pilot), "x"), view.u.valToPos(Y(pilot), "y")] };
  }

  function brief(pilot, more = []) {
    const shown = model.columns.filter((column) => column.role === "variable" || column.key === "gain_margin_db" || column.key === "phase_margin_deg" || (model.data.plane || []).includes(column.key));
    const lines = [...new Set([...shown, ...more])].map((column) => `${column.label} ${text.of(column, pilot)}`);
    return [text.name(pilot), ...lines];
  }

  // how many pilots of the even population have which margin
  function histogram(host, key, note) {
    let column, bins, low, width, most, outside;
    function gather() {
      column = model.column(key());
      const values = model.data.fair.filter((k) => model.evaluated(k)).map((k) => column.values[k]);
      const finite = values.filter(Number.isFinite);
      outside = [values.filter((x) => x === Infinity).length, values.filter((x) => x === -Infinity).length, values.length];
      let [a, b] = [Math.min(...finite, Infinity), Math.max(...finite, -Infinity)];
      if (!(a < b)) [a, b] = Number.isFinite(a) ? [a - 1, a + 1] : [0, 1];
      const rough = (b - a) / Math.min(Math.max(Math.sqrt(finite.length), 6), 30);
      const power = 10 ** Math.floor(Math.log10(rough));
      width = power * [1, 2, 2.5, 5, 10].find((step) => step * power >= rough);
      low = Math.floor(a / width) * width;
      bins = new Array(Math.floor((b - low) / width) + 1).fill(0);
      finite.forEach((x) => { bins[Math.min(Math.floor((x - low) / width), bins.length - 1)] += 1; });
      most = Math.max(...bins, 1);
      const under = column.limit === null || column.limit === undefined ? null : values.filter((x) => x < column.limit).length;
      note.textContent = [
        `${values.length} pilots that cover the box evenly`,
        under === null ? "" : `${under} of them (${(100 * under / values.length).toFixed(1)} %) below ${text.number(column.limit, column.digits)}${text.unit(column)}`,
        outside[0] ? `${outside[0]} without a crossing, so without a limit` : "",
        outside[1] ? `${outside[1]} unstable without a crossing` : "",
      ].filter(Boolean).join("; ") + ".";
    }
    gather();
    const limit = () => (column.limit === null || column.limit === undefined ? [] : [column.limit]);
    const view = pilotgen.chart.chart(host, {
      x: { label: () => text.axis(column), range: () => {
        const every = [...column.values.subarray(0, model.data.count)].filter(Number.isFinite);
        const ends = [low, low + width * bins.length, every.reduce((a, b) => Math.min(a, b), low), ...limit()];
        const [a, b] = [Math.min(...ends), Math.max(...ends)];
        return [a - 0.03 * (b - a), b + 0.03 * (b - a)];
      } },
      y: { label: () => "pilots", range: () => [0, 1.08 * most], marks: (value) => (Number.isInteger(value) ? String(value) : "") },
      draw(pen) {
        const { ctx } = pen;
        bins.forEach((count, k) => {
          const [a, b] = [low + k * width, low + (k + 1) * width];
          const bad = limit().length && b <= column.limit + 1e-9;
          ctx.fillStyle = bad ? look.css("--mark") : look.css("--bar");
          ctx.fillRect(pen.X(a) + pen.ratio, pen.Y(count), pen.X(b) - pen.X(a) - 2 * pen.ratio, pen.Y(0) - pen.Y(count));
        });
        limit().forEach((at) => {
          pen.along(at, look.css("--limit"), { dash: [6, 4], width: 1.6 });
          const { min, max } = pen.u.scales.x, right = at > 0.7 * max + 0.3 * min;
          pen.text(at, 1.03 * most, `limit ${text.number(at, 0)}${text.unit(column)}`, look.css("--ink"), { dx: right ? -5 : 5, align: right ? "right" : "left" });
        });
        const own = state.pilot === null ? NaN : column.values[state.pilot];
        if (Number.isFinite(own)) {
          pen.along(own, look.css("--chosen"), { width: 2.4 });
          pen.text(own, 0.9 * most, "chosen", look.css("--ink"), { dx: 5 });
        }
      },
      hover(place) {
        const k = Math.floor((place.x - low) / width);
        const known = k >= 0 && k < bins.length;
        pilotgen.tip.show(view.u.over, place, known ? [`${bins[k]} pilots`, `${text.axis(column)} ${text.number(low + k * width, 2)} to ${text.number(low + (k + 1) * width, 2)}`] : null);
      },
      leave: () => pilotgen.tip.show(null),
      pick(place) {
        const rows = model.data.fair.filter((k) => Number.isFinite(column.values[k]));
        rows.sort((a, b) => Math.abs(column.values[a] - place.x) - Math.abs(column.values[b] - place.x));
        if (rows.length) state.choose(rows[0]);
      },
    });
    return { view, again: () => { gather(); view.reset(); }, get bins() { return { low, width, bins }; } };
  }

  return { cloud, histogram, colourBy, brief };
})();
