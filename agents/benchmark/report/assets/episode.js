// One episode in figures: what the filter believed about the inertia, the body rates, the wheels.

const AXIS_DASHES = ["solid", "dash", "dot"];

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
function stacked(traces, range, unit, others = {}) {
  const figure = layout({ height: 400, hovermode: "x unified", xaxis: { ...timeAxis(), anchor: "y3" } });
  AXES.forEach((axis, i) => {
    const domain = [(2 - i) / 3 + 0.02, (3 - i) / 3 - 0.02];
    figure[`yaxis${i ? i + 1 : ""}`] = {
      ...figure.yaxis, domain, range, title: { text: axis, standoff: 4, font: { color: colour(AXIS_COLOURS[i]) } },
      nticks: 4, zeroline: true, ...others,
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

/** Estimate less truth of a moment, in the standard deviations that the filter believes. */
const inSigmas = (flight, i) => flight.estimate[i].map((value, k) => (value - flight.inertia[i][k]) / flight.sigma[i][k]);

/** Height at which a number of standard deviations is drawn: linear up to 3, which is 1, logarithmic beyond. */
const symlog = (x) => (Math.abs(x) <= 3 ? x / 3 : Math.sign(x) * (1 + Math.log10(Math.abs(x) / 3)));

function deviationFigure(flight, most) {
  const traces = AXES.flatMap((axis, i) => {
    const sigmas = inSigmas(flight, i);
    return [
      band([0, episode.horizon], [-1, -1], [1, 1], AXIS_COLOURS[i], { ...ofAxis(i), fillcolor: translucent(AXIS_COLOURS[i], colour("band")) }),
      {
        x: flight.time, y: sigmas.map(symlog), customdata: sigmas, hovertemplate: "%{customdata:.2f} \u03c3", name: axis,
        line: lineOf(i, 1.5), mode: "lines", ...ofAxis(i),
      },
    ];
  });
  const powers = Array.from({ length: Math.max(0, Math.floor(most - 1 + 1e-9)) }, (_, k) => 3 * 10 ** (k + 1));
  const ticks = [...powers.map((x) => -x).reverse(), -3, 0, 3, ...powers];
  const range = [-most - 0.2, most + 0.2];
  return stacked(traces, range, "", { tickmode: "array", tickvals: ticks.map(symlog), ticktext: ticks.map(String) });
}

/** In words: the share of the instants at which each moment's error is within three standard deviations. */
function withinThree(flight) {
  const shares = AXES.map((axis, i) => {
    const sigmas = inSigmas(flight, i);
    return `${axis} ${((100 * sigmas.filter((s) => Math.abs(s) <= 3).length) / sigmas.length).toFixed(1)}\u00a0%`;
  });
  return `within three standard deviations: ${shares.join(", ")} of the time`;
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
  const most = Math.max(limit, ...flights().flatMap((f) => f.rate.flat().map((r) => 1e3 * Math.abs(r))));
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
  const margin = { l: 62, r: 18, t: 28, b: 46 };
  const figure = layout({ height: 318, margin, hovermode: "x unified", xaxis: timeAxis(), yaxis });
  const names = flight.wheel_speed.map(
    (_, k) => `<span style="color:${colour(WHEEL_COLOURS[k % WHEEL_COLOURS.length])}">wheel ${k + 1}</span>`,
  );
  figure.annotations = [
    { x: 0, y: 1, xref: "paper", yref: "paper", text: names.join("   "), showarrow: false, xanchor: "left", yanchor: "bottom" },
  ];
  return [traces, figure];
}

function showEpisode() {
  const low = Math.min(...episode.inertia.flat());
  const high = Math.max(...episode.inertia.flat());
  const range = [low - 0.25 * (high - low), high + 0.15 * (high - low)];
  const heights = flights().flatMap((f) => AXES.flatMap((_, i) => inSigmas(f, i).map((s) => Math.abs(symlog(s)))));
  const most = Math.max(1, ...heights);
  const kinds = [
    ["Moments of inertia", "dashed: truth; lines: estimate; bands: three standard deviations, as the filter believes", (f) => momentsFigure(f, range)],
    [
      "Estimate less truth, in the filter's standard deviations",
      "bands: three standard deviations, \u03c3; the scale is linear inside them and logarithmic beyond; a consistent filter stays inside nearly always, but for a moment after a step of the inertia",
      (f) => deviationFigure(f, most),
      withinThree,
    ],
    ["Body rates, mrad/s", "dashed: limits", ratesFigure],
    ["Wheels' speeds", "dashed: limits", wheelsFigure],
  ];
  const holder = byId("episode-charts");
  holder.querySelectorAll(".chart").forEach((chart) => Plotly.purge(chart));
  holder.replaceChildren();
  for (const [title, note, figureOf, say] of kinds) {
    const charts = flights().map((flight) => {
      const chart = make("div", { class: "chart" });
      const words = ` ${flight.policy}${say ? `, ${say(flight)}` : ""}`;
      return { flight, chart, block: make("div", {}, make("p", { class: "note" }, swatch(flight.policy), words), chart) };
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
