// Put into a copy of a page before its own scripts: notes every fault, then uses every control as a reader would, and
// leaves what it saw in place of the page.
"use strict";
const told = { faults: [], figures: 0, clicks: 0, sliders: 0, hovered: 0, zoomed: 0, spaces: 0, turned: 0, dragged: 0, values: [], switched: 0, groups: [] };
addEventListener("error", (event) => told.faults.push("error: " + event.message));
addEventListener("unhandledrejection", (event) => told.faults.push("rejection: " + event.reason));
addEventListener("securitypolicyviolation", (event) => told.faults.push("not allowed: " + event.violatedDirective + " " + event.blockedURI));
const logged = console.error;
console.error = (...words) => { told.faults.push("console: " + words.join(" ")); logged(...words); };
const check = (holds, words) => { if (!holds) told.faults.push(words); };
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const until = async (holds, words) => {
  for (let k = 0; k < 400; k += 1) {
    if (holds()) return true;
    await pause(25);
  }
  told.faults.push("waited in vain: " + words);
  return false;
};
const mouse = (target, kind, x, y, buttons) => target.dispatchEvent(new MouseEvent(kind, {
  bubbles: true, cancelable: true, view: window, clientX: x, clientY: y, buttons, button: 0,
}));
const click = async (element) => { element.click(); told.clicks += 1; await pause(30); };

// A plot over two axes: the value under the pointer, then a stretch of it.
const flat = async (plot) => {
  const trace = plot._fullData.findIndex((one) => one.hoverinfo !== "skip" && one.x.length > 1);
  if (trace < 0) return;
  const { x, y } = plot._fullData[trace];
  const { xaxis, yaxis } = plot._fullLayout;
  const k = Math.floor(x.length / 2);
  plot.scrollIntoView({ block: "center" });
  await pause(50);
  const drag = plot.querySelector(".nsewdrag");
  const box = drag.getBoundingClientRect();
  const place = [box.left + xaxis.d2p(x[k]), box.top + yaxis.d2p(y[k])];
  mouse(drag, "mousemove", ...place, 0);
  if (await until(() => plot.querySelector(".hoverlayer .hovertext, .hoverlayer .legend"), "no value under the pointer of " + plot._fullLayout.title.text)) told.hovered += 1;
  const before = String(plot._fullLayout.xaxis.range);
  const along = (share) => [box.left + share * box.width, box.top + share * box.height];
  mouse(drag, "mousedown", ...along(0.3), 1);
  mouse(document, "mousemove", ...along(0.5), 1);
  mouse(document, "mousemove", ...along(0.7), 1);
  mouse(document, "mouseup", ...along(0.7), 0);
  if (await until(() => String(plot._fullLayout.xaxis.range) !== before, "a drag did not zoom " + plot._fullLayout.title.text)) told.zoomed += 1;
};

const explorer = async (figure) => {
  const spec = await rsm.numbers(figure);
  const value = rsm.evaluator(spec.tape);
  told.values = [0.1, 0.35, 0.8].map((share) => {
    const point = spec.inputs.map(({ range }, k) => range[0] + (range[1] - range[0]) * (share + 0.07 * k));
    return { point, value: value(point) };
  });
  const space = figure.querySelector(".space");
  check(!space || space._fullData[1].x.length > 0, "no rows on the surface");
  const reading = figure.querySelector(".value");
  for (const slider of figure.querySelectorAll("input[type=range]")) {
    const before = reading.textContent;
    slider.value = "31";
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    await until(() => reading.textContent !== before, "a slider did not change the value");
    told.sliders += 1;
  }
  if (space) {
    const kinds = space._fullData.map((trace) => trace.type);
    check(kinds[0] === "surface" && kinds[1] === "scatter3d", "no surface with its rows: " + kinds);
    told.spaces += 1;
    // A drag turns it.
    const eye = () => JSON.stringify(space._fullLayout.scene._scene.getCamera().eye);
    const before = eye();
    const canvas = space.querySelector("canvas");
    // Where the sliders' last drawing may not have ended, a drag is lost: then once more.
    for (let turn = 0; turn < 10 && eye() === before; turn += 1) for (const [kind, share, buttons] of [["mousemove", 0.4, 0], ["mousedown", 0.4, 1], ["mousemove", 0.5, 1], ["mousemove", 0.6, 1], ["mouseup", 0.6, 0]]) {
      const box = canvas.getBoundingClientRect();
      mouse(canvas, kind, box.left + share * box.width, box.top + 0.5 * box.height, buttons);
      await pause(60);
    }
    if (await until(() => eye() !== before, "a drag did not turn the surface")) told.dragged += 1;
    const up = () => (space.layout.scene.camera?.up ?? { y: 0 }).y;
    const side = up();
    await click([...figure.querySelectorAll("button")].find((button) => button.textContent === "From above"));
    if (await until(() => up() !== side, "the surface did not turn")) told.turned += 1;
    for (const select of figure.querySelectorAll("select")) {
      select.value = String(spec.inputs.length - 1);
      select.dispatchEvent(new Event("change", { bubbles: true }));
      await pause(30);
    }
  }
  for (const button of figure.querySelectorAll("button")) await click(button);
};

