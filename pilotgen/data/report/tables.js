// The table of pilots: sorted, filtered, walked by keys, taken away as CSV or JSON.
"use strict";

pilotgen.tables = (() => {
  const { text, state, model } = pilotgen;
  const ROWS = 15;

  // "stature_m>1.9 gain_margin_db<6": every word must hold; a word without a sign is looked for in the pilot's name
  function filterOf(words) {
    const tests = [];
    for (const word of words.trim().split(/\s+/).filter(Boolean)) {
      const parts = /^([^<>=]+)(<=|>=|<|>|=)(.+)$/.exec(word);
      if (!parts) { tests.push({ test: (pilot) => text.name(pilot).includes(word) }); continue; }
      const [, key, sign, given] = parts;
      const limit = given === "none" ? Infinity : Number(given.replace("−", "-"));
      const column = model.column(key);
      if (!column || Number.isNaN(limit)) return { problem: column ? `${given} is no number` : `no column is called ${key}` };
      const compare = { "<": (a) => a < limit, ">": (a) => a > limit, "<=": (a) => a <= limit, ">=": (a) => a >= limit, "=": (a) => a === limit };
      tests.push({ test: (pilot) => compare[sign](column.values[pilot]) });
    }
    return { keep: (pilot) => tests.every(({ test }) => test(pilot)) };
  }

  function quoted(word) {
    return /^[\w.=@%+:,/-]+$/.test(word) ? word : `'${word.replace(/'/g, "'\"'\"'")}'`;
  }

  function command(pilot) {
    const { study, solver, more } = model.data.command;
    const settings = more.map(quoted).concat( model.columns.filter((column) => column.role === "variable")
      .map((column) => quoted(`${column.key}=${Number.isInteger(column.values[pilot]) ? column.values[pilot].toFixed(1) : column.values[pilot]}`)));
    const other = solver === "mbdae" ? "" : ` --solver ${solver}`;
    const all = pilot === model.data.nominal ? "" : ` --set ${settings.join(" ")}`;
    return `pilotgen pilot ${quoted(study)} -o replay${other}${all}`;
  }

  function save(name, kind, content) {
    const link = text.element("a", { href: URL.createObjectURL(new Blob([content], { type: kind })), download: name });
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  function pilots(host) {
    const shown = model.columns.filter((column) => column.role !== "derived" || !/_deg$|certificate/.test(column.key));
    let sorted = { key: null, down: false }, page = 0, words = "", rows = [], current = null;

    const filter = text.element("input", { type: "search", id: "filter", placeholder: "stature_m>1.9 gain_margin_db<6", autocomplete: "off", spellcheck: "false" });
    const problem = text.element("span", { class: "problem", role: "status" });
    const count = text.element("span", { class: "quiet", role: "status" });
    const body = text.element("tbody");
    const heads = shown.map((column) => text.element("th", { scope: "col", "aria-sort": "none" },
      text.element("button", { type: "button", title: `${column.key}: sort`, on: { click: () => sort(column.key) } }, text.axis(column))));
    const place = text.element("th", { scope: "col", "aria-sort": "ascending" },
      text.element("button", { type: "button", title: "worst first", on: { click: () => sort(null) } }, "place"));
    const table = text.element("table", { id: "pilots", class: "data" },
      text.element("caption", { class: "hidden" }, "Evaluated pilots; worst first unless sorted otherwise"),
      text.element("thead", {}, text.element("tr", {}, place, ...heads, text.element("th", { scope: "col" }, "closed loop"), text.element("th", { scope: "col" }, "command"))), body);
    const pager = text.element("div", { class: "row" },
      text.element("button", { type: "button", on: { click: () => turn(-1) } }, "‹ previous"), count,
      text.element("button", { type: "button", on: { click: () => turn(1) } }, "next ›"));
    const keys = shown.map((column) => column.key).join(", ");
    host.replaceChildren(
      text.element("div", { class: "row" },
        text.element("label", { for: "filter" }, "Filter"), filter, problem,
        text.element("button", { type: "button", id: "csv", on: { click: csv } }, "CSV"),
        text.element("button", { type: "button", id: "json", on: { click: json } }, "JSON")),
      text.element("p", { class: "quiet" }, `Columns to filter by: ${keys}. Arrow keys walk the rows, Enter chooses a pilot.`),
      text.element("div", { class: "wide", tabindex: "0", role: "region", "aria-label": "table of pilots" }, table), pager);

    filter.addEventListener("input", () => { words = filter.value; page = 0; gather(); });
    body.addEventListener("keydown", (event) => {
      const row = event.target.closest("tr");
      if (!row || event.target !== row) return;
      const move = { ArrowDown: 1, ArrowUp: -1, PageDown: ROWS, PageUp: -ROWS }[event.key];
      if (move) { event.preventDefault(); event.stopPropagation(); focusOn(rows.indexOf(Number(row.dataset.pilot)) + move); }
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); state.choose(Number(row.dataset.pilot)); }
    });

    function focusOn(k) {
      const next = Math.min(Math.max(k, 0), rows.length - 1);
      page = Math.floor(next / ROWS);
      current = rows[next];
      draw();
      const row = body.querySelector(`tr[data-pilot="${current}"]`);
      if (row) row.focus();
    }

    function sort(key) {
      sorted = { key, down: sorted.key === key && !sorted.down };
      page = 0;
      gather();
    }

    function turn(by) {
      page = Math.min(Math.max(page + by, 0), Math.max(Math.ceil(rows.length / ROWS) - 1, 0));
      draw();
    }

    function gather() {
      const found = filterOf(words);
      problem.textContent = found.problem || "";
      if (found.problem) return;
      rows = state.order.filter(found.keep);
      if (sorted.key !== null) {
        const { values } = model.column(sorted.key);
        const rank = (k) => (Number.isNaN(values[k]) ? Infinity : values[k]);
        rows.sort((a, b) => rank(a) - rank(b) || 0);
      }
      if (sorted.down) rows.reverse();
      [place, ...heads].forEach((head, k) => {
        const own = k === 0 ? sorted.key === null : shown[k - 1].key === sorted.key;
        head.setAttribute("aria-sort", own ? (sorted.down ? "descending" : "ascending") : "none");
      });
      draw();
    }

    function draw() {
      const part = rows.slice(page * ROWS, (page + 1) * ROWS);
      const focusable = part.includes(current) ? current : part[0];
      body.replaceChildren(...part.map((pilot) => {
        const at = model.data.order.indexOf(pilot);
        return text.element("tr", { "data-pilot": pilot, tabindex: pilot === focusable ? "0" : "-1", "aria-selected": pilot === state.pilot ? "true" : "false", on: { click: () => state.choose(pilot) } },
          text.element("td", {}, pilot === model.data.nominal ? "nominal" : String(at + 1)),
          ...shown.map((column) => text.element("td", {}, text.number(column.values[pilot], column.digits))),
          text.element("td", {}, model.data.stable[pilot] === 1 ? "stable" : "UNSTABLE"),
          text.element("td", {}, text.element("button", { type: "button", title: command(pilot), on: { click: (event) => { event.stopPropagation(); copy(command(pilot), event.target); } } }, "copy")));
      }));
      const last = Math.min((page + 1) * ROWS, rows.length);
      count.textContent = rows.length ? `${page * ROWS + 1} to ${last} of ${rows.length} pilots` : "no pilot";
    }

    const every = () => model.columns;
    function csv() {
      const cell = (x) => (Number.isNaN(x) ? "" : Number.isFinite(x) ? String(x) : x > 0 ? "inf" : "-inf");
      const lines = [["pilot", ...every().map((column) => column.key), "stable"].join(",")];
      rows.forEach((pilot) => lines.push([pilot === model.data.nominal ? "nominal" : pilot, ...every().map((column) => cell(column.values[pilot])), model.data.stable[pilot]].join(",")));
      save("pilots.csv", "text/csv", `${lines.join("\n")}\n`);
    }

    function json() {
      const plain = (x) => (Number.isFinite(x) ? x : null);
      const list = rows.map((pilot) => ({ pilot: pilot === model.data.nominal ? "nominal" : pilot,
        ...Object.fromEntries(every().map((column) => [column.key, plain(column.values[pilot])])), stable: model.data.stable[pilot] === 1, command: command(pilot) }));
      save("pilots.json", "application/json", `${JSON.stringify(list, null, 1)}\n`);
    }

    state.on("pilot", draw);
    gather();
    return { csvRows: () => rows, sort, focusOn };
  }

  async function copy(words, button) {
    try {
      await navigator.clipboard.writeText(words);
    } catch (error) { // a page from a file share may not use the clipboard
      const area = text.element("textarea", {}, words);
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    const before = button.textContent;
    button.textContent = "copied";
    setTimeout(() => { button.textContent = before; }, 1200);
  }

  return { pilots, command, copy };
})();
