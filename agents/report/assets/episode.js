// One episode in figures: what the filter believed about the inertia, the body rates, the wheels.

const AXES = ["x", "y", "z"];
const AXIS_COLOURS = ["vermillion", "green", "blue"];
const AXIS_DASHES = ["solid", "dash", "dot"];
const WHEEL_COLOURS = ["vermillion", "green", "blue", "purple", "orange", "sky"];
const episode = data.episode;

const lineOf = (i, width = 1.8) => ({ color: colour(AXIS_COLOURS[i]), width });

/** Band between two series. */
function band(time, low, high, name, others = {}) {
  return {
    x: [...time, ...time.toReversed()],
    y: [...low, ...high.toReversed()],
    fill: "toself",
    fillcolor: translucent(name, Number(colour("band")) * 1.6),
    line: { width: 0 },
    mode: "lines",
    hoverinfo: "skip",
    ...others,
  };
}

/** Three panels above each other, one for each body axis, with a common time axis. */
function stacked(traces, range, unit) {
  const figure = layout({ height: 400, hovermode: "x unified", xaxis: { ...timeAxis(), anchor: "y3" } });
  AXES.forEach((axis, i) => {
    const domain = [(2 - i) / 3 + 0.02, (3 - i) / 3 - 0.02];
    figure[`yaxis${i ? i + 1 : ""}`] = {
      ...figure.yaxis, domain, range, title: { text: axis, standoff: 4, font: { color: colour(AXIS_COLOURS[i]) } },
      nticks: 4, zeroline: true,
    };
  });
  return [traces.map((trace) => ({ hovertemplate: `%{y:.3g} ${unit}`, ...trace })), figure];
}

const timeAxis = () => ({ title: { text: "time, s" }, range: [0, episode.horizon], hoverformat: ".1f" });
const ofAxis = (i) => ({ xaxis: "x", yaxis: i ? `y${i + 1}` : "y" });

function momentsFigure(flight, range) {
  const traces = AXES.flatMap((axis, i) => {
    const [estimate, sigma] = [flight.estimate[i], flight.sigma[i]];
    const at = (sign) => estimate.map((value, k) => value + sign * 3 * sigma[k]);
    return [
      band(flight.time, at(-1), at(1), AXIS_COLOURS[i]),
      { x: flight.time, y: estimate, name: `${axis}, estimate`, line: lineOf(i), mode: "lines" },
      { x: flight.time, y: flight.inertia[i], name: `${axis}, truth`, line: { color: colour("ink"), dash: "dash", width: 1.4 }, mode: "lines" },
    ];
  });
  const names = AXES.map((axis, i) => ({
    x: episode.horizon, y: flight.inertia[i].at(-1), text: axis, showarrow: false, xanchor: "right", yanchor: "bottom", yshift: 4,
    font: { color: colour(AXIS_COLOURS[i]), size: 14 },
  }));
  const yaxis = { title: { text: "moment, kg m\u00b2" }, range };
  const figure = layout({ height: 330, hovermode: "x unified", xaxis: timeAxis(), yaxis, annotations: names });
  return [traces.map((trace) => ({ hovertemplate: "%{y:.4g} kg m\u00b2", ...trace })), figure];
}

function deviationFigure(flight, most) {
  const traces = AXES.flatMap((axis, i) => {
    const of = (value) => flight.inertia[i].map((truth, k) => (100 * value(k)) / truth);
    const sigma = of((k) => 3 * flight.sigma[i][k]);
    return [
      band(flight.time, sigma.map((s) => -s), sigma, AXIS_COLOURS[i], ofAxis(i)),
      {
        x: flight.time, y: of((k) => flight.estimate[i][k] - flight.inertia[i][k]), name: axis,
        line: lineOf(i, 1.5), mode: "lines", ...ofAxis(i),
      },
    ];
  });
  return stacked(traces, [-most, most], "%");
}

function ratesFigure(flight) {
  const limit = 1e3 * episode.rate_limit;
  const traces = AXES.flatMap((axis, i) => [
    ...[-limit, limit].map((y) => ({
      x: [0, episode.horizon], y: [y, y], line: { color: colour("ink"), dash: "dash", width: 1.2 }, mode: "lines",
      hoverinfo: "skip", ...ofAxis(i),
    })),
    { x: flight.time, y: flight.rate[i].map((r) => 1e3 * r), name: axis, line: lineOf(i, 1.3), mode: "lines", ...ofAxis(i) },
  ]);
  const most = Math.max(limit, ...episode.flights.flatMap((f) => f.rate.flat().map((r) => 1e3 * Math.abs(r))));
  return stacked(traces, [-1.12 * most, 1.12 * most], "mrad/s");
}

