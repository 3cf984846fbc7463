// Two studies in one cloud and one histogram.
"use strict";

pilotgen.compare = () => {
  const { text, look, chart: charts } = pilotgen;
  const by = (id) => document.getElementById(id);
  const data = JSON.parse(by("pilotgen-data").textContent);
  const COLOURS = ["--chosen", "--mark"];
  const column = (key) => data.columns.find((one) => one.key === key);
  const sides = data.sides.map((side) => ({
    ...side, columns: Object.fromEntries(Object.entries(side.columns).map(([key, packed]) => [key, pilotgen.decode.wide(packed)])),
  }));
  const options = (select, columns, chosen) => select.replaceChildren(...columns.map((one) => text.element("option", { value: one.key, selected: one.key === chosen }, text.axis(one))));
  const first = data.objectives[0];
  const variables = data.columns.filter((one) => !data.objectives.includes(one.key));
  options(by("compare-x"), data.columns, variables.at(-1).key);
  options(by("compare-y"), data.columns, first);
  options(by("compare-of"), data.columns.filter((one) => data.objectives.includes(one.key)), first);
  let chosen = null; // {side, pilot}

  // ---- clouds
  let x, y, px, py;
  function gather() {
    [x, y] = [by("compare-x").value, by("compare-y").value];
    const both = (key) => sides.flatMap((side) => side.ok.map((k) => side.columns[key][k]));
    const all = both(x).map((_, k) => k);
    px = charts.placed(both(x), all);
    py = charts.placed(both(y), all);
  }
  gather();
  const X = (side, k) => px.of(sides[side].columns[x][k]), Y = (side, k) => py.of(sides[side].columns[y][k]);
  const points = () => sides.flatMap((side, s) => side.ok.map((k) => [s, k]));
  const view = charts.chart(by("clouds"), {
    x: { label: () => text.axis(column(x)), range: () => px.range, marks: (value) => px.marks(value) },
    y: { label: () => text.axis(column(y)), range: () => py.range, marks: (value) => py.marks(value) },
    draw(pen) {
      for (const [key, along] of [[x, "along"], [y, "across"]]) {
        const { limit } = column(key);
        if (limit !== null && limit !== undefined) pen[along](limit, look.css("--limit"), { dash: [6, 4], width: 1.2 });
      }
      if (by("pairs").checked) data.pairs.forEach(([a, b]) => pen.line([X(0, a), X(1, b)], [Y(0, a), Y(1, b)], look.css("--axis"), { width: 0.6 }));
      sides.forEach((side, s) => {
        const colour = look.css(COLOURS[s]), size = side.ok.length > 800 ? 2.2 : 3.4;
        side.ok.forEach((k) => mark(pen, s, k, size, colour));
        mark(pen, s, side.worst, 7, colour);
      });
      if (chosen) pen.dot(X(...chosen), Y(...chosen), 10, null, look.css("--ink"), 2);
    },
    hover(place) {
      const all = points();
      const k = place.nearest((j) => X(...all[j]), (j) => Y(...all[j]), all.length);
      pilotgen.tip.show(view.u.over, place, k < 0 ? null : told(...all[k]));
    },
    leave: () => pilotgen.tip.show(null),
    pick(place) {
      const all = points();
      const k = place.nearest((j) => X(...all[j]), (j) => Y(...all[j]), all.length, 40);
      chosen = k < 0 ? null : all[k];
      view.redraw();
    },
  });
  function mark(pen, s, k, size, colour) {
    if (s === 0) { pen.dot(X(s, k), Y(s, k), size, colour); return; }
    const { ctx } = pen, [a, b, r] = [pen.X(X(s, k)), pen.Y(Y(s, k)), size * 1.15 * pen.ratio];
    ctx.beginPath();
    ctx.moveTo(a, b - r); ctx.lineTo(a + r, b + r * 0.8); ctx.lineTo(a - r, b + r * 0.8); ctx.closePath();
    ctx.fillStyle = colour;
    ctx.fill();
  }
  const told = (s, k) => [sides[s].name, ...data.columns.map((one) => {
    const value = sides[s].columns[one.key][k];
    return `${one.label} ${text.number(value, one.digits)}${Number.isFinite(value) ? text.unit(one) : ""}`;
  })];
  ["compare-x", "compare-y"].forEach((id) => by(id).addEventListener("change", () => { gather(); view.reset(); }));
  by("pairs").addEventListener("change", () => view.redraw());
  by("pairs").disabled = data.pairs.length === 0;

  // ---- histograms: shares of the evenly spread pilots of each
  let low, width, shares, most;
  function count() {
    const key = by("compare-of").value;
    const values = sides.map((side) => side.even.map((k) => side.columns[key][k]));
    const finite = values.flat().filter(Number.isFinite).sort((a, b) => a - b);
    const [a, b] = finite.length ? [finite[0], finite.at(-1)] : [0, 1];
    width = (b - a) / 16 || 1;
    low = a;
    shares = values.map((list) => {
      const bins = new Array(17).fill(0);
      list.filter(Number.isFinite).forEach((value) => { bins[Math.min(Math.floor((value - low) / width), 16)] += 100 / list.length; });
      return bins;
    });
    most = Math.max(...shares.flat(), 1);
  }
  count();
  const bars = charts.chart(by("bars"), {
    x: { label: () => text.axis(column(by("compare-of").value)), range: () => [low - width, low + 18 * width] },
    y: { label: () => "pilots [%]", range: () => [0, 1.08 * most] },
    draw(pen) {
      shares.forEach((bins, s) => {
        const colour = look.css(COLOURS[s]);
        const xs = [low], ys = [0];
        bins.forEach((share, k) => { xs.push(low + k * width, low + (k + 1) * width); ys.push(share, share); });
        xs.push(low + bins.length * width);
        ys.push(0);
        pen.ctx.globalAlpha = 0.25;
        pen.ctx.fillStyle = colour;
        bins.forEach((share, k) => pen.ctx.fillRect(pen.X(low + k * width), pen.Y(share), pen.X(low + (k + 1) * width) - pen.X(low + k * width), pen.Y(0) - pen.Y(share)));
        pen.ctx.globalAlpha = 1;
        pen.line(xs, ys, colour, { width: 2 });
      });
      const { limit } = column(by("compare-of").value);
      if (limit !== null && limit !== undefined) pen.along(limit, look.css("--limit"), { dash: [6, 4], width: 1.6 });
    },
  });
  by("compare-of").addEventListener("change", () => { count(); bars.reset(); });
  pilotgen.compared = { sides, view, bars, screen: (s, k) => [view.u.valToPos(X(s, k), "x"), view.u.valToPos(Y(s, k), "y")], get chosen() { return chosen; }, get shares() { return shares; } };
  document.documentElement.dataset.ready = "true";
};

pilotgen.compare();
