// A fitted surface to look into: turned in space, and cut along every input at a point that sliders move.
// The values are those of the evaluator: the page runs the operations of its tape, in its order and its precision.
"use strict";

// A tape as a function of its arguments.
rsm.evaluator = (tape) => (point) => {
  const at = new Array(tape.ops.length);
  const lift = tape.single ? 12582912 : 6755399441055744;
  const kept = tape.single ? Math.fround : (value) => value;
  tape.ops.forEach(([name, a, b, c], k) => {
    switch (name) {
      case "constant": at[k] = a; break;
      case "input": at[k] = kept(point[a]); break;
      case "negate": at[k] = -at[a]; break;
      // (a + 1.5 2^52) - 1.5 2^52, in single precision with 2^23.
      case "nearest": at[k] = kept(kept(at[a] + lift) - lift); break;
      // NaN only with a NaN argument: then the result is NaN, whatever is read.
      case "load": at[k] = tape.tables[a][(at[b] || 0) + c]; break;
      case "absolute": at[k] = Math.abs(at[a]); break;
      case "add": at[k] = kept(at[a] + at[b]); break;
      case "subtract": at[k] = kept(at[a] - at[b]); break;
      case "multiply": at[k] = kept(at[a] * at[b]); break;
      case "divide": at[k] = kept(at[a] / at[b]); break;
      case "less": at[k] = at[a] < at[b]; break;
      case "select": at[k] = at[a] ? at[b] : at[c]; break;
      default: throw new Error("an operation without a meaning: " + name);
    }
  });
  return at[tape.output];
};

rsm.made = (parent, name, words, kind) => {
  const element = document.createElement(name);
  if (words !== undefined) element.textContent = words;
  if (kind) element.className = kind;
  parent.append(element);
  return element;
};

rsm.along = ([low, high], count) => Array.from({ length: count }, (_, k) => low + ((high - low) * k) / (count - 1));

// Digits after the point so that a step of 1/200 of the range is seen.
rsm.decimals = ([low, high]) => Math.min(9, Math.max(0, Math.ceil(-Math.log10((high - low) / 200))));

