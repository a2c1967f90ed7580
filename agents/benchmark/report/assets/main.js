// The page comes together.

function fillSelectors() {
  const fill = (id, values, text) => byId(id).replaceChildren(...values.map((v) => make("option", { value: v }, text(v))));
  fill("satellite", data.satellites, String);
  fill("mode", data.modes.length > 1 ? [...data.modes, "all"] : data.modes, (mode) => INERTIA[mode] ?? mode);
  for (const id of ["satellite", "mode"]) {
    byId(id).value = chosen[id];
    byId(id).addEventListener("change", () => {
      chosen[id] = byId(id).value;
      announce();
    });
  }
}

function showProvenance() {
  const { command, revision, seeds, settings, versions } = data.provenance;
  const versionsText = Object.entries(versions).map(([name, version]) => `${name} ${version}`).join(", ");
  const entries = {
    command: make("code", {}, command),
    revision: make("code", {}, revision),
    seeds:
      `${seeds.split} seeds ${seeds.first} to ${seeds.first + seeds.count - 1}` +
      (seeds.split === "test" ? ", which neither tuning nor training has seen" : ""),
    scenario,
    versions: versionsText,
  };
  if (data.stored) {
    const made = `${data.stored.file}, revision ${data.stored.revision}; not flown in this comparison`;
    entries.stored = [...(data.stored.file ? [made] : []), ...data.stored.notes].join(". ");
  }
  byId("provenance").replaceChildren(
    ...Object.entries(entries).flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]),
  );
  const option = scenario === "default" ? "" : ` --scenario ${scenario}`;
  byId("rebuild").textContent = `python -m agents.report --results ${settings.output}${option}`;
}

function describeEpisode() {
  const said = (f) => {
    const { inside } = data.cells[episode.satellite][episode.inertia_mode].find((row) => row.policy === f.policy);
    return `${f.policy} (${KINDS[f.kind]}, ${inside ? "inside" : "outside"} the envelope in this cell)`;
  };
  byId("of-episode").textContent = `scenario ${scenario}, ${episode.satellite}, ${episode.inertia_mode}`;
  byId("episode-note").textContent =
    `Seed ${episode.seed}: ${flights().map(said).join(" next to ")}. ` +
    "Any policy of the comparison can be chosen. " +
    "World and noise are the same for all. Drag the picture, or use the arrow keys on it, to look from elsewhere; the " +
    "space bar plays and pauses.";
}

/** The policies that fly the episode: any one, alone or next to any other. */
function fillPilots() {
  const names = episode.flights.map((f) => f.policy);
  for (const [i, id] of ["pilot-0", "pilot-1"].entries()) {
    const options = names.map((name) => make("option", { value: name }, name));
    byId(id).replaceChildren(...options, ...(i ? [make("option", { value: "" }, "nobody")] : []));
    byId(id).value = chosen.pilots[i] ?? "";
    byId(id).addEventListener("change", () => {
      chosen.pilots = [byId("pilot-0").value, byId("pilot-1").value].filter(Boolean);
      showPilots();
    });
  }
}

function showPilots() {
  describeEpisode();
  makeViews();
  showEpisode();
  showFlight();
}

function showHeatmap() {
  const { satellites, modes } = data;
  const find = (name, { satellite, mode }) => data.cells[satellite][mode].find((row) => row.policy === name);
  const limits = BOUNDS.filter((name) => satellites.every((satellite) => modes.every((mode) => find(name, { satellite, mode }))));
  drawHeatmap({ names: data.policies.map((p) => p.name), limits, satellites, modes, find, measure: "final_error_mean" });
}

function showAll() {
  colours.clear();
  announce();
  showHeatmap();
  showEpisode();
  showFlight();
}

useEpisode(data.episode);
fillSelectors();
showProvenance();
fillPilots();
makeControls();
describeFlight();
describeEpisode();
makeViews();
showLegend();
showAll();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", showAll);

let width = innerWidth;
addEventListener("resize", () => {
  if (innerWidth === width) return; // a phone's address bar comes and goes
  width = innerWidth;
  showTradeOffs(); // labels find their places again
  showHeatmap(); // so do those of the colours
});
