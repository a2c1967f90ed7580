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

/** Where each label goes, as offsets in pixels: the first place that is free, not `reserved`, or null where none is. */
function placeLabels(points, reserved) {
  const places = [[0, -1], [0, 1], [1, 0], [-1, 0], [1, -1], [-1, -1], [1, 1], [-1, 1]];
  const taken = [...reserved, ...points.map(({ x, y }) => ({ left: x - 6, right: x + 6, top: y - 6, bottom: y + 6 }))];
  return points.map(({ x, y, text, width, height }) => {
    const w = 6.7 * text.length + 4;
    for (const reach of [1, 1.9]) {
      for (const [dx, dy] of places) {
        const cx = x + dx * (w / 2 + 9) * (dy ? 0.75 : 1) * (reach > 1 ? 1.15 : 1);
        const cy = y + dy * 16 * reach;
        const box = { left: cx - w / 2, right: cx + w / 2, top: cy - 8, bottom: cy + 8 };
        const free = taken.every((b) => b.right < box.left || b.left > box.right || b.bottom < box.top || b.top > box.bottom);
        if (free && box.left > 0 && box.right < width && box.top > 0 && box.bottom < height) {
          taken.push(box);
          return [cx - x, cy - y];
        }
      }
    }
    return null;
  });
}

/** The policies that no other one beats in both coordinates, from left to right. */
function front(points) {
  let least = Infinity;
  const sortedPoints = points.toSorted((a, b) => a.x - b.x || a.y - b.y);
  return sortedPoints.filter((p) => p.y < least && ((least = p.y), true));
}

function showTradeOff(id, key, scale, title, line) {
  const chart = byId(id);
  const policies = rows().filter((row) => row.kind !== "bound");
  policies.sort((a, b) => (a.kind === "learned") - (b.kind === "learned")); // drawn last, on top
  const positive = policies.map((row) => scale * row[key]).filter((x) => x > 0);
  const least = positive.length ? Math.min(...positive, line ?? Infinity) : 1;
  const zero = 10 ** (Math.floor(Math.log10(least)) - 0.5);
  const points = policies.map((row) => ({
    row,
    x: row[key] > 0 ? scale * row[key] : zero,
    y: 100 * row.final_error_mean,
  }));
  const [right, low, high] = [
    Math.max(...positive, line ?? 0, zero * 10) * 1.8,
    Math.min(...points.map((p) => p.y)) / 1.25,
    Math.max(...points.map((p) => p.y)) * 1.25,
  ];
  const interval = (p, end) => Math.abs(100 * (p.row[`final_error_${end}`] ?? p.row.final_error_mean) - p.y);
  const best = front(points);
  const traces = [
    {
      x: best.map((p) => p.x),
      y: best.map((p) => p.y),
      mode: "lines",
      line: { color: colour("faint"), dash: "dot", width: 1.5, shape: "hv" },
      hoverinfo: "skip",
    },
    ...points.map((p) => ({
      x: [p.x],
      y: [p.y],
      mode: "markers",
      marker: {
        symbol: looks[p.row.policy].symbol,
        size: looks[p.row.policy].size,
        color: colour(looks[p.row.policy].colour),
        line: { width: 1, color: colour("paper") },
      },
      error_y: {
        type: "data",
        array: [interval(p, "hi")],
        arrayminus: [interval(p, "lo")],
        width: 0,
        thickness: 1.2,
        color: colour(looks[p.row.policy].colour),
      },
      hovertemplate:
        `<b>${p.row.policy}</b><br>final error %{y:.3g} %<br>${title} ${digits3(scale * p.row[key])}<extra></extra>`,
    })),
  ];
  const powers = decades(least / 1.01, right, [1]);
  const ticks = powers.tickvals.length > 2 ? powers : decades(least / 1.01, right);
  const steps = Math.ceil(ticks.tickvals.length / 6);
  const kept = ticks.tickvals.filter((_, i) => (ticks.tickvals.length - 1 - i) % steps === 0);
  const hasZero = points.some((p) => p.row[key] === 0);
  const left = hasZero ? zero / 2.2 : least / 1.8;
  const shapes = line
    ? [{ type: "line", x0: line, x1: line, yref: "paper", y0: 0, y1: 1, line: { color: colour("vermillion"), dash: "dash", width: 1.5 } }]
    : [];
  const figure = layout({
    height: 430,
    shapes,
    xaxis: {
      title: { text: title },
      type: "log",
      range: [Math.log10(left), Math.log10(right)],
      tickmode: "array",
      tickvals: hasZero ? [zero, ...kept] : kept,
      ticktext: hasZero ? ["0", ...kept.map(shortNumber)] : kept.map(shortNumber),
    },
    yaxis: { title: { text: "final error, %" }, type: "log", range: [Math.log10(low), Math.log10(high)], ...decades(low, high) },
  });
  const width = chart.clientWidth - figure.margin.l - figure.margin.r;
  const height = figure.height - figure.margin.t - figure.margin.b;
  const place = (value, from, to, span) => (span * Math.log(value / from)) / Math.log(to / from);
  const rank = (p) => (p.row.kind === "learned" ? 2 : 0) + best.includes(p);
  const ranked = points.toSorted((a, b) => rank(b) - rank(a)); // who matters most is labelled first
  const spots = ranked.map((p) => ({
    x: place(p.x, left, right, width),
    y: height - place(p.y, low, high, height),
    text: p.row.policy,
    width,
    height,
  }));
  const mark = line ? place(line, left, right, width) : 0;
  const offsets = placeLabels(spots, line ? [{ left: mark, right: mark + 60, top: 0, bottom: 20 }] : []);
  figure.annotations = ranked.flatMap((p, i) => (offsets[i] ? [label(p, offsets[i])] : []));
  if (line) {
    figure.annotations.push({
      x: Math.log10(line), y: 1, yref: "paper", text: "1 % line", showarrow: false, xanchor: "left", yanchor: "top",
      font: { size: 12, color: colour("ink") },
    });
  }
  Plotly.react(chart, traces, figure, config);
}

function label(point, [dx, dy]) {
  const far = Math.hypot(dx / 2, dy) > 26;
  return {
    x: Math.log10(point.x), y: Math.log10(point.y), ax: dx, ay: dy, text: point.row.policy, showarrow: true,
    arrowwidth: 0.8, arrowhead: 0, arrowcolor: far ? colour("faint") : "rgba(0,0,0,0)", standoff: 4,
    font: { size: 12, color: colour("ink") }, bgcolor: translucent("paper", 0.75), borderpad: 0,
  };
}

const shortNumber = (value) => (value < 0.01 && /^1e|^0\.0*1$/.test(value) ? `10<sup>${Math.round(Math.log10(value))}</sup>` : String(value));

function showTradeOffs() {
  showTradeOff("effort-chart", "effort", 1, "effort (mean square of command)");
  showTradeOff("outside-chart", "outside_fraction", 100, "time outside, %", 100 * data.most_beyond);
  const shapes = { learned: "\u2605", closed_loop: "\u25c6", scripted: "\u25cf", reference: "\u2716" };
  byId("kinds").replaceChildren(
    ...Object.entries(KINDS).filter(([kind]) => data.policies.some((p) => p.kind === kind))
      .map(([kind, name]) => make("li", {}, make("span", { "aria-hidden": "true" }, shapes[kind]), name)),
  );
}

onChoice(showErrors);
onChoice(showTradeOffs);
