// Error against time, and final error against what it costs.

const BOUNDS = data.bounds.length ? ["reference_limit", "bound"] : [];
const bandsShown = { on: true };

function showLegend() {
  const groups = [...Object.keys(KINDS), "bound"].map((kind) => {
    const names = kind === "bound" ? BOUNDS : data.policies.filter((p) => p.kind === kind && !p.stored).map((p) => p.name);
    const labels = names.map((name) => {
      const box = make("input", { type: "checkbox", value: name });
      box.checked = chosen.shown.has(name);
      box.addEventListener("change", () => {
        if (box.checked) chosen.shown.add(name);
        else chosen.shown.delete(name);
        showErrors();
      });
      return make("label", {}, box, swatch(name), name);
    });
    return labels.length ? [make("div", { class: "group" }, make("span", {}, KINDS[kind] ?? "limits"), ...labels)] : [];
  });
  const band = make("input", { type: "checkbox" });
  band.checked = bandsShown.on;
  band.addEventListener("change", () => {
    bandsShown.on = band.checked;
    showErrors();
  });
  const options = make("div", { class: "group" }, make("span", {}, "drawing"), make("label", {}, band, "bands"));
  byId("time-legend").replaceChildren(...groups.flat(), options);
}

/** Lines and bands of one cell, errors in %. */
function errorTraces(satellite, mode) {
  const traces = [];
  const here = (curve) => curve.satellite === satellite && curve.inertia_mode === mode && chosen.shown.has(curve.policy);
  const inPercent = (values) => values.map((value) => 100 * value);
  const line = (name) => ({ color: colour(looks[name].colour), dash: looks[name].dash, width: looks[name].width });
  for (const curve of bandsShown.on ? data.curves.filter(here) : []) {
    traces.push({
      x: [...data.time, ...data.time.toReversed()],
      y: inPercent([...curve.low, ...curve.high.toReversed()]),
      fill: "toself",
      fillcolor: translucent(looks[curve.policy].colour, Number(colour("band"))),
      line: { width: 0 },
      mode: "lines",
      hoverinfo: "skip",
    });
  }
  for (const curve of data.bounds.filter(here)) {
    traces.push({ x: data.time, y: inPercent(curve.error), name: curve.policy, line: line(curve.policy), mode: "lines" });
  }
  for (const curve of data.curves.filter(here)) {
    traces.push({ x: data.time, y: inPercent(curve.median), name: curve.policy, line: line(curve.policy), mode: "lines" });
  }
  return traces.map((trace) => ({ hovertemplate: "%{y:.3g} %", ...trace }));
}

function showErrors() {
  const modes = chosen.mode === "all" ? data.modes : [chosen.mode];
  const panels = modes.map((mode) => errorTraces(chosen.satellite, mode));
  const values = panels.flatMap((traces) => traces.flatMap((trace) => trace.y.filter((y) => y > 0)));
  const low = values.reduce((a, b) => Math.min(a, b), 1);
  const high = values.reduce((a, b) => Math.max(a, b), low * 2);
  const holder = byId("time-panels");
  holder.querySelectorAll(".chart").forEach((chart) => Plotly.purge(chart));
  holder.classList.toggle("many", modes.length > 1);
  holder.replaceChildren();
  modes.forEach((mode, i) => {
    const chart = make("div", { class: "chart" });
    holder.append(make("div", {}, make("h3", {}, `${chosen.satellite}, ${INERTIA[mode] ?? mode}`), chart));
    Plotly.newPlot(
      chart,
      panels[i],
      layout({
        height: modes.length > 1 ? 330 : 460,
        hovermode: "x unified",
        xaxis: { title: { text: "time, s" }, range: [0, data.time.at(-1)], hoverformat: ".0f" },
        yaxis: {
          title: { text: "relative error, %" },
          type: "log",
          range: [Math.log10(low * 0.85), Math.log10(high * 1.15)],
          ...decades(low * 0.85, high * 1.15, high / low > 3000 ? [1] : [1, 2, 5]),
        },
      }),
      config,
    );
  });
}

function showTradeOffs() {
  const measure = { key: "final_error_mean", interval: "final_error", label: "final error" };
  showTradeOff("effort-chart", rows(), measure, { key: "effort", scale: 1, title: "effort (mean square of command)" });
  const outside = { key: "outside_fraction", scale: 100, title: "time outside, %", line: 100 * data.most_beyond };
  showTradeOff("outside-chart", rows(), measure, outside);
  const shapes = { learned: "\u2605", closed_loop: "\u25c6", scripted: "\u25cf", reference: "\u2716" };
  byId("kinds").replaceChildren(
    ...Object.entries(KINDS).filter(([kind]) => data.policies.some((p) => p.kind === kind))
      .map(([kind, name]) => make("li", {}, make("span", { "aria-hidden": "true" }, shapes[kind]), name)),
  );
}

onChoice(showErrors);
onChoice(showTradeOffs);
