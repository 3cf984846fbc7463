// A pair of axes that zooms, by uPlot; what stands in it is drawn by the view that owns it.
"use strict";

pilotgen.chart = (() => {
  const PICK_PX = 28;
  const all = [];

  // options: x, y = {label, log, range: () => [low, high], marks: (value) => text}, square, draw(pen), hover(place), pick(place)
  function chart(host, options) {
    const area = pilotgen.text.element("div", { class: "plot" });
    host.append(area);
    let zoomed = null, box = null, u = null;

    function measure() {
      const found = zoomed || { x: options.x.range(), y: options.y.range() };
      box = options.square && u ? squared(found) : found;
    }
    const range = (name) => { if (!box) measure(); return box[name]; };
    const axis = (name) => ({
      scale: name,
      label: options[name].label(),
      labelSize: 20, labelGap: 2,
      size: name === "x" ? 30 : 52, gap: 3,
      font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif",
      stroke: () => pilotgen.look.css("--ink"),
      grid: { stroke: () => pilotgen.look.css("--grid"), width: 1 },
      ticks: { stroke: () => pilotgen.look.css("--line"), width: 1, size: 4 },
      values: (_, splits) => splits.map((value) => (value === null ? "" : options[name].marks ? options[name].marks(value) : plain(value))),
      ...(options[name].log ? { filter: (_, splits) => splits.map((value) => (keptOnLog(value, range(name)) ? value : null)) } : {}),
      ...(options[name].every ? { incrs: options[name].every } : {}),
    });
    const scale = (name) => ({ time: false, auto: false, distr: options[name].log ? 3 : 1, range: () => range(name) });
    const size = () => ({ width: Math.max(area.clientWidth, 180), height: Math.max(area.clientHeight, 160) });

    u = new uPlot({
      ...size(),
      legend: { show: false },
      scales: { x: scale("x"), y: scale("y") },
      axes: [axis("x"), axis("y")],
      series: [{}, { paths: () => null, points: { show: false } }],
      cursor: {
        x: false, y: false, points: { show: false },
        drag: { x: true, y: true, setScale: false, dist: 6 },
        bind: { dblclick: () => () => { zoomed = null; refresh(); } },
      },
      hooks: {
        draw: [paint],
        setSelect: [select],
        setCursor: [() => options.hover && u.cursor.left >= 0 && options.hover(place(u.cursor.left, u.cursor.top))],
      },
    }, [[0, 1], [null, null]], area);

    function place(left, top) {
      return {
        left, top, x: u.posToVal(left, "x"), y: u.posToVal(top, "y"),
        // the nearest of points (x[k], y[k]) on the screen, or -1
        nearest(x, y, count, within = PICK_PX) {
          let best = -1, least = within * within;
          for (let k = 0; k < count; k += 1) {
            const far = (u.valToPos(x(k), "x") - left) ** 2 + (u.valToPos(y(k), "y") - top) ** 2;
            if (far < least) [best, least] = [k, far];
          }
          return best;
        },
      };
    }

    function select() {
      const { left, top, width, height } = u.select;
      u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      if (width < 6 && height < 6) return;
      const chosen = { x: [u.posToVal(left, "x"), u.posToVal(left + width, "x")], y: [u.posToVal(top + height, "y"), u.posToVal(top, "y")] };
      if (width < 6) chosen.x = range("x");
      if (height < 6) chosen.y = range("y");
      zoomed = chosen;
      refresh();
    }

    // the same length of a unit along both axes
    function squared({ x, y }) {
      const wide = u.over.clientWidth || 1, high = u.over.clientHeight || 1;
      const unit = Math.max((x[1] - x[0]) / wide, (y[1] - y[0]) / high);
      const about = (pair, span) => [(pair[0] + pair[1] - span) / 2, (pair[0] + pair[1] + span) / 2];
      return { x: about(x, unit * wide), y: about(y, unit * high) };
    }

    function paint(self) { // uPlot paints for the first time before it is known here
      u = self;
      const { ctx } = u;
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      options.draw(pen(u));
      ctx.restore();
    }

    function refresh() {
      measure();
      u.axes.forEach((one, k) => { one.label = options["xy"[k]].label(); });
      u.batch(() => {
        u.setScale("x", { min: box.x[0], max: box.x[1] });
        u.setScale("y", { min: box.y[0], max: box.y[1] });
      });
      u.redraw(false, true);
    }

    u.over.addEventListener("click", (event) => {
      const rect = u.over.getBoundingClientRect();
      if (options.pick) options.pick(place(event.clientX - rect.left, event.clientY - rect.top));
    });
    u.over.addEventListener("mouseleave", () => options.leave && options.leave());
    new ResizeObserver(() => {
      const next = size();
      if (next.width === u.width && next.height === u.height) return;
      u.setSize(next);
      queueMicrotask(refresh); // when uPlot has done so
    }).observe(area);
    const self = { u, refresh, redraw: () => u.redraw(false, false), reset: () => { zoomed = null; refresh(); }, options };
    pilotgen.state.on("look", refresh);
    queueMicrotask(refresh); // when uPlot has measured itself
    all.push(self);
    return self;
  }

  const plain = (value) => String(Number(value.toPrecision(6))).replace("-", "−");
  // of decades the steps 1, 2, 5; of less than one decade everything
  const keptOnLog = (value, [low, high]) => high / low < 12 || /^[125](\.0*)?e/.test(value.toExponential(6));

  function pen(u) {
    const { ctx } = u;
    const ratio = uPlot.pxRatio;
    const X = (x) => u.valToPos(x, "x", true), Y = (y) => u.valToPos(y, "y", true);
    return {
      u, ctx, ratio, X, Y,
      line(x, y, colour, { width = 1.8, dash = [], from = 0, to = x.length } = {}) {
        ctx.beginPath();
        for (let k = from; k < to; k += 1) ctx.lineTo(X(x[k]), Y(y[k]));
        ctx.strokeStyle = colour;
        ctx.lineWidth = width * ratio;
        ctx.lineJoin = "round";
        ctx.setLineDash(dash.map((part) => part * ratio));
        ctx.stroke();
        ctx.setLineDash([]);
      },
      across(y, colour, more) { this.line([u.scales.x.min, u.scales.x.max], [y, y], colour, { width: 1, ...more }); },
      along(x, colour, more) { this.line([x, x], [u.scales.y.min, u.scales.y.max], colour, { width: 1, ...more }); },
      arc(x, y, radius, colour, { from = 0, to = 2 * Math.PI, width = 1, dash = [], fill = null } = {}) {
        ctx.beginPath(); // angles as in mathematics, counter-clockwise
        const n = 120;
        for (let k = 0; k <= n; k += 1) {
          const angle = from + (to - from) * k / n;
          ctx.lineTo(X(x + radius * Math.cos(angle)), Y(y + radius * Math.sin(angle)));
        }
        if (fill) { ctx.fillStyle = fill; ctx.fill(); }
        ctx.strokeStyle = colour;
        ctx.lineWidth = width * ratio;
        ctx.setLineDash(dash.map((part) => part * ratio));
        ctx.stroke();
        ctx.setLineDash([]);
      },
      dot(x, y, radius, fill, edge = null, width = 1.5) {
        ctx.beginPath();
        ctx.arc(X(x), Y(y), radius * ratio, 0, 2 * Math.PI);
        if (fill) { ctx.fillStyle = fill; ctx.fill(); }
        if (edge) { ctx.strokeStyle = edge; ctx.lineWidth = width * ratio; ctx.stroke(); }
      },
      diamond(x, y, radius, edge, width = 1.5) {
        const [a, b, r] = [X(x), Y(y), radius * ratio];
        ctx.beginPath();
        ctx.moveTo(a, b - r); ctx.lineTo(a + r, b); ctx.lineTo(a, b + r); ctx.lineTo(a - r, b); ctx.closePath();
        ctx.strokeStyle = edge;
        ctx.lineWidth = width * ratio;
        ctx.stroke();
      },
      text(x, y, words, colour, { dx = 0, dy = 0, align = "left" } = {}) {
        ctx.font = `${12 * ratio}px system-ui, sans-serif`;
        ctx.textAlign = align;
        ctx.textBaseline = "middle";
        ctx.lineWidth = 3 * ratio;
        ctx.strokeStyle = pilotgen.look.css("--paper");
        ctx.strokeText(words, X(x) + dx * ratio, Y(y) + dy * ratio);
        ctx.fillStyle = colour;
        ctx.fillText(words, X(x) + dx * ratio, Y(y) + dy * ratio);
      },
    };
  }

  // Where values go: infinite ones on a strip beyond the finite range.
  function placed(values, rows, more = []) {
    let low = Infinity, high = -Infinity, above = false, below = false;
    for (const x of [...rows.map((k) => values[k]), ...more]) {
      if (Number.isFinite(x)) { low = Math.min(low, x); high = Math.max(high, x); }
      else if (x === Infinity) above = true;
      else if (x === -Infinity) below = true;
    }
    const empty = low > high;
    if (empty) [low, high] = [0, 1];
    const air = 0.06 * (high - low) || 0.1 * Math.max(Math.abs(high), 1);
    const edge = [low - air, high + air], strip = 0.1 * (high - low + 2 * air);
    return {
      of: (x) => (x === Infinity ? edge[1] + strip / 2 : x === -Infinity ? edge[0] - strip / 2 : x),
      range: [edge[0] - (below ? strip : 0), edge[1] + (above ? strip : 0)],
      marks: (value) => (empty || value < edge[0] || value > edge[1] ? "" : plain(value)),
      above: above ? edge[1] : null, below: below ? edge[0] : null,
    };
  }

  return { chart, placed, all, plain };
})();
