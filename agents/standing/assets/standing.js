// The standing table: the ladder of every scenario, one cell in full, all cells, and one episode.

const scenarios = Object.keys(data.ladders);
const chosen = { scenario: scenarios[0], satellite: null, mode: null, pilots: [] };
const unique = (values) => [...new Set(values)];
const rowsOf = (scenario) => data.rows.filter((row) => row.scenario === scenario);
const satellites = () => unique(rowsOf(chosen.scenario).map((row) => row.satellite));
const modes = () => unique(rowsOf(chosen.scenario).map((row) => row.inertia));
const inCell = (row) => row.satellite === chosen.satellite && row.inertia === chosen.mode;

/** Rows of a scenario in which the best of each cell is marked: the least expected error inside all limits. */
function marked(scenario) {
  const all = rowsOf(scenario);
  const best = new Map();
  for (const row of all) {
    if (!row.inside || row.kind === "oracle" || row.expected === null) continue;
    const cell = `${row.satellite} ${row.inertia}`;
    if (!best.has(cell) || row.expected < best.get(cell).expected) best.set(cell, row);
  }
  return all.map((row) => ({ ...row, best: best.get(`${row.satellite} ${row.inertia}`) === row }));
}

// the ladder

function showLadder() {
  const steps = Object.keys(data.rungs).filter((rung) => scenarios.some((s) => data.ladders[s].some((step) => step.rung === rung)));
  const heads = ["scenario", ...steps.map((rung) => data.rungs[rung])].map((text) => make("th", { scope: "col", class: "text" }, text));
  const body = scenarios.map((scenario) => {
    const cells = steps.map((rung) => {
      const step = data.ladders[scenario].find((s) => s.rung === rung);
      if (!step) return make("td", {}, "-");
      const star = step.inside < step.cells ? "*" : "";
      const error = step.expected === null ? "ended early" : `${percent(step.expected)} %`;
      const over = step.over_best === null ? "" : ` (${digits3(step.over_best)} x)`;
      return make("td", { style: step.over_best === 1 ? "font-weight:700" : null }, `${step.policy}${star}`, make("small", {}, error + over));
    });
    const pick = make("button", { type: "button" }, scenario);
    pick.addEventListener("click", () => choose({ scenario }));
    return make("tr", {}, make("th", { scope: "row", class: "text" }, pick), ...cells);
  });
  byId("ladder").tHead.replaceChildren(make("tr", {}, ...heads));
  byId("ladder").tBodies[0].replaceChildren(...body);
}

// one cell

const fraction = (key) => (row) => (row[key] === null ? "-" : percent(row[key]));
const share = (value) => (100 * value).toFixed(2);
const COLUMNS = [
  { key: "policy", label: "policy", text: true, meaning: "What chooses the body rates.", value: (row) => row.policy },
  {
    key: "expected", label: "expected\n%", value: fraction("expected"),
    meaning: "Relative error that the filter itself expects, geometric mean over the inertia's parameters and mean over the flight.",
  },
  { key: "expected_at_end", label: "expected\nat end, %", value: fraction("expected_at_end"), meaning: "The same at the end." },
  {
    key: "error", label: "error\nat end, %", value: fraction("error"),
    meaning: "Relative error of the estimated inertia at the end, mean over episodes, in units of the rotors' mean inertia. " +
      "The bound, where there is one, is that which no estimator beats under any excitation inside the envelope.",
  },
  {
    key: "nees", label: "NEES\n(median)", value: (row) => (row.nees === null ? "-" : `${digits3(row.nees)} (${digits3(row.nees_median)})`),
    meaning: "Squared error over what the filter itself expects, per parameter: mean over episodes, without the 10 s after a step of " +
      "the inertia, and median. About 1: the filter is consistent. Far above 1: it claims more than it knows.",
  },
  ...unique(data.rows.flatMap((row) => Object.keys(row.costs ?? {}))).map((name) => ({
    key: `cost ${name}`, label: `${name.replace("_", " ")}\n%`, meaning: `Cost "${name}": share of the time beyond its limit.`,
    of: (row) => row.costs?.[name] ?? null, value: (row) => (row.costs ? share(row.costs[name]) : "-"),
  })),
  {
    key: "terminated", label: "ended\n%", value: (row) => (100 * row.terminated).toFixed(0),
    meaning: "Share of the episodes that ended early, far beyond a limit.",
  },
  {
    key: "decision_ms", label: "decision\nms", meaning: "Computing time of a decision, with all episodes side by side.",
    value: (row) => (row.decision_ms === null ? "-" : row.decision_ms < 0.01 ? "< 0.01" : row.decision_ms.toFixed(2)),
  },
  { key: "episodes", label: "epi-\nsodes", meaning: "Episodes flown.", value: (row) => String(row.episodes) },
  { key: "kind", label: "kind", text: true, meaning: "Scripted, closed loop, learned, or for reference.", value: (row) => KINDS[row.kind] ?? row.kind },
];
const sorting = { key: "expected", descending: false };

function sorted(all) {
  const of = COLUMNS.find((column) => column.key === sorting.key).of ?? ((row) => row[sorting.key] ?? null);
  const sign = sorting.descending ? -1 : 1;
  return all.toSorted((a, b) => {
    const [one, other] = [of(a), of(b)];
    if (one === null || other === null) return (one === null) - (other === null);
    return sign * (typeof one === "string" ? one.localeCompare(other) : one - other);
  });
}

