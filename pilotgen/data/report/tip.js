// A few lines beside the pointer.
"use strict";

pilotgen.tip = (() => {
  let box = null;
  function show(over, place, lines) {
    if (box === null) {
      box = pilotgen.text.element("div", { class: "tip", role: "status" });
      document.body.append(box);
    }
    if (!over || !lines) { box.hidden = true; return; }
    box.replaceChildren(...lines.map((line, k) => pilotgen.text.element(k ? "div" : "strong", {}, line)));
    box.hidden = false;
    const rect = over.getBoundingClientRect();
    const left = Math.min(rect.left + place.left + 14, innerWidth - box.offsetWidth - 8);
    const top = Math.min(rect.top + place.top + 14, innerHeight - box.offsetHeight - 8);
    box.style.left = `${Math.max(left, 4)}px`;
    box.style.top = `${Math.max(top, 4)}px`;
  }
  return { show };
})();
