// The leaderboard: a table that sorts by any column, with what bounds every policy as its last rows.

const withInterval = (name) => (row) => {
  const low = row[`${name}_lo`];
  const mean = percent(row[`${name}_mean`]) + (name === "final_error" && row.inside === false ? "*" : "");
  if (low === null || low === undefined) return [mean];
  return [mean, " ", make("small", {}, `[${percent(low)} ${percent(row[`${name}_hi`])}]`)];
};
const plain = (key, format) => (row) => [format(row[key])];

const COLUMNS = [
  {
    key: "policy",
    label: "policy",
    meaning: "What chooses the torques.",
    text: true,
  },
  {
    key: "final_error_mean",
    label: "final error\n% [95 %]",
    meaning:
      "Relative error of the estimated inertia over the last 20 % of an episode (the paper's metric), mean over " +
      "episodes, with its 95 % interval (studentised bootstrap over episodes).",
    cell: withInterval("final_error"),
  },
  {
    key: "mean_error_mean",
    label: "mean error\n% [95 %]",
    meaning: "The same over the whole episode, so that a quick start counts.",
    cell: withInterval("mean_error"),
  },
  {
    key: "time_to_1pct_s",
    label: "to 1 %\ns",
    meaning: "Time at which the error first falls to 1 %, median over episodes; never, where most episodes do not.",
    cell: (row) => [row.time_to_1pct_s === null ? "never" : row.time_to_1pct_s.toFixed(1)],
  },
  {
    key: "reward",
    label: "reward",
    meaning: "Sum of the environment's default reward over an episode, mean over episodes; higher is better.",
    cell: plain("reward", (value) => String(Math.round(value) || 0)),
    descending: true,
  },
  {
    key: "outside_fraction",
    label: "outside\n%",
    meaning: "Share of the time in which a body rate is outside its limit. Only who stays at 1 % or less can be best.",
    cell: plain("outside_fraction", (value) => (100 * value).toFixed(2)),
  },
  {
    key: "nees",
    label: "NEES",
    meaning:
      "Squared error over what the filter itself expects, per parameter. About 1: the filter is consistent. Far above " +
      "1: it claims more than it knows. The 10 s after a step of the inertia are left out.",
    cell: plain("nees", (value) => value.toFixed(2)),
  },
  {
    key: "information_nats",
    label: "gain\nnats",
    meaning: "Information about the inertia that the filter's updates gain in an episode.",
    cell: plain("information_nats", (value) => value.toFixed(0)),
  },
  {
    key: "effort",
    label: "effort",
    meaning: "Mean square of the torque commands as fractions of the limit: 0 at rest, 1 at full torque throughout.",
    cell: plain("effort", (value) => (value === 0 ? "0" : value < 1e-3 ? value.toExponential(0) : value.toFixed(3))),
  },
  {
    key: "saturated_fraction",
    label: "satu-\nrated %",
    meaning: "Share of the time that a wheel spends at its speed limit, where it can give no torque one way. Only who stays " +
      "at 1 % or less can be best.",
    cell: plain("saturated_fraction", (value) => (100 * value).toFixed(2)),
  },
  {
    key: "terminated_fraction",
    label: "ended\n%",
    meaning: "Share of the episodes that ended early because a body rate exceeded three times its limit. " +
      "The error then stays what it was.",
    cell: plain("terminated_fraction", (value) => (100 * value).toFixed(1)),
  },
  {
    key: "excitation_efficiency",
    label: "of limit\n%",
    meaning:
      "Reference limit over achieved error. The limit is a MomentumEKF, with the walk that serves the cell best where the " +
      "filter adapts, if every sample told as much as the rate, torque and speed limits allow.",
    cell: plain("excitation_efficiency", (value) => (100 * value).toFixed(0)),
    descending: true,
  },
  {
    key: "efficiency",
    label: "of bound\n%",
    meaning:
      "Bound over achieved error. No estimator beats the bound under any excitation inside the limits, not even one " +
      "that knows how the inertia varies: what is left to gain by better excitation and a better filter together.",
    cell: plain("efficiency", (value) => (100 * value).toFixed(1)),
    descending: true,
  },
  {
    key: "decision_ms",
    label: "decision\nms",
    meaning: "Computing time of a decision on the machine that made this page, with all episodes side by side.",
    cell: plain("decision_ms", (value) => (value < 0.01 ? "< 0.01" : value.toFixed(2))),
  },
  {
    key: "kind",
    label: "kind",
    meaning:
      "Scripted: a torque history fixed in advance. Closed loop: designed by hand or planned in flight on a model. " +
      "Learned: a network trained by imitation or by reinforcement learning. Reference: no contender, shown for scale. " +
      "Limit: what the filter, or any estimator, could reach at best.",
    text: true,
    cell: (row) => [KINDS[row.kind] ?? "limit"],
  },
];
const sorting = { key: "final_error_mean", descending: false };

