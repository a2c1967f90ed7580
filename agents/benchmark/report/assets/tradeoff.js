// Policies as points: error against what it costs.

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

/** Points of policies: `measure` upwards, a cost to the right, with a line where it has a limit. */
function showTradeOff(id, all, measure, { key, scale, title, line }) {
  const chart = byId(id);
  const policies = all.filter((row) => row.kind !== "bound" && row[measure.key] !== null);
  policies.sort((a, b) => (a.kind === "learned") - (b.kind === "learned")); // drawn last, on top
  const positive = policies.map((row) => scale * row[key]).filter((x) => x > 0);
  const least = positive.length ? Math.min(...positive, line ?? Infinity) : 1;
  const zero = 10 ** (Math.floor(Math.log10(least)) - 0.5);
  const points = policies.map((row) => ({
    row,
    x: row[key] > 0 ? scale * row[key] : zero,
    y: 100 * row[measure.key],
  }));
  const [right, low, high] = [
    Math.max(...positive, line ?? 0, zero * 10) * 1.8,
    Math.min(...points.map((p) => p.y)) / 1.25,
    Math.max(...points.map((p) => p.y)) * 1.25,
  ];
  const interval = (p, end) => Math.abs(100 * (p.row[`${measure.interval}_${end}`] ?? p.row[measure.key]) - p.y);
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
        `<b>${p.row.policy}</b><br>${measure.label} %{y:.3g} %<br>${title} ${digits3(scale * p.row[key])}<extra></extra>`,
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
    yaxis: { title: { text: `${measure.label}, %` }, type: "log", range: [Math.log10(low), Math.log10(high)], ...decades(low, high) },
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