rsm.explorer = async (figure, spec) => {
  const value = rsm.evaluator(spec.tape);
  const supported = spec.support ? rsm.evaluator(spec.support) : () => 1;
  const inputs = spec.inputs;
  const point = inputs.map(({ range }) => 0.5 * (range[0] + range[1]));
  const box = figure.querySelector(".explorer");
  box.replaceChildren();
  const inSpace = inputs.length > 1 && rsm.space();
  let axes = [0, 1];
  const title = (k) => inputs[k].title;
  const shown = (at) => (supported(at) === 1 ? value(at) : null);
  const written = (number) => number.toFixed(spec.decimals) + (spec.unit ? " " + spec.unit : "");

  // Where the point is, and the value there.
  const left = rsm.made(box, "div");
  const controls = rsm.made(box, "div", undefined, "controls");
  const reading = rsm.made(controls, "div", undefined, "value");
  const note = rsm.made(controls, "div", undefined, "note");
  const sliders = inputs.map(({ range, name, unit }, k) => {
    const label = rsm.made(controls, "label");
    rsm.made(label, "span", name);
    const told = rsm.made(label, "output");
    const slider = rsm.made(label, "input");
    Object.assign(slider, { type: "range", min: 0, max: 200, value: 100 });
    const tell = () => { told.textContent = point[k].toFixed(rsm.decimals(range)) + (unit ? " " + unit : ""); };
    slider.addEventListener("input", () => {
      point[k] = range[0] + ((range[1] - range[0]) * Number(slider.value)) / 200;
      tell();
      later(k);
    });
    tell();
    return slider;
  });
  let space = null;
  let all = null;
  let near = true;
  if (inSpace) {
    space = rsm.made(left, "div", undefined, "live space");
    const row = rsm.made(left, "div", undefined, "row");
    const view = (words, eye, up) => rsm.made(row, "button", words).addEventListener("click", () =>
      Plotly.relayout(space, { "scene.camera": { eye, up, center: { x: 0, y: 0, z: 0 } } }));
    view("From the side", { x: -1.35, y: -1.5, z: 0.85 }, { x: 0, y: 0, z: 1 });
    view("From above", { x: 0, y: 0, z: 2.1 }, { x: 0, y: 1, z: 0 });
    if (inputs.length > 2) {
      const selects = axes.map((chosen, k) => {
        const select = rsm.made(row, "select");
        select.setAttribute("aria-label", k === 0 ? "first axis" : "second axis");
        inputs.forEach(({ name }, j) => { rsm.made(select, "option", name).value = j; });
        select.value = chosen;
        return select;
      });
      selects.forEach((select, k) => select.addEventListener("change", () => {
        const wanted = Number(select.value);
        // The axis that the other one has is exchanged.
        if (axes[1 - k] === wanted) axes[1 - k] = axes[k];
        axes[k] = wanted;
        selects.forEach((one, j) => { one.value = axes[j]; });
        redraw();
      }));
      all = rsm.made(row, "button", "All rows");
      all.addEventListener("click", () => {
        near = !near;
        all.setAttribute("aria-pressed", String(!near));
        redraw();
      });
    }
  }
  const slices = rsm.made(inSpace ? controls : left, "div", undefined, "slices plots one");
  const cuts = inputs.map(() => rsm.made(slices, "div", undefined, "live"));
  if (inputs.length === 1) slices.classList.add("single");

  // Rows whose other inputs lie within a tenth of their range of the point.
  const isNear = (row, free) => inputs.every(({ range }, k) =>
    free.includes(k) || Math.abs(row[k] - point[k]) <= 0.1 * (range[1] - range[0]));
  const rowsOf = (set, free) => set.rows.filter((row) => (!near && free.length > 1) || isNear(row, free));
  // Where many inputs leave no row near the middle, all are shown at first.
  near = inputs.length < 3 || spec.sets.some((set) => set.rows.some((row) => isNear(row, axes)));
  const spacePlot = () => {
    const [a, b] = axes;
    const [x, y] = axes.map((k) => rsm.along(inputs[k].range, 49));
    const at = [...point];
    const z = y.map((second) => x.map((first) => { at[a] = first; at[b] = second; return shown(at); }));
    const traces = [{
      type: "surface", x, y, z, colorscale: rsm.scale, showscale: innerWidth > 500, colorbar: { thickness: 12, len: 0.75 },
      contours: { z: { show: true, color: "rgba(0,0,0,0.35)" } }, opacity: 0.93, hovertemplate: "%{x}<br>%{y}<br>%{z}<extra></extra>",
    }];
    for (const set of spec.sets) {
      const rows = rowsOf(set, axes);
      const column = (k) => rows.map((row) => row[k]);
      traces.push(rsm.points({ ...set, x: column(a), y: column(b) }, column(inputs.length)));
    }
    return [traces, rsm.layout(spec.name, {
      scene: rsm.scene(title(a), title(b), spec.title), margin: { l: 0, r: 0, t: 30, b: 0 }, legend: { orientation: "h", x: 0, y: 0 },
    }), rsm.config3d];
  };
  const wider = ([low, high]) => [low - 0.02 * (high - low), high + 0.02 * (high - low)];
  const cutPlot = (k) => {
    const x = rsm.along(inputs[k].range, 121);
    const at = [...point];
    const y = x.map((one) => { at[k] = one; return shown(at); });
    const here = shown(point);
    const traces = [{ ...rsm.series({ name: "surface", colour: "blue", mark: "line", x, y }), hoverinfo: "all", hovertemplate: "%{x}<br>%{y}<extra></extra>" }];
    for (const set of spec.sets) {
      const rows = rowsOf(set, [k]);
      traces.push(rsm.series({ ...set, x: rows.map((row) => row[k]), y: rows.map((row) => row[inputs.length]) }));
    }
    traces.push({ ...rsm.series({ name: "", colour: "black", mark: "circle", x: [point[k]], y: [here] }), hoverinfo: "skip" });
    const margin = inputs.length === 1 ? {} : { margin: { l: 44, r: 14, t: 8, b: 36 } };
    return [traces, rsm.layout("", {
      ...margin, showlegend: inputs.length === 1, xaxis: rsm.axis(title(k), { range: wider(inputs[k].range) }), yaxis: rsm.axis(spec.title, { range: spec.span }),
    }), inputs.length === 1 ? rsm.config : { ...rsm.config, displayModeBar: false }];
  };
  const read = () => {
    const here = shown(point);
    reading.textContent = spec.name + " = " + (here === null ? "not supported by the data" : written(here));
    note.textContent = spec.known;
  };
  const draw = (how, inSight) => Promise.all([
    ...(inSight && space ? [how(space, ...spacePlot())] : []),
    ...cuts.map((cut, k) => how(cut, ...cutPlot(k))),
  ]);
  all?.setAttribute("aria-pressed", String(!near));
  const redraw = () => { read(); return draw(Plotly.react, true); };
  // Sliders move faster than plots: one drawing for all moves of 20 ms.
  let waiting = false;
  let turned = false;
  const later = (k) => {
    // Along its own axes the surface stays what it is.
    turned ||= !axes.includes(k);
    if (waiting) return;
    waiting = true;
    setTimeout(() => {
      read();
      draw(Plotly.react, turned);
      waiting = turned = false;
    }, 20);
  };
  read();
  await draw(Plotly.newPlot, true);
  return redraw;
};
rsm.start();
