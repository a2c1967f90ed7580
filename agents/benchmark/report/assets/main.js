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

/** The policies that fly the episode: any one, alone or beside any other. */
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

function showAll() {
  colours.clear();
  announce();
  showHeatmap();
  showEpisode();
  showFlight();
}

fillSelectors();
showProvenance();
fillPilots();
makeControls();
describeEpisode();
makeViews();
showLegend();
showAll();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", showAll);

let width = innerWidth;
addEventListener("resize", () => {
  if (innerWidth === width) return; // a phone's address bar comes and goes
  width = innerWidth;
  showTradeOffs(); // labels find their places anew
  showHeatmap(); // so do those of the colours
});