/** Rows in the chosen order; bounds stay last, and so do policies without a value. */
function sorted(all) {
  const policies = all.filter((row) => row.kind !== "bound");
  const sign = sorting.descending ? -1 : 1;
  policies.sort((a, b) => {
    const [one, other] = [a[sorting.key], b[sorting.key]];
    if (one === null || other === null) return (one === null) - (other === null);
    return sign * (typeof one === "string" ? one.localeCompare(other) : one - other);
  });
  return [...policies, ...all.filter((row) => row.kind === "bound")];
}

function sortBy(column) {
  const again = sorting.key === column.key;
  sorting.descending = again ? !sorting.descending : Boolean(column.descending);
  sorting.key = column.key;
  showLeaderboard();
}

/** The head of a column; means over the modes have no intervals. */
const headOf = (column) => (chosen.mode === "all" ? column.label.replace(" [95 %]", "") : column.label);

function showLeaderboard() {
  const columns = COLUMNS.filter((c) => rows().some((row) => row[c.key] !== null && row[c.key] !== undefined));
  const focused = document.activeElement?.dataset?.key;
  const heads = columns.map((column) => {
    const button = make("button", { type: "button", title: column.meaning, "data-key": column.key }, headOf(column));
    button.addEventListener("click", () => sortBy(column));
    const order = sorting.key !== column.key ? "none" : sorting.descending ? "descending" : "ascending";
    return make("th", { scope: "col", "aria-sort": order, class: column.text ? "text" : null }, button);
  });
  const body = sorted(rows()).map((row) => {
    const cells = columns.map((column) => {
      if (column.key === "policy") return make("th", { scope: "row", class: "text" }, swatch(row.policy), " ", row.policy);
      const known = row[column.key] !== undefined && (row[column.key] !== null || column.key === "time_to_1pct_s");
      const classes = column.text ? "text" : column.key === "final_error_mean" ? "final" : null;
      return make("td", { class: classes }, ...(known ? column.cell(row) : ["-"]));
    });
    return make("tr", { class: `${row.kind} ${row.best ? "best" : ""}` }, ...cells);
  });
  byId("leaderboard-table").tHead.replaceChildren(make("tr", {}, ...heads));
  byId("leaderboard-table").tBodies[0].replaceChildren(...body);
  if (focused) document.querySelector(`#leaderboard-table button[data-key="${focused}"]`)?.focus();
  byId("columns").replaceChildren(
    ...columns.flatMap((c) => [make("dt", {}, headOf(c).replace("-\n", "").replace("\n", ", ")), make("dd", {}, c.meaning)]),
  );
}

/** What the headings call the chosen cell. */
const cellName = () => `scenario ${scenario}, ${chosen.satellite}, ${INERTIA[chosen.mode] ?? chosen.mode}`;

/** The best of a kind in the chosen cell, in words: inside the envelope, or said to be outside where none is inside. */
function bestOf(kind, name, error) {
  const all = rows().filter((row) => row.kind === kind); // by final error
  const inside = all.find((row) => row.inside);
  if (inside) return inside.best ? [] : [`Best ${name} inside it: ${error(inside)}.`];
  return all.length ? [`No ${name} policy keeps to it; the lowest error of those, outside it: ${error(all[0])}.`] : [];
}

/** A few sentences on the chosen cell, which name no error of a policy outside the envelope without saying so. */
function showHeadline() {
  const policies = rows().filter((row) => row.kind !== "bound");
  const best = policies.find((row) => row.best);
  const error = (row) => `${row.policy} ${percent(row.final_error_mean)}\u00a0%`;
  const first = best ? `Lowest final error inside the envelope: ${error(best)}.` : "No policy keeps to the envelope.";
  const others = ["learned", "closed_loop", "scripted"].flatMap((kind) => bestOf(kind, KINDS[kind], error));
  byId("headline").textContent = [first, ...others].join(" ");
  document.querySelectorAll(".of-cell").forEach((place) => (place.textContent = cellName()));
  const { count, split } = data.provenance.seeds;
  byId("leaderboard-note").textContent =
    `${count} episodes on ${split} seeds for every policy and inertia mode, the same truth and noise for all. ` +
    (chosen.mode === "all"
      ? "Means over the inertia modes, without intervals, for the modes share their seeds. "
      : "In brackets 95 % intervals over episodes. ") +
    "Inside the envelope: with a rate outside its limit, or a wheel at its speed limit, for at most " +
    `${100 * data.most_beyond}\u00a0% of the time. A star marks a policy outside it; bold is the lowest final error of those inside. ` +
    "The heads of the columns sort.";
}

onChoice(showLeaderboard);
onChoice(showHeadline);