addEventListener("load", async () => {
  try {
    await until(() => document.documentElement.dataset.ready === "true", "the page did not get ready");
    check(document.querySelectorAll(".top nav a").length === document.querySelectorAll("main h2").length, "the contents lack a part");
    for (const figure of document.querySelectorAll("figure")) {
      figure.scrollIntoView();
      if (!await until(() => rsm.figures.has(figure), "a figure was not drawn")) continue;
      told.figures += 1;
      if (figure.querySelector(".explorer")) await explorer(figure);
      else if (figure.querySelector(".js-plotly-plot")._fullLayout.xaxis) await flat(figure.querySelector(".js-plotly-plot"));
      check(figure.scrollWidth <= figure.clientWidth + 1, "a figure is wider than its place");
    }
    for (const group of document.querySelectorAll(".switch")) {
      const figures = [...document.querySelectorAll("figure")].filter((figure) => figure.dataset.group === group.dataset.group);
      check(figures.length > 0, "a switch switches nothing");
      const traces = (figure) => figure.querySelector(".js-plotly-plot")._fullData;
      const shown = () => figures.map((figure) => traces(figure).map((trace) => trace.name + trace.y.slice(0, 50)).join()).join();
      const buttons = [...group.querySelectorAll("button")];
      const isIn = (button) => button.getAttribute("aria-pressed") === "true";
      check(buttons.length > 0 && buttons.every(isIn), "a cause is out before a click");
      const states = {};
      // From one set of causes to the next by one click each (the code of Gray), through all of them and back to all.
      for (let step = 0; step <= 2 ** buttons.length; step += 1) {
        const state = buttons.reduce((set, button, k) => set + (isIn(button) ? 2 ** k : 0), 0);
        states[state] = {
          told: group.querySelector(".told").textContent,
          shown: traces(figures[0]).map((trace) => ({ name: trace.name, y: [...trace.y] })),
        };
        const before = shown();
        const gray = (n) => n ^ (n >> 1);
        const change = gray(step) ^ gray((step + 1) % 2 ** buttons.length);
        if (step === 2 ** buttons.length) break;
        const button = buttons[Math.log2(change)];
        const pressed = isIn(button);
        await click(button);
        check(isIn(button) !== pressed, "a click neither took a cause out nor put it back");
        await until(() => shown() !== before, "a click switched nothing: " + button.textContent);
        told.switched += 1;
      }
      told.groups.push({ name: group.dataset.group, causes: buttons.map((button) => button.textContent), states });
    }
    const paper = () => getComputedStyle(document.body).backgroundColor;
    for (let k = 0; k < 2; k += 1) {
      const before = paper();
      await click(document.querySelector(".theme"));
      check(paper() !== before, "the theme did not change");
    }
    check(document.documentElement.scrollWidth <= innerWidth + 1, "the page is wider than its window: " + document.documentElement.scrollWidth + " over " + innerWidth);
    await pause(200);
  } catch (error) {
    told.faults.push("the clicks stopped: " + error.stack);
  }
  const pre = document.createElement("pre");
  pre.id = "told";
  pre.textContent = JSON.stringify(told);
  document.body.replaceChildren(pre);
});
