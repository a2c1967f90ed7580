// What the reader has chosen, and who wants to know.
const chosen = {
  satellite: data.episode.satellite,
  mode: data.episode.inertia_mode,
  shown: new Set(data.shown), // in the chart of errors
  pilots: [...data.episode.shown], // of the episode, one or two
};
const listeners = [];
const onChoice = (listener) => listeners.push(listener);
const announce = () => listeners.forEach((listener) => listener());
const rows = () => data.cells[chosen.satellite][chosen.mode];
const scenario = data.provenance.settings.scenario;

