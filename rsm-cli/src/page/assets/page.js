// What the page does beside its plots: the theme, the contents, the library that draws. No label is ever written as HTML.
"use strict";
const rsm = { figures: new Map(), states: new Map(), spaces: 0, changes: 0 };

// ---- theme ----
rsm.kept = (value) => {
  // A page that is opened as a file may have no storage.
  try {
    if (value !== undefined) localStorage.setItem("rsm-theme", value);
    return localStorage.getItem("rsm-theme");
  } catch {
    return null;
  }
};
rsm.isDark = () => {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
};
rsm.theme = (name) => {
  document.documentElement.dataset.theme = name;
  rsm.named();
};
rsm.named = () => {
  rsm.changes += 1;
  document.querySelector(".theme").textContent = rsm.isDark() ? "Light" : "Dark";
  for (const redraw of rsm.figures.values()) redraw();
};

// ---- contents ----
rsm.contents = () => {
  const nav = document.querySelector(".top nav");
  document.querySelectorAll("main h2").forEach((heading, k) => {
    heading.id ||= "part-" + (k + 1);
    const link = document.createElement("a");
    link.href = "#" + heading.id;
    link.textContent = heading.textContent;
    nav.append(link);
  });
};

// ---- the library ----
rsm.unpacked = (text) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
};
rsm.library = async () => {
  const packed = document.getElementById("library");
  if (!packed) return false;
  (0, eval)(await rsm.unpacked(packed.textContent));
  return true;
};
// The numbers of a figure: as text, or compressed if there are many.
rsm.numbers = async (figure) => {
  const { textContent, dataset } = figure.querySelector("script");
  return JSON.parse("packed" in dataset ? await rsm.unpacked(textContent) : textContent);
};

// ---- switches: which causes are in what is shown ----
rsm.switches = () => {
  for (const group of document.querySelectorAll(".switch")) {
    const buttons = [...group.querySelectorAll("button")];
    const isIn = (button) => button.getAttribute("aria-pressed") === "true";
    const told = JSON.parse(group.dataset.told);
    const show = () => {
      const state = buttons.reduce((set, button, k) => set + (isIn(button) ? 2 ** k : 0), 0);
      group.querySelector(".told").textContent = told[state];
      rsm.changes += 1;
      rsm.states.set(group.dataset.group, state);
      for (const figure of document.querySelectorAll("figure[data-group]")) {
        if (figure.dataset.group === group.dataset.group) rsm.figures.get(figure)?.();
      }
    };
    for (const button of buttons) {
      button.addEventListener("click", () => {
        button.setAttribute("aria-pressed", String(!isIn(button)));
        show();
      });
    }
    show();
  }
};

// Draws the figures one after another, so that the page stays usable meanwhile; the still picture is there before.
rsm.draw = async () => {
  for (const figure of document.querySelectorAll("figure:has(script)")) {
    await new Promise((next) => setTimeout(next));
    const spec = await rsm.numbers(figure);
    figure.classList.add("drawn");
    const before = rsm.changes;
    try {
      const redraw = await (spec.kind === "explorer" ? rsm.explorer : rsm.plot)(figure, spec);
      rsm.figures.set(figure, redraw);
      // The state of a switch or the theme may have changed while it was drawn.
      if (rsm.changes !== before) redraw();
    } catch (error) {
      figure.classList.remove("drawn");
      console.error("a plot could not be drawn", error);
    }
  }
};

rsm.start = async () => {
  const kept = rsm.kept();
  if (kept === "dark" || kept === "light") document.documentElement.dataset.theme = kept;
  rsm.contents();
  rsm.switches();
  rsm.named();
  document.querySelector(".theme").addEventListener("click", () => {
    const name = rsm.isDark() ? "light" : "dark";
    rsm.kept(name);
    rsm.theme(name);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", rsm.named);
  try {
    if (await rsm.library()) await rsm.draw();
  } catch (error) {
    // Without the library the still pictures stay.
    console.error("the plots cannot be made live", error);
  }
  document.documentElement.dataset.ready = "true";
};