function showCell() {
  const all = marked(chosen.scenario).filter(inCell);
  const costly = (c) => !c.key.startsWith("cost ") || all.some((row) => c.of(row) > 0);
  const columns = COLUMNS.filter(costly);
  const heads = columns.map((column) => {
    const button = make("button", { type: "button", title: column.meaning }, column.label);
    button.addEventListener("click", () => {
      sorting.descending = sorting.key === column.key ? !sorting.descending : false;
      sorting.key = column.key;
      showCell();
    });
    const order = sorting.key !== column.key ? "none" : sorting.descending ? "descending" : "ascending";
    return make("th", { scope: "col", "aria-sort": order, class: column.text ? "text" : null }, button);
  });
  const body = sorted(all.filter((row) => row.kind !== "bound")).map((row) => {
    const cells = columns.slice(1).map((c) => make("td", { class: c.text ? "text" : c.key === "expected" ? "final" : null }, c.value(row)));
    const name = make("th", { scope: "row", class: "text" }, swatch(row.policy), ` ${row.policy}${row.inside ? "" : "*"}`);
    return make("tr", { class: `${row.kind} ${row.best ? "best" : ""}` }, name, ...cells);
  });
  const bounds = all.filter((row) => row.kind === "bound").map((row) => {
    const cells = columns.slice(1).map((c) => make("td", {}, c.key === "error" ? percent(row.error) : ""));
    return make("tr", { class: "bound" }, make("th", { scope: "row", class: "text" }, row.policy), ...cells);
  });
  byId("policy-table").tHead.replaceChildren(make("tr", {}, ...heads));
  byId("policy-table").tBodies[0].replaceChildren(...body, ...bounds);
  const said = columns.flatMap((c) => [make("dt", {}, c.label.replace("-\n", "").replace("\n", " ")), make("dd", {}, c.meaning)]);
  byId("columns").replaceChildren(...said);
  const limit = `${100 * data.most_beyond}\u00a0%`;
  byId("cell-note").textContent =
    `A star marks a policy with a cost above ${limit} or an episode that ended early; bold is the least expected error of ` +
    "those inside. The heads of the columns sort. Baselines have the settings that tuning seeds gave for the satellite in the scenario.";
  const out = Object.values(data.left_out[chosen.scenario]);
  byId("left-out").textContent = out.length ? `Learned policies that do not fly here: ${out.join("; ")}.` : "";
  const measure = { key: "expected", interval: "expected", label: "expected error" };
  const flown = all.filter((row) => row.kind !== "bound");
  showTradeOff("cost-chart", flown, measure, { key: "cost", scale: 100, title: "largest cost, %", line: 100 * data.most_beyond });
}

function showCells() {
  const all = marked(chosen.scenario).filter((row) => row.kind !== "bound");
  const find = (name, { satellite, mode }) => all.find((r) => r.policy === name && r.satellite === satellite && r.inertia === mode);
  const names = unique(all.map((row) => row.policy));
  drawHeatmap({ names, limits: [], satellites: satellites(), modes: modes(), find, measure: "expected" });
}

// one episode

function showReplay() {
  setPlaying(false);
  useEpisode(data.episodes[chosen.scenario]);
  chosen.pilots = episode.shown;
  byId("of-episode").textContent = `scenario ${chosen.scenario}, ${episode.satellite}, ${episode.inertia_mode}`;
  byId("episode-note").textContent =
    `Seed ${episode.seed}: ${chosen.pilots.join(" next to ")}, the best of those built by hand and of what learns or plans. World ` +
    "and noise are the same for both. Drag the picture, or use the arrow keys on it, to look from elsewhere; the space bar plays and pauses.";
  describeFlight();
  makeViews();
  showEpisode();
  showFlight();
}

// the page comes together

function fill(id, values, key) {
  byId(id).replaceChildren(...values.map((v) => make("option", { value: v }, INERTIA[v] ?? v)));
  if (!values.includes(chosen[key])) chosen[key] = values[0];
  byId(id).value = chosen[key];
}

function choose(changes) {
  const other = changes.scenario !== undefined;
  Object.assign(chosen, changes);
  fill("scenario", scenarios, "scenario");
  fill("satellite", satellites(), "satellite");
  fill("mode", modes(), "mode");
  document.querySelectorAll(".of-cell").forEach((at) => (at.textContent = `scenario ${chosen.scenario}, ${chosen.satellite}, ${chosen.mode}`));
  document.querySelectorAll(".of-scenario").forEach((at) => (at.textContent = `scenario ${chosen.scenario}`));
  showCell();
  if (!other) return;
  showCells();
  showReplay();
}

function showProvenance() {
  const { command, seeds, versions } = data.provenance;
  const entries = {
    command: make("code", {}, command),
    revision: data.revisions.join(", "),
    seeds: `${seeds.split} seeds ${seeds.first} to ${seeds.first + seeds.count - 1}; settings: tuning seeds`,
    versions: Object.entries(versions).map(([name, version]) => `${name} ${version}`).join(", "),
  };
  const said = Object.entries(entries).flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]);
  byId("provenance").replaceChildren(...said);
}

for (const [id, key] of [["scenario", "scenario"], ["satellite", "satellite"], ["mode", "mode"]]) {
  byId(id).addEventListener("change", () => choose({ [key]: byId(id).value }));
}
showLadder();
showProvenance();
makeControls();
choose({ scenario: scenarios[0] });
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  colours.clear();
  choose({ scenario: chosen.scenario });
});
