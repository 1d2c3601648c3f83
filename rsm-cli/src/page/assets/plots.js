// Plots of series, and surfaces over a plane, drawn by Plotly from the numbers beside each figure.
"use strict";

// Colours stay apart for readers who see fewer of them (Okabe and Ito 2008); on dark paper they are lighter.
rsm.colours = {
  blue: ["#0072b2", "#6cb8ea"], orange: ["#d55e00", "#f08a3c"], pink: ["#c2528b", "#ff9ac8"],
  grey: ["#7d7d7d", "#a9a9a9"], black: ["#000000", "#ffffff"],
};
rsm.colour = (name) => (rsm.colours[name] || rsm.colours.black)[rsm.isDark() ? 1 : 0];
rsm.scale = [[0, "#3a3278"], [0.25, "#306896"], [0.5, "#34988c"], [0.75, "#82c864"], [1, "#f5e65a"]];

// The library reads a little HTML in labels: a label from data is text.
rsm.text = (words) => String(words).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");

rsm.css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
rsm.axis = (title, more) => ({
  title: { text: rsm.text(title), font: { size: 12 }, standoff: 6 }, gridcolor: rsm.css("--line"), zeroline: false,
  linecolor: rsm.css("--line"), color: rsm.css("--ink"), automargin: true, exponentformat: "power", hoverformat: ".5~g", ...more,
});
rsm.layout = (title, more) => ({
  title: { text: rsm.text(title), font: { size: 14 }, x: 0.01, xanchor: "left", y: 0.985, yanchor: "top" },
  paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
  font: { family: "system-ui, sans-serif", size: 12, color: rsm.css("--ink") },
  margin: { l: 50, r: 14, t: 34, b: 70 }, hovermode: "closest", dragmode: "zoom",
  hoverlabel: { bgcolor: rsm.css("--paper"), bordercolor: rsm.css("--line"), font: { color: rsm.css("--ink") } },
  modebar: { bgcolor: "rgba(0,0,0,0)", color: rsm.css("--soft"), activecolor: rsm.css("--accent") },
  showlegend: true, legend: { orientation: "h", x: 0, xanchor: "left", y: 0, yref: "container", yanchor: "bottom" }, uirevision: "same", ...more,
});
rsm.scene = (x, y, z) => {
  const axis = (title) => ({
    title: { text: rsm.text(title), font: { size: 12 } }, color: rsm.css("--ink"), gridcolor: rsm.css("--line"),
    showbackground: false, hoverformat: ".5~g",
  });
  return {
    xaxis: axis(x), yaxis: axis(y), zaxis: axis(z), aspectmode: "manual", aspectratio: { x: 1.15, y: 1.15, z: 0.8 },
    camera: { eye: { x: -1.35, y: -1.5, z: 0.85 } }, dragmode: "turntable", uirevision: "same",
  };
};
rsm.config = {
  responsive: true, displaylogo: false, scrollZoom: false, displayModeBar: innerWidth > 600 ? "hover" : false, showTips: false, plotlyServerURL: "",
  modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d", "toImage"]],
};
rsm.config3d = { ...rsm.config, scrollZoom: true, modeBarButtons: [["tableRotation", "zoom3d", "pan3d", "resetCameraDefault3d", "toImage"]] };

// Many rows of a record are not seen apart: the line then has gaps in none of them, and its points no markers.
rsm.series = (one) => {
  const colour = rsm.colour(one.colour);
  const line = one.mark === "line";
  return {
    type: "scatter", name: rsm.text(one.name), x: one.x, y: one.y, mode: line ? "lines" : "markers",
    showlegend: one.name !== "", hoverinfo: one.name === "" ? "skip" : "all",
    line: { color: colour, width: 1.6, dash: one.dash ? "dash" : "solid" },
    marker: { color: colour, size: line ? 6 : 7, symbol: one.mark === "cross" ? "x-thin" : "circle", line: { color: colour, width: one.mark === "cross" ? 2 : 0 } },
    text: one.labels ? one.labels.map(rsm.text) : undefined,
    hovertemplate: one.name === "" ? undefined : "%{x}<br>%{y}" + (one.labels ? "<br>%{text}" : ""),
  };
};

rsm.plot = async (figure, spec) => {
  const place = figure.querySelector(".live");
  const draw = () => {
    if (spec.kind === "surface") {
      const traces = [{
        type: "surface", x: spec.x.at, y: spec.y.at, z: spec.z, colorscale: rsm.scale, showscale: innerWidth > 500,
        colorbar: { thickness: 12, len: 0.8 }, contours: { z: { show: true, color: "rgba(0,0,0,0.35)" } },
        hovertemplate: "%{x}<br>%{y}<br>%{z}<extra></extra>",
      }];
      for (const one of spec.series) traces.push(rsm.points(one, one.z));
      return [traces, rsm.layout(spec.title, {
        scene: rsm.scene(spec.x.title, spec.y.title, spec.z_title), margin: { l: 0, r: 0, t: 30, b: 0 }, showlegend: spec.series.length > 0, legend: { orientation: "h", x: 0, y: 0 },
      }), rsm.config3d];
    }
    const state = rsm.states.get(figure.dataset.group) ?? 0;
    const shown = spec.series.filter((one) => one.states === undefined || one.states.includes(state));
    const kind = spec.decades ? { type: "log", dtick: 1 } : {};
    return [shown.map(rsm.series), rsm.layout(spec.title, { xaxis: rsm.axis(spec.x, kind), yaxis: rsm.axis(spec.y, kind) }), rsm.config];
  };
  if (spec.kind === "surface") place.classList.add("space");
  if (spec.kind === "surface" && !rsm.space()) {
    figure.classList.remove("drawn");
    return () => {};
  }
  await Plotly.newPlot(place, ...draw());
  return () => Plotly.react(place, ...draw());
};

// Points in space.
rsm.points = (one, z) => ({
  type: "scatter3d", mode: "markers", name: rsm.text(one.name), x: one.x, y: one.y, z,
  marker: { size: 4, color: rsm.colour(one.colour), symbol: one.mark === "cross" ? "x" : "circle", line: { width: 1, color: rsm.css("--paper") } },
  hovertemplate: "%{x}<br>%{y}<br>%{z}",
});

// Browsers draw in few places in space at once; the oldest would go blank.
rsm.mostSpaces = 8;

// Whether there is one more place in space; where there is none, slices and still pictures stay.
rsm.space = () => {
  rsm.can ??= Boolean(document.createElement("canvas").getContext("webgl"));
  if (!rsm.can || rsm.spaces >= rsm.mostSpaces) return false;
  rsm.spaces += 1;
  return true;
};
