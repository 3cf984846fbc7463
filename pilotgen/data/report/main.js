// The page comes to life: what is there gets its view, and every view follows the chosen pilot.
"use strict";

pilotgen.start = () => {
  const began = performance.now();
  const { text, state, model, clouds, responses, tables } = pilotgen;
  const by = (id) => document.getElementById(id);
  model.load(JSON.parse(by("pilotgen-data").textContent));
  const { data } = model;
  const finite = (key) => model.column(key) && model.column(key).values.some(Number.isFinite);
  const nominalSecond = finite("phase_margin_deg") ? "phase_margin_deg" : "modulus_margin";
  const nominalFirst = finite("gain_margin_db") ? "gain_margin_db" : nominalSecond;
  // of a robust search: what was searched for
  const [first, second] = data.plane || [nominalFirst, nominalSecond];

  const rank = model.column(nominalFirst).values;
  state.order = [...data.order];
  if (data.nominal !== null) {
    const place = state.order.findIndex((k) => rank[k] > rank[data.nominal]);
    state.order.splice(place < 0 ? state.order.length : Math.max(place, Math.min(1, state.order.length)), 0, data.nominal);
  }

  const again = [];
  const wanted = location.hash.startsWith("#pilot=") ? Number(location.hash.slice(7)) : NaN;

  function options(select, chosen, allowed = () => true) {
    select.replaceChildren(...model.columns.filter(allowed).map((column) => text.element("option", { value: column.key, selected: column.key === chosen }, text.axis(column))));
  }

  // ---- clouds
  const views = {};
  if (by("cloud")) {
    const variables = model.columns.filter((column) => column.role === "variable");
    options(by("cloud-x"), variables[variables.length > 1 ? variables.length - 1 : 0].key);
    options(by("cloud-y"), variables.length > 1 ? variables[variables.length - 2].key : first);
    options(by("colour"), first, (column) => column.role === "objective");
    options(by("histogram-of"), first, (column) => column.role === "objective");
    clouds.colourBy(by("colour").value);
    views.cloud = clouds.cloud(by("cloud"), () => [model.column(by("cloud-x").value), model.column(by("cloud-y").value)], { limits: true });
    views.front = clouds.cloud(by("front"), () => [model.column(first), model.column(second)], { front: true, limits: true });
    views.histogram = clouds.histogram(by("histogram"), () => by("histogram-of").value, by("histogram-note"));
    ["cloud-x", "cloud-y"].forEach((id) => by(id).addEventListener("change", () => views.cloud.again()));
    by("colour").addEventListener("change", () => clouds.colourBy(by("colour").value));
    by("histogram-of").addEventListener("change", () => views.histogram.again());
    again.push(...[views.cloud, views.front, views.histogram].map((one) => () => one.view.redraw()));
  }

  // ---- responses
  const loopLines = (pen) => pen.across(0, pilotgen.look.css("--axis"));
  const turns = (pen) => [-180, 180, -540].forEach((deg) => pen.across(deg, pilotgen.look.css("--axis")));
  views.nyquist = responses.nyquist(by("nyquist"));
  views.grip = responses.bode(by("bode-grip"), { field: "mm", label: `mm per ${data.loop.per}`, log: true });
  views.gripPhase = responses.bode(by("bode-grip-phase"), { field: "gripDeg", label: "phase [deg]", every: [15, 30, 45, 90, 180, 360] });
  views.loop = responses.bode(by("bode-loop"), { field: "db", label: "|L| [dB]", lines: loopLines, limits: [-70, 60] });
  views.loopPhase = responses.bode(by("bode-loop-phase"), { field: "deg", label: "phase [deg]", lines: turns, every: [15, 30, 45, 90, 180, 360] });
  const curves = [views.nyquist, views.grip, views.gripPhase, views.loop, views.loopPhase];
  again.push(...curves.map((one) => one.again));
  state.on("hz", () => {
    curves.forEach((one) => one.view.redraw());
    by("readout").textContent = responses.readout(state.hz);
  });

  // ---- the pilot himself
  let solid = false;
  if (data.skeletons && by("figure")) {
    state.on("pilot", () => {
      const pilot = pilotgen.figure.shownPilot();
      by("figure-note").textContent = (pilot === state.pilot ? "" : `The skeleton of this pilot is not kept; drawn is the nearest one that is, the ${text.name(pilot)}. `) +
        (data.nominal !== null && pilot !== data.nominal ? "Grey: the nominal pilot." : "");
      muscles(pilot);
    });
    pilotgen.wake = () => { // drawing in 3-D begins when somebody comes near it
      if (solid) return;
      solid = pilotgen.figure.start(by("figure"));
      if (solid) figureControls();
    };
    const near = new IntersectionObserver((entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      near.disconnect();
      pilotgen.wake();
    }, { rootMargin: "300px" });
    near.observe(by("figure"));
  }

  function figureControls() {
    const { figure } = pilotgen;
    const hertz = data.skeletons.structure.shapes_hz;
    by("motion").replaceChildren(
      text.element("option", { value: "none" }, "standing still"), text.element("option", { value: "mode" }, "dominant mode"),
      ...hertz.map((hz, k) => text.element("option", { value: String(k + 1) }, `seat shaken at ${hz} Hz`)));
    const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    function play(on) {
      figure.set({ playing: on });
      by("play").textContent = on ? "❚❚ pause" : "▶ play";
      by("play").setAttribute("aria-pressed", String(on));
    }
    by("motion").addEventListener("change", () => {
      const { value } = by("motion");
      figure.set(value === "none" || value === "mode" ? { motion: value } : { motion: "response", shape: Number(value) });
      if (value === "none") play(false);
      else if (!calm) play(true);
      told();
    });
    function told() {
      const { motion, gain, shape } = figure.settings;
      by("gain-told").textContent = motion === "none" ? "" : motion === "mode"
        ? `grip ±${gain} mm` : `1 m/s² at ${hertz[shape - 1]} Hz, × ${gain}`;
    }
    by("gain").addEventListener("input", () => { figure.set({ gain: Number(by("gain").value) }); told(); });
    by("play").addEventListener("click", () => {
      if (figure.settings.motion === "none") { by("motion").value = "mode"; figure.set({ motion: "mode" }); told(); }
      play(!figure.settings.playing);
    });
    by("nominal-shown").addEventListener("change", () => figure.set({ nominal: by("nominal-shown").value }));
    document.querySelectorAll("[data-look]").forEach((button) => button.addEventListener("click", () => figure.look3d(button.dataset.look)));
    by("figure").addEventListener("keydown", (event) => {
      const name = { f: "front", s: "side", t: "top", r: "reset" }[event.key];
      if (name) figure.look3d(name);
    });
    by("activation-legend").replaceChildren("activation 0 ",
      text.element("span", { class: "ramp", style: `background:linear-gradient(to right,${[0, 0.25, 0.5, 0.75, 1].map((t) => pilotgen.look.rgb(pilotgen.look.activation(t))).join(",")})` }),
      ` ${figure.scale.toFixed(2)}`);
  }

  function muscles(pilot) {
    const body = pilotgen.figure.skeleton(pilot);
    const names = data.skeletons.structure.muscles;
    const order = names.map((_, k) => k).sort((a, b) => body.activation[b] - body.activation[a]);
    by("muscles").replaceChildren(...order.map((k) => text.element("tr", {}, text.element("th", { scope: "row" }, names[k]),
      text.element("td", {}, text.number(body.activation[k], 3)),
      text.element("td", { class: "bar" }, text.element("span", { style: `width:${(100 * Math.min(body.activation[k] / pilotgen.figure.scale, 1)).toFixed(1)}%` })))));
    by("joints").replaceChildren(...Object.entries(body.joints).flatMap(([name, angle]) => [
      text.element("dt", {}, name.replace("_deg", "").replace(/_/g, " ")), text.element("dd", {}, `${text.number(angle, 1)}°`)]));
  }

  // ---- who is chosen
  function card() {
    const pilot = state.pilot;
    by("who").textContent = text.name(pilot);
    const roles = (wantedRoles) => model.columns.filter((column) => wantedRoles.includes(column.role) && !/certificate/.test(column.key) && !(data.skeletons && /_deg$/.test(column.key) && column.role === "derived"));
    const list = (columns) => columns.flatMap((column) => [text.element("dt", {}, column.label), text.element("dd", {}, text.of(column, pilot))]);
    const disk = model.hasCurves(pilot) ? model.disk(pilot) : { value: NaN };
    by("person").replaceChildren(...list(roles(["variable", "derived"])));
    by("margins").replaceChildren(text.element("dt", {}, "closed loop"), text.element("dd", {}, data.stable[pilot] === 1 ? "stable" : "UNSTABLE"),
      ...list(roles(["objective"])), text.element("dt", {}, "disk margin"), text.element("dd", {}, text.number(disk.value, 3)));
    const certificate = model.value("certificate", pilot);
    by("certificate").textContent = Number.isFinite(certificate)
      ? `Certificate: his feedthrough differs from the full-order response by ${certificate.toExponential(1).replace("-", "−")} at most (relative, 0.1 to 20 Hz).` : "";
    by("command").textContent = tables.command(pilot);
    by("readout").textContent = responses.readout(state.hz);
    if (by("deck")) pilotgen.decks.show(by("deck"));
    by("chooser").value = [...by("chooser").options].some((option) => option.value === String(pilot)) ? String(pilot) : "";
    by("place").textContent = `${state.order.indexOf(pilot) + 1} of ${state.order.length}`;
    if (pilot !== first0) history.replaceState(null, "", `#pilot=${pilot}`);
  }
  const members = data.front.filter((k) => k !== data.order[0]);
  by("chooser").replaceChildren(
    text.element("option", { value: "", disabled: true }, "another pilot"),
    ...(data.order.length ? [text.element("option", { value: String(data.order[0]) }, data.count > 1 ? "worst pilot" : "this pilot")] : []),
    ...(data.nominal !== null ? [text.element("option", { value: String(data.nominal) }, "nominal pilot")] : []),
    ...members.slice(0, 60).map((k, j) => text.element("option", { value: String(k) }, `front, number ${j + 2}`)));
  by("chooser").addEventListener("change", () => state.choose(Number(by("chooser").value)));
  by("worse").addEventListener("click", () => state.step(-1));
  by("better").addEventListener("click", () => state.step(1));
  by("copy").addEventListener("click", () => tables.copy(by("command").textContent, by("copy")));
  by("reset-zoom").addEventListener("click", () => pilotgen.chart.all.forEach((one) => one.reset()));

  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, textarea, table, pre") || event.ctrlKey || event.altKey || event.metaKey) return;
    const by1 = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!by1) return;
    event.preventDefault();
    if (event.shiftKey) {
      const hz = (state.hz || 3) * 1.02 ** by1;
      state.setHz(Math.min(Math.max(hz, model.LOW_HZ), model.HIGH_HZ));
    } else state.step(by1);
  });

  const first0 = data.order.length ? data.order[0] : data.nominal;
  state.on("pilot", card);
  state.on("pilot", () => again.forEach((redraw) => redraw()));
  if (by("table")) views.table = tables.pilots(by("table"));
  state.choose(Number.isInteger(wanted) && wanted >= 0 && wanted < model.total && model.evaluated(wanted) ? wanted : first0);

  addEventListener("beforeprint", () => {
    if (pilotgen.wake) pilotgen.wake();
    if (solid) by("figure-print").src = pilotgen.figure.picture();
  });
  by("stills").addEventListener("click", () => {
    const on = document.documentElement.classList.toggle("with-stills");
    by("stills").setAttribute("aria-pressed", String(on));
  });
  pilotgen.views = views;
  pilotgen.started_ms = performance.now() - began;
  document.documentElement.dataset.ready = "true";
};

pilotgen.start();
