// The sky of a flight: all directions round the boresight of its payload, or of its star tracker where it has none.
// The map is azimuthal and equidistant: the further out, the larger the angle to the boresight.

/** An inertial direction in the body frame. */
const toBody = ([x, y, z, w], v) => turned([-x, -y, -z, w], v);

/** Two unit vectors across an axis, and across each other. */
function across(axis) {
  const least = axis.map(Math.abs).indexOf(Math.min(...axis.map(Math.abs)));
  const aside = unit(cross(axis, [0, 1, 2].map((k) => Number(k === least))));
  return [aside, cross(axis, aside)];
}

const angleOf = (a, b) => Math.acos(Math.min(Math.max(dot(a, b), -1), 1));

function drawSky(canvas, flight, state) {
  const { sky } = episode;
  const ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  const middle = [height / 2, height / 2];
  const radius = height / 2 - 6;
  const axis = unit((sky.payload ?? sky.tracker).boresight);
  const [aside, up] = across(axis);
  const place = (v) => {
    const [angle, azimuth] = [angleOf(v, axis) / Math.PI, Math.atan2(dot(v, up), dot(v, aside))];
    return [middle[0] + radius * angle * Math.cos(azimuth), middle[1] + radius * angle * Math.sin(azimuth)];
  };
  const ring = (towards, size) => {
    const [u, v] = across(towards);
    return Array.from({ length: 721 }, (_, i) => { // near the rim a small step is a large one on the map
      const a = (2 * Math.PI * i) / 720;
      return place(plus(scaled(towards, Math.cos(size)), scaled(plus(scaled(u, Math.cos(a)), scaled(v, Math.sin(a))), Math.sin(size))));
    });
  };
  const shape = (points) => {
    pen.beginPath();
    points.forEach((p, i) => pen[i ? "lineTo" : "moveTo"](...p));
    pen.closePath();
  };
  /** What is within an angle of a direction; where that holds the map's rim, all outside of its edge. */
  const disc = (towards, size, name, opacity) => {
    shape(ring(towards, size));
    if (Math.PI - angleOf(towards, axis) < size) pen.arc(...middle, radius, 0, 2 * Math.PI);
    pen.fillStyle = translucent(name, opacity);
    pen.fill("evenodd");
  };
  const written = (text, [x, y], name) => {
    pen.font = `600 13px ${getComputedStyle(document.body).fontFamily}`;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    pen.fillStyle = colour(name);
    pen.fillText(text, x, y);
  };

  pen.beginPath();
  pen.arc(...middle, radius, 0, 2 * Math.PI);
  pen.fillStyle = colour("panel");
  pen.fill();
  pen.save();
  pen.clip();
  const { tracker, payload } = sky;
  const sun = toBody(state.attitude, sky.sun);
  const turn = sky.orbit_rate * Math.min(clock.time, flight.time.at(-1));
  const earth = toBody(state.attitude, [Math.cos(turn), Math.sin(turn), 0]);
  const avoids = payload ? payload.keep_out : tracker.sun;
  if (!payload && tracker.earth !== null) {
    disc(earth, tracker.earth, "blue", 0.25);
    disc(earth, tracker.limb, "blue", 0.6);
  }
  const sees = Boolean(payload || tracker.sun !== null);
  if (sees) {
    if (avoids) disc(sun, avoids, "orange", 0.25);
    disc(sun, 0.1, "orange", 1);
  }
  pen.restore();
  pen.strokeStyle = colour("faint");
  pen.lineWidth = 1;
  pen.beginPath();
  pen.arc(...middle, radius, 0, 2 * Math.PI);
  pen.stroke();
  const [words, name] = payload ? windowState(flight, state) : trackerState(flight, state);
  if (payload) {
    const target = place(toBody(state.attitude, payload.target[state.entry]));
    pen.strokeStyle = colour("ink");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(...target, 5, 0, 2 * Math.PI);
    pen.stroke();
  }
  pen.strokeStyle = colour(name);
  pen.lineWidth = 2;
  for (const [dx, dy] of [[7, 0], [0, 7]]) {
    pen.beginPath();
    pen.moveTo(middle[0] - dx, middle[1] - dy);
    pen.lineTo(middle[0] + dx, middle[1] + dy);
    pen.stroke();
  }
  const left = height + 12;
  written(payload ? "sky of the payload" : "sky of the star tracker", [left, 18], "ink");
  written(words, [left, 40], name);
  if (sees) written(avoids ? "Sun, and what to keep from" : "Sun", [left, 70], "orange");
  if (!payload && tracker.earth !== null) written("Earth, and its exclusion", [left, 90], "blue");
  if (payload) written("ring: target; cross: boresight", [left, 90], "faint");
  else written("cross: boresight", [left, 110], "faint");
}

function trackerState(flight, state) {
  return flight.tracks[state.entry] ? ["sees stars", "green"] : ["blind", "vermillion"];
}

function windowState(flight, state) {
  const [opens, closes] = episode.sky.payload.window[state.entry];
  const now = flight.time[state.entry];
  if (flight.missed[state.entry] > 0) return ["misses its window", "vermillion"];
  if (now < opens) return [`window opens in ${(opens - now).toFixed(0)} s`, "blue"];
  return [`takes images, ${Math.max(closes - now, 0).toFixed(0)} s left`, "green"];
}