function wheelsFigure(flight) {
  const limits = [...new Set(episode.wheel_speed_limit)].flatMap((limit) => [-limit, limit]);
  const most = Math.max(...limits);
  const traces = [
    ...limits.map((y) => ({
      x: [0, episode.horizon], y: [y, y], line: { color: colour("ink"), dash: "dash", width: 1.2 }, mode: "lines", hoverinfo: "skip",
    })),
    ...flight.wheel_speed.map((speed, k) => ({
      x: flight.time, y: speed, name: `wheel ${k + 1}`, mode: "lines",
      line: { color: colour(WHEEL_COLOURS[k % WHEEL_COLOURS.length]), width: 1.6, dash: AXIS_DASHES[k % 3] },
      hovertemplate: "%{y:.0f} rad/s",
    })),
  ];
  const yaxis = { title: { text: "speed, rad/s" }, range: [-1.12 * most, 1.12 * most] };
  const figure = layout({ height: 300, hovermode: "x unified", xaxis: timeAxis(), yaxis });
  const names = flight.wheel_speed.map(
    (_, k) => `<span style="color:${colour(WHEEL_COLOURS[k % WHEEL_COLOURS.length])}">wheel ${k + 1}</span>`,
  );
  figure.annotations = [
    { x: 0.01, y: 0.93, xref: "paper", yref: "paper", text: names.join("   "), showarrow: false, xanchor: "left", yanchor: "top" },
  ];
  return [traces, figure];
}

function showEpisode() {
  const low = Math.min(...episode.flights.flatMap((f) => f.inertia.flat()));
  const high = Math.max(...episode.flights.flatMap((f) => f.inertia.flat()));
  const range = [low - 0.25 * (high - low), high + 0.15 * (high - low)];
  const late = (f) => f.time.findIndex((t) => t >= Math.min(30, episode.horizon / 3));
  const spread = episode.flights.flatMap((f) =>
    AXES.flatMap((_, i) => f.sigma[i].slice(late(f)).map((s, k) => (300 * s) / f.inertia[i][k + late(f)])),
  );
  const most = 1.15 * Math.max(...spread);
  const kinds = [
    ["Moments of inertia", "dashed: truth; lines: estimate; bands: three standard deviations, as the filter believes", (f) => momentsFigure(f, range)],
    ["Estimate less truth, % of the moment", "bands: three standard deviations; an honest filter stays inside nearly always, but for a moment after a step of the inertia", (f) => deviationFigure(f, most)],
    ["Body rates, mrad/s", "dashed: limits", ratesFigure],
    ["Wheels' speeds", "dashed: limits", wheelsFigure],
  ];
  const holder = byId("episode-charts");
  holder.querySelectorAll(".chart").forEach((chart) => Plotly.purge(chart));
  holder.replaceChildren();
  for (const [title, note, figureOf] of kinds) {
    const charts = episode.flights.map((flight) => {
      const chart = make("div", { class: "chart" });
      return { flight, chart, block: make("div", {}, make("p", { class: "note" }, swatch(flight.policy), ` ${flight.policy}`), chart) };
    });
    const single = charts.length === 1 ? " single" : "";
    holder.append(
      make("h3", {}, title),
      make("p", { class: "note" }, `${note}.`),
      make("div", { class: `pair${single}` }, ...charts.map(({ block }) => block)),
    );
    for (const { flight, chart } of charts) Plotly.newPlot(chart, ...figureOf(flight), config);
  }
}

function describeEpisode() {
  const pilots = episode.flights.map((f) => `${f.policy} (${KINDS[f.kind]})`).join(" beside ");
  const why =
    episode.flights.length === 2 && episode.flights[0].kind === "scripted"
      ? `${episode.flights[0].policy} has the lowest mean final error in this cell among the paper's scripted profiles. `
      : "";
  byId("episode-note").textContent =
    `${episode.satellite}, inertia mode ${episode.inertia_mode}, seed ${episode.seed}: ${pilots}. ${why}` +
    "World and noise are the same for all. Drag the picture, or use the arrow keys on it, to look from elsewhere; the " +
    "space bar plays and pauses.";
}
