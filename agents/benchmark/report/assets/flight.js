// The satellite in flight, drawn on a canvas: orthographic view, far things first.

const REDUCED = matchMedia("(prefers-reduced-motion: reduce)");
const TURNS = 0.5; // a second of playing at 10 x, of a wheel at its speed limit
const camera = { azimuth: -0.95, elevation: 0.42 };
const clock = { time: 0, playing: false, last: 0 };
const views = [];

// vectors and quaternions (scalar last, body to inertial)

const scaled = (v, s) => v.map((x) => x * s);
const plus = (a, b) => a.map((x, i) => x + b[i]);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (v) => scaled(v, 1 / Math.hypot(...v));

function turned([x, y, z, w], v) {
  const t = scaled(cross([x, y, z], v), 2);
  return plus(plus(v, scaled(t, w)), cross([x, y, z], t));
}

/** Right, up and towards the viewer of the inertial frame, as the camera stands. */
function viewAxes() {
  const { azimuth: a, elevation: e } = camera;
  return [
    [-Math.sin(a), Math.cos(a), 0],
    [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)],
    [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)],
  ];
}

/** A flight's state at a time, between the instants that were kept. */
function stateAt(flight, time) {
  const { time: times } = flight;
  const step = times[1] - times[0];
  const i = Math.min(Math.max(Math.floor(time / step), 0), times.length - 2);
  const part = Math.min(Math.max((time - times[i]) / step, 0), 1);
  const between = (series) => series.map((row) => row[i] + part * (row[i + 1] - row[i]));
  const [from, to] = [i, i + 1].map((k) => flight.attitude.map((row) => row[k]));
  const sign = dot(from, to) < 0 ? -1 : 1;
  return {
    attitude: unit(from.map((q, k) => q + part * (sign * to[k] - q))),
    rate: between(flight.rate),
    momentum: between(flight.momentum),
    wheelSpeed: between(flight.wheel_speed),
    angle: between(flight.angle),
    deflection: between(flight.deflection ?? []),
    entry: part < 0.5 ? i : i + 1,
    error: flight.error[part < 0.5 ? i : i + 1],
    over: time > times.at(-1) + 1e-9,
  };
}

/** How far each wheel has turned, scaled so that it can be followed, by the trapezoidal rule. */
function wheelAngles(flight) {
  return flight.wheel_speed.map((speed, k) => {
    const scale = (2 * Math.PI * TURNS) / 10 / episode.wheel_speed_limit[k];
    let angle = 0;
    return speed.map((s, i) => (angle += i ? (scale * (s + speed[i - 1]) * (flight.time[i] - flight.time[i - 1])) / 2 : 0));
  });
}

// drawing

let episode, half, longest, faces, wheels; // what is flown, and the shape of its satellite

/** Show another episode: of a satellite, the same truth for all its flights. */
function useEpisode(next) {
  episode = next;
  for (const flight of episode.flights) { // the truth is the same for all, as far as they fly
    flight.time = episode.time.slice(0, flight.error.length);
    flight.inertia = episode.inertia.map((row) => row.slice(0, flight.error.length));
  }
  half = scaled(episode.size, 0.5);
  longest = Math.max(...episode.size);
  faces = [0, 1, 2].flatMap((axis) => [-1, 1].map((side) => faceOf(axis, side)));
  wheels = episode.wheel_axes.map((_, k) => wheelPlace(k));
  clock.time = 0;
}

/** The flights that are shown, one or two. */
const flights = () => chosen.pilots.map((name) => episode.flights.find((f) => f.policy === name));

const mostMomentum = () => Math.max(...flights().flatMap((f) => f.time.map((_, i) => Math.hypot(...f.momentum.map((row) => row[i])))));

function faceOf(axis, side) {
  const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => {
    const p = [0, 0, 0];
    [p[axis], p[u], p[v]] = [side * half[axis], a * half[u], b * half[v]];
    return p;
  });
  return { normal: [0, 1, 2].map((k) => (k === axis ? side : 0)), corners };
}

