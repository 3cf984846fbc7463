// Which pilot and which frequency the page is about, and who wants to know.
"use strict";

pilotgen.state = (() => {
  const listeners = { pilot: [], hz: [], look: [] };
  const state = { pilot: null, hz: null };
  const tell = (what) => listeners[what].forEach((listener) => listener(state[what]));

  function choose(pilot) {
    if (pilot === state.pilot || !(pilot >= 0)) return;
    state.pilot = pilot;
    tell("pilot");
  }

  function setHz(hz) {
    if (hz === state.hz) return;
    state.hz = hz;
    tell("hz");
  }

  // the next pilot in the order from worst to best; the nominal pilot stands in it where his margins put him
  function step(by) {
    const order = pilotgen.state.order;
    const place = order.indexOf(state.pilot);
    choose(order[Math.min(Math.max((place < 0 ? 0 : place) + by, 0), order.length - 1)]);
  }

  return {
    order: [], choose, setHz, step,
    on: (what, listener) => listeners[what].push(listener),
    redraw: () => tell("look"),
    get pilot() { return state.pilot; },
    get hz() { return state.hz; },
  };
})();

pilotgen.text = (() => {
  function number(x, digits) {
    if (x === undefined || Number.isNaN(x)) return "–";
    if (!Number.isFinite(x)) return x > 0 ? "none" : "−∞";
    if (x !== 0 && Math.abs(x) < 0.5 * 10 ** -digits) return x.toExponential(1).replace(/-/g, "−");
    return x.toFixed(digits).replace("-", "−");
  }
  const unit = (column) => (column.unit ? ` ${column.unit}` : "");
  const axis = (column) => (column.unit ? `${column.label} [${column.unit}]` : column.label);
  const of = (column, pilot) => {
    const x = column.values[pilot];
    return number(x, column.digits) + (Number.isFinite(x) ? unit(column) : "");
  };
  function element(tag, attributes = {}, ...children) {
    const found = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name === "on") Object.entries(value).forEach(([event, act]) => found.addEventListener(event, act));
      else if (value === true) found.setAttribute(name, "");
      else if (value !== false && value !== null && value !== undefined) found.setAttribute(name, value);
    }
    found.append(...children.filter((child) => child !== null));
    return found;
  }
  function name(pilot) {
    const { data } = pilotgen.model;
    if (pilot === data.nominal) return "nominal pilot";
    if (data.count === 1) return "this pilot";
    const place = data.order.indexOf(pilot);
    return place === 0 ? "worst pilot" : `pilot ${pilot + 1} (${place + 1} of ${data.order.length} from the worst)`;
  }
  return { number, unit, axis, of, element, name };
})();
