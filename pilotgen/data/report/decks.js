// The text of a deck, with its words told apart by colour.
"use strict";

pilotgen.decks = (() => {
  const { text, state, model } = pilotgen;
  const PATTERN = /(#[^\n]*)|("[^"\n]*")|(\b[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\b)|(^[ \t]*(?:begin|end|set|joint|body|structural|reference|constitutive law|total pin joint|include|drive caller|genel|abstract|rod|force|modal|gravity|problem|initial value|control data|nodes|elements|data)\b)/gm;
  const KINDS = ["comment", "string", "number", "word"];

  function highlighted(content) {
    const pre = text.element("pre", { class: "deck", tabindex: "0" });
    let done = 0;
    for (const found of content.matchAll(PATTERN)) {
      pre.append(content.slice(done, found.index));
      const kind = KINDS[found.slice(1).findIndex((part) => part !== undefined)];
      pre.append(text.element("span", { class: `deck-${kind}` }, found[0]));
      done = found.index + found[0].length;
    }
    pre.append(content.slice(done));
    return pre;
  }

  function show(host) {
    const own = model.data.decks.find((deck) => deck.index === state.pilot);
    const fold = host.querySelector("details");
    if (fold && fold.dataset.pilot === String(state.pilot)) return;
    if (!own) {
      host.replaceChildren(text.element("p", { class: "quiet" }, "His decks are not kept; the command above writes them again."));
      return;
    }
    const children = [];
    if (own.path) children.push(text.element("p", {}, "His decks: ", text.element("a", { href: own.path }, own.path.replace(/[^/]*$/, "") || own.path)));
    if (own.text) {
      const details = text.element("details", { "data-pilot": state.pilot }, text.element("summary", {}, `text of ${own.name}`));
      details.addEventListener("toggle", async () => {
        if (details.open && !details.querySelector("pre")) details.append(highlighted(await pilotgen.decode.unzipped(own.text)));
      });
      children.push(details);
    }
    host.replaceChildren(...children);
  }

  return { show, highlighted };
})();