/** Centre, radius and two directions in the plane of a wheel, inside the box on its axis. */
function wheelPlace(k) {
  const axis = episode.wheel_axes[k];
  const reach = Math.min(...axis.map((a, i) => (Math.abs(a) > 1e-9 ? half[i] / Math.abs(a) : Infinity)));
  const across = unit(cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
  return { axis, centre: scaled(axis, 0.66 * reach), radius: 0.34 * Math.min(...episode.size), u: across, v: cross(axis, across) };
}

function draw(view) {
  const { canvas, flight } = view;
  const ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.lineJoin = "round";
  const state = stateAt(flight, clock.time);
  const [right, up, near] = viewAxes();
  const zoom = Math.min(width, height) / (2.5 * longest);
  const flat = (p) => [width / 2 + zoom * dot(p, right), height / 2 - zoom * dot(p, up)];
  const inertial = (p) => turned(state.attitude, p);
  const seen = (v) => dot(inertial(v), near) > 0;

  const path = (points) => {
    pen.beginPath();
    points.forEach((p, i) => pen[i ? "lineTo" : "moveTo"](...flat(p)));
  };
  const face = ({ corners }, opacity, edge) => {
    path(corners.map(inertial));
    pen.closePath();
    pen.fillStyle = translucent("sky", opacity);
    pen.fill();
    pen.strokeStyle = colour(edge > 1 ? "ink" : "faint");
    pen.lineWidth = edge;
    pen.stroke();
  };
  const arrow = (tip, name, text, thick, dash = []) => {
    const [from, to] = [flat([0, 0, 0]), flat(tip)];
    const along = [to[0] - from[0], to[1] - from[1]];
    const long = Math.hypot(...along);
    pen.strokeStyle = pen.fillStyle = colour(name);
    pen.lineWidth = thick;
    pen.setLineDash(dash);
    pen.beginPath();
    pen.moveTo(...from);
    pen.lineTo(...to);
    pen.stroke();
    pen.setLineDash([]);
    if (long > 5) {
      const [x, y] = scaled(along, 1 / long);
      const head = 4 + 1.6 * thick;
      pen.beginPath();
      pen.moveTo(to[0] + x * head, to[1] + y * head);
      pen.lineTo(to[0] - y * head * 0.55, to[1] + x * head * 0.55);
      pen.lineTo(to[0] + y * head * 0.55, to[1] - x * head * 0.55);
      pen.fill();
      written(text, to[0] + x * (head + 11), to[1] + y * (head + 11), name);
    }
  };
  const written = (text, x, y, name, size = 14) => {
    pen.font = `600 ${size}px ${getComputedStyle(document.body).fontFamily}`;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.lineWidth = 3;
    pen.strokeStyle = colour("paper");
    pen.strokeText(text, x, y);
    pen.fillStyle = colour(name);
    pen.fillText(text, x, y);
  };

  const basis = [0, 1, 2].map((k) => [0, 1, 2].map((i) => Number(i === k)));
  const arrows = [
    ...basis.map((axis, k) => ({ tip: scaled(axis, 1.05 * longest), name: "faint", text: "XYZ"[k], thick: 1, dash: [3, 4] })),
    ...basis.map((axis, k) => ({ tip: inertial(scaled(axis, half[k] + 0.26 * longest)), name: AXIS_COLOURS[k], text: AXES[k], thick: 2 })),
    { tip: inertial(scaled(state.momentum, (0.95 * longest) / (view.mostMomentum || 1))), name: "purple", text: "M", thick: 3 },
    { tip: inertial(scaled(state.rate, (0.62 * longest) / episode.rate_limit)), name: "ink", text: "\u03c9", thick: 3 },
  ];
  const depth = (p) => dot(p, near);
  const order = (list) => list.toSorted((a, b) => depth(a.tip) - depth(b.tip));
  order(arrows.filter((a) => depth(a.tip) < 0)).forEach((a) => arrow(a.tip, a.name, a.text, a.thick, a.dash));
  faces.filter((f) => !seen(f.normal)).forEach((f) => face(f, 0.12, 0.7));
  const discs = wheels.map((wheel, k) => ({ wheel, k, away: depth(inertial(wheel.centre)) }));
  for (const { wheel, k } of discs.toSorted((a, b) => a.away - b.away)) drawWheel(pen, path, inertial, near, wheel, k, state.angle[k]);
  faces.filter((f) => seen(f.normal)).forEach((f) => face(f, 0.14, 1.5));
  order(arrows.filter((a) => depth(a.tip) >= 0)).forEach((a) => arrow(a.tip, a.name, a.text, a.thick, a.dash));
}

/** A wheel as a pile of discs, the far ones first; sectors on the near one show it turn, unless motion is to be less. */
function drawWheel(pen, path, inertial, near, { axis, centre, radius, u, v }, k, angle) {
  const name = WHEEL_COLOURS[k % WHEEL_COLOURS.length];
  const start = REDUCED.matches ? 0 : angle;
  const side = Math.sign(dot(inertial(axis), near)) || 1;
  for (let layer = -3; layer <= 3; layer += 1) {
    const middle = plus(centre, scaled(axis, layer * side * 0.045 * radius));
    const rim = (a) => inertial(plus(middle, plus(scaled(u, radius * Math.cos(a)), scaled(v, radius * Math.sin(a)))));
    const arc = (from, to) => Array.from({ length: 13 }, (_, i) => rim(from + ((to - from) * i) / 12));
    const whole = [...arc(0, Math.PI), ...arc(Math.PI, 2 * Math.PI)];
    path(whole);
    pen.closePath();
    pen.fillStyle = layer < 3 ? colour(name) : colour("paper");
    pen.fill();
    if (layer < 3) continue;
    for (const from of [start, start + Math.PI]) {
      path([inertial(middle), ...arc(from, from + Math.PI / 2)]);
      pen.closePath();
      pen.fillStyle = colour(name);
      pen.fill();
    }
    path(whole);
    pen.closePath();
    pen.strokeStyle = colour(name);
    pen.lineWidth = 2;
    pen.stroke();
  }
}

/** A number with a given count of decimals, and no minus before a zero. */
const fixed = (value, decimals) => (Number(value.toFixed(decimals)) || 0).toFixed(decimals);

// gauges: each rate and each wheel against its limit

function makeGauges(flight) {
  const rowsOf = [
    ...AXES.map((axis, i) => ({ name: `rate ${axis}`, look: AXIS_COLOURS[i], limit: episode.rate_limit, of: (s) => s.rate[i], text: (v) => `${fixed(1e3 * v, 1)} mrad/s` })),
    ...(flight.deflection ?? []).map((_, k) => ({
      name: `mode ${k + 1}`, look: "purple", limit: 1, of: (s) => s.deflection[k], text: (v) => `${fixed(100 * v, 0)} % of limit`,
    })),
    ...flight.wheel_speed.map((_, k) => ({
      name: `wheel ${k + 1}`, look: WHEEL_COLOURS[k % WHEEL_COLOURS.length], limit: episode.wheel_speed_limit[k],
      of: (s) => s.wheelSpeed[k], text: (v) => `${fixed(v, 0)} rad/s`,
    })),
  ];
  const box = make("div", { class: "gauges" });
  const error = make("span", { class: "value" });
  box.append(make("span", {}, "relative error"), make("span"), error);
  const bars = rowsOf.map((row) => {
    const fill = make("i", { style: `background: var(--${row.look})` });
    const value = make("span", { class: "value" });
    box.append(make("span", {}, row.name), make("span", { class: "gauge" }, fill), value);
    return { ...row, fill, value };
  });
  return { box, error, bars };
}

function showGauges({ flight, gauges }) {
  const state = stateAt(flight, clock.time);
  gauges.error.textContent = state.over ? "ended" : `${percent(state.error)} %`;
  for (const { fill, value, of, limit, text } of gauges.bars) {
    fill.style.transform = `scaleX(${Math.min(Math.max(of(state) / limit, -1), 1)})`;
    value.textContent = text(of(state));
  }
}

// playing

function showFlight() {
  for (const view of views) {
    draw(view);
    showGauges(view);
    if (episode.sky) drawSky(view.sky, view.flight, stateAt(view.flight, clock.time));
  }
  byId("scrub").value = String(clock.time);
  byId("clock").textContent = `${clock.time.toFixed(1)} of ${episode.horizon} s`;
}

function setPlaying(on) {
  if (on && clock.time >= episode.horizon) clock.time = 0;
  clock.playing = on;
  clock.last = performance.now();
  byId("play").textContent = on ? "Pause" : "Play";
  byId("play").setAttribute("aria-pressed", String(on));
  if (on) requestAnimationFrame(tick);
}

function tick(now) {
  if (!clock.playing) return;
  const passed = Math.min((now - clock.last) / 1e3, 1.5); // a page in the background does not leap
  if (!REDUCED.matches || passed >= 1) { // reduced motion: one still picture a second
    clock.last = now;
    clock.time = Math.min(clock.time + Math.max(passed, 0) * Number(byId("speed").value), episode.horizon);
    showFlight();
  }
  if (clock.time >= episode.horizon) setPlaying(false);
  else requestAnimationFrame(tick);
}

function lookFrom(azimuth, elevation) {
  camera.azimuth += azimuth;
  camera.elevation = Math.min(Math.max(camera.elevation + elevation, -1.5), 1.5);
  showFlight();
}

const resized = new ResizeObserver(() => showFlight());

/** A picture and gauges for each policy that was chosen, in place of those before. */
function makeViews() {
  resized.disconnect();
  views.length = 0;
  byId("views").replaceChildren();
  byId("views").classList.toggle("single", flights().length === 1);
  const most = mostMomentum();
  for (const flight of flights()) {
    flight.angle ??= wheelAngles(flight);
    const label = `Satellite flown by ${flight.policy}; arrow keys turn the view, space plays and pauses`;
    const canvas = make("canvas", { tabindex: "0", role: "img", "aria-label": label });
    const gauges = makeGauges(flight);
    const title = make("h3", {}, swatch(flight.policy), ` ${flight.policy}`, make("small", {}, ` ${KINDS[flight.kind]}`));
    const sky = episode.sky ? make("canvas", { class: "sky", role: "img", "aria-label": `Sky of ${flight.policy}` }) : null;
    byId("views").append(make("div", { class: "view" }, title, canvas, ...(sky ? [sky] : []), gauges.box));
    views.push({ canvas, sky, flight, gauges, mostMomentum: most });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (canvas.hasPointerCapture(event.pointerId)) lookFrom(-event.movementX / 120, event.movementY / 120);
    });
    canvas.addEventListener("keydown", (event) => {
      const turn = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
      if (turn) lookFrom(...turn);
      else if (event.key === " ") setPlaying(!clock.playing);
      else return;
      event.preventDefault();
    });
    resized.observe(canvas);
  }
}

function describeFlight() {
  byId("scrub").max = String(episode.horizon);
  const slower = (10 * Math.max(...episode.wheel_speed_limit)) / (2 * Math.PI * TURNS);
  byId("flight-note").textContent =
    "The box is to scale. Thin dashed X, Y, Z: inertial axes; x, y, z: body axes; M: total angular momentum, which " +
    "only disturbances can move; \u03c9: body rate. The bars show each rate and each wheel's speed against its limit. The discs are the wheels; they are drawn inside the box, and at " +
    `10\u00a0x they turn ${Math.round(slower / 10)} times slower than in truth. ` +
    (REDUCED.matches ? "As your system asks for less motion, playing shows one still picture a second." : "");
}

function makeControls() {
  byId("play").addEventListener("click", () => setPlaying(!clock.playing));
  byId("scrub").addEventListener("input", (event) => {
    clock.time = Number(event.target.value);
    showFlight();
  });
}
