// What every section of every page needs: the data, builders of elements, numbers as text, the look of each policy.

const data = JSON.parse(document.getElementById("data").textContent);

const KINDS = { learned: "learned", closed_loop: "closed loop", scripted: "scripted", reference: "reference", oracle: "oracle" };
const INERTIA = { all: "all modes", static: "static", step: "step", drift: "drift", periodic: "periodic" };

const byId = (id) => document.getElementById(id);

/** A new element with attributes, and children that are elements or text. */
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

const colours = new Map(); // forgotten when the colour scheme changes

/** The value of a custom property of the style sheet, as the colour scheme has it now. */
function colour(name) {
  if (!colours.has(name)) {
    colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  }
  return colours.get(name);
}

/** A colour of the style sheet with an opacity. */
function translucent(name, opacity) {
  const [r, g, b] = [1, 3, 5].map((i) => parseInt(colour(name).slice(i, i + 2), 16));
  return `rgba(${r}, ${g}, ${b}, ${opacity})`;
}

/** A number with three significant digits and no exponent. */
function digits3(value) {
  if (value === 0) return "0";
  const decimals = Math.max(0, 2 - Math.floor(Math.log10(Math.abs(value)) + 1e-9));
  return value.toFixed(Math.min(decimals, 6));
}

const percent = (fraction) => digits3(100 * fraction);

// Colour and dash tell lines apart, and either does alone for most pairs; the marker tells the kind. A policy's place
// among them is fixed by its name, so that it looks the same on every page. Colours and dashes of a kind are coprime in
// number: this many places pass before both come again.
const LOOKS = {
  learned: { colours: ["vermillion", "purple", "ink"], dashes: ["solid", "dash", "dot", "dashdot"], symbol: "star", size: 13 },
  closed_loop: {
    colours: ["blue", "purple", "sky", "green"],
    dashes: ["dash", "longdash", "dot", "dashdot", "longdashdot"],
    symbol: "diamond",
    size: 10,
  },
  scripted: {
    colours: ["orange", "purple", "ink", "sky", "green", "vermillion", "blue"],
    dashes: ["dot", "dash", "longdash", "dashdot", "longdashdot"],
    symbol: "circle",
    size: 9,
  },
  reference: { colours: ["faint"], dashes: ["dash", "dot"], symbol: "x", size: 9 },
  oracle: { colours: ["ink"], dashes: ["longdash"], symbol: "hexagram", size: 11 },
  bound: { colours: ["ink"], dashes: ["dot", "solid"], symbol: "line-ew", size: 9 },
};
const STROKES = {
  solid: "",
  dot: "2 3",
  dash: "7 4",
  longdash: "12 4",
  dashdot: "7 3 2 3",
  longdashdot: "12 3 2 3",
};

const looks = {};
const limits = ["reference_limit", "bound"].map((name, place) => ({ name, kind: "bound", place }));
for (const { name, kind, place } of [...data.policies, ...limits]) {
  const { colours, dashes, symbol, size } = LOOKS[kind];
  const widths = { learned: 2.6, bound: 1.5 };
  looks[name] = {
    kind,
    colour: colours[place % colours.length],
    dash: dashes[place % dashes.length],
    width: widths[kind] ?? 2,
    symbol,
    size,
  };
}

/** A short sample of a policy's line. */
function swatch(name) {
  const { colour: stroke, dash, width } = looks[name];
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("width", "34");
  svg.setAttribute("height", "10");
  svg.setAttribute("aria-hidden", "true");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  const places = { x1: 0, x2: 34, y1: 5, y2: 5, "stroke-width": width, "stroke-dasharray": STROKES[dash] };
  for (const [key, value] of Object.entries(places)) line.setAttribute(key, value);
  line.style.stroke = `var(--${stroke})`;
  svg.append(line);
  return svg;
}

/** Layout that all charts share. */
function layout(changes) {
  const axis = { gridcolor: colour("line"), zerolinecolor: colour("line"), linecolor: colour("faint"), fixedrange: coarse };
  const { xaxis, yaxis, ...others } = changes;
  return {
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: getComputedStyle(document.body).fontFamily, size: 13, color: colour("ink") },
    margin: { l: 62, r: 18, t: 10, b: 46 },
    hoverlabel: { bgcolor: colour("panel"), bordercolor: colour("faint"), font: { color: colour("ink") } },
    showlegend: false,
    dragmode: coarse ? false : "zoom", // a finger scrolls the page
    xaxis: { ...axis, ...xaxis },
    yaxis: { ...axis, ...yaxis },
    ...others,
  };
}

const AXES = ["x", "y", "z"];
const AXIS_COLOURS = ["vermillion", "green", "blue"];
const WHEEL_COLOURS = ["vermillion", "green", "blue", "purple", "orange", "sky"];

const coarse = matchMedia("(pointer: coarse)").matches;
const config = { responsive: true, displaylogo: false, displayModeBar: coarse ? false : "hover" };
config.modeBarButtonsToRemove = ["select2d", "lasso2d", "autoScale2d"];

/** Ticks 1, 2, 5 of each decade from low to high, as values and texts. */
function decades(low, high, steps = [1, 2, 5]) {
  const values = [];
  for (let power = -6; power <= 6; power += 1) {
    for (const step of steps) {
      const value = Number(`${step}e${power}`);
      if (value >= low * 0.999 && value <= high * 1.001) values.push(value);
    }
  }
  return { tickmode: "array", tickvals: values, ticktext: values.map(String) };
}
