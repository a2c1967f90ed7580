// An error of every policy in every cell, by number and colour.

// Cividis (Nunez, Anderton, Renslow 2018) at nine even places: lightness alone tells the order.
const CIVIDIS = ["#00224e", "#1a386f", "#434e6c", "#61656f", "#7d7c78", "#9b9476", "#bcae6c", "#dec958", "#fee838"];

/** Colour at a place from 0 to 1, and the one of black and white that can be read on it. */
function cividis(place) {
  const at = Math.min(Math.max(place, 0), 1) * (CIVIDIS.length - 1);
  const i = Math.min(Math.floor(at), CIVIDIS.length - 2);
  const channel = (hex, k) => parseInt(hex.slice(1 + 2 * k, 3 + 2 * k), 16);
  const rgb = [0, 1, 2].map((k) => channel(CIVIDIS[i], k) + (at - i) * (channel(CIVIDIS[i + 1], k) - channel(CIVIDIS[i], k)));
  const linear = rgb.map((c) => (c / 255 <= 0.03928 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
  const light = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]; // relative luminance, WCAG 2
  return { back: `rgb(${rgb.map(Math.round).join(",")})`, text: light > 0.179 ? "#000" : "#fff" };
}

/** The table: rows are policies, the best first; `find(name, cell)` is what a policy reached in a cell, or nothing. */
function drawHeatmap({ names, limits, satellites, modes, find, measure }) {
  const cells = satellites.flatMap((satellite) => modes.map((mode) => ({ satellite, mode })));
  const valueOf = (name, cell) => find(name, cell)?.[measure] ?? null;
  const known = (name) => cells.map((cell) => valueOf(name, cell)).filter((value) => value !== null);
  const errors = names.flatMap(known);
  const [low, high] = [Math.min(...errors), Math.max(...errors)];
  const place = (error) => (high > low ? Math.log(error / low) / Math.log(high / low) : 0);
  const total = (name) => known(name).reduce((sum, value) => sum + Math.log(value), 0) / (known(name).length || NaN);
  const ranked = names.toSorted((a, b) => (total(a) || Infinity) - (total(b) || Infinity) || 0);
  const body = [...ranked, ...limits].map((name) => {
    const values = cells.map((cell) => {
      const row = find(name, cell);
      const value = row ? row[measure] : null;
      if (value === null || value === undefined) return make("td", {}, row ? "ended" : "-"); // no value, or not flown
      if (row.kind === "bound") return make("td", {}, percent(value));
      const { back, text } = cividis(place(value));
      const weight = row.best ? "font-weight:700;text-decoration:underline" : "";
      return make("td", { style: `background:${back};color:${text};${weight}` }, percent(value) + (row.inside ? "" : "*"));
    });
    return make("tr", { class: limits.includes(name) ? "bound" : null }, make("th", { scope: "row", class: "text" }, name), ...values);
  });
  const groups = satellites.map((s) => make("th", { colspan: modes.length, scope: "colgroup" }, s));
  const heads = cells.map((cell) => make("th", { scope: "col" }, cell.mode));
  const corner = make("th", { rowspan: 2, scope: "col", class: "text" }, "policy");
  byId("heatmap").tHead.replaceChildren(make("tr", {}, corner, ...groups), make("tr", {}, ...heads));
  byId("heatmap").tBodies[0].replaceChildren(...body);
  const { tickvals } = decades(100 * low, 100 * high);
  const ticks = tickvals.map((value) => make("span", { style: `left:${100 * place(value / 100)}%` }, `${value} %`));
  byId("colour-scale").replaceChildren(
    make("div", { class: "bar", style: `background:linear-gradient(to right, ${CIVIDIS.join(",")})` }),
    make("div", { class: "ticks" }, ...ticks),
  );
  let end = -Infinity; // of the last label that is kept
  for (const tick of ticks) {
    const { left, right } = tick.getBoundingClientRect();
    if (left < end + 6) tick.remove();
    else end = right;
  }
}
