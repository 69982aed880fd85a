// The points or the surface of a capture and its cameras, drawn with a depth buffer on a plain canvas, without WebGL.

/** Bytes of a point: three coordinates of 16 bits, a colour, the number of photographs that confirm it. */
const POINT = 10;
/** Length of a camera's pyramid and, at zoom 1, the viewer's distance, in radii of cloud and cameras. */
const PYRAMID = 0.09, DISTANCE = 2.2;

function captureView() {
  const frame = uprightFrame(report.cameras);
  const { xyz, colours, confirmed } = unpacked(report.points, frame), count = colours.length;
  const surface = report.surface && { ...unpacked(report.surface, frame), corners: new Uint32Array(bytesOf(report.surface.triangles).buffer) };
  const pivot = [0, 1, 2].map((axis) => quantiles(xyz.filter((_, i) => i % 3 === axis), [0.5])[0]);
  const apart = Float32Array.from({ length: count }, (_, i) => Math.hypot(...pivot.map((p, axis) => xyz[3 * i + axis] - p)));
  const centres = report.cameras.map((camera) => pyramid(camera.lens, frame, 0)[0]);
  const cameras = Float32Array.from(centres, (centre) => Math.hypot(...pivot.map((p, axis) => centre[axis] - p)));
  // One camera far off does not make the rest small.
  const radius = Math.max(quantiles(apart, [0.8])[0] || 0, quantiles(cameras, [0.9])[0] || 0) || 1;
  const sigmas = Float32Array.from(report.cameras, (camera) => camera.sigma ?? 0);
  const [doubtful] = quantiles(sigmas, [0.8]);
  const pyramids = report.cameras.map((camera) => ({ ...camera, corners: pyramid(camera.lens, frame, PYRAMID * radius) }));
  const start = { turn: 0.35, tilt: 0.5, zoom: 1 };
  const state = { ...start, least: 1, near: null, surface: false };

  const canvas = make("canvas", {
    id: "capture-cloud", tabindex: "0", role: "img",
    "aria-label": "Points and cameras of the capture; arrow keys turn them, plus and minus zoom, 0 resets",
  });
  const context = canvas.getContext("2d");
  const shown = make("span", { class: "soft small", id: "capture-count" });
  let place = null;

  const draw = oncePerFrame(() => {
    const wide = Math.max(64, Math.min(1280, Math.round((canvas.clientWidth || 640) * Math.min(devicePixelRatio || 1, 1.5))));
    const high = Math.round(wide * (wide < 600 ? 0.8 : 0.56));
    if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
    const picture = context.createImageData(wide, high);
    const words = new Uint32Array(picture.data.buffer), buffer = new Float32Array(wide * high).fill(Infinity);
    place = projection(wide, high);
    const target = { words, buffer, wide, high };
    const drawn = state.surface ? triangles(target) : splat(target);
    context.putImageData(picture, 0, 0);
    const style = getComputedStyle(canvas);
    for (const camera of pyramids) outline(camera, style.getPropertyValue(camera.sigma >= doubtful ? "--focus" : "--accent"));
    const name = state.near ? `${state.near.name}, sigma / depth ${percent(state.near.sigma)}: click to open its report. ` : "";
    shown.textContent = `${name}${drawn}, ${pyramids.length} cameras; the least sure fifth is orange.`;
  });

  /** Draws the points; gives their number. */
  function splat({ words, buffer, wide, high }) {
    const spacing = (2.2 * radius * high) / Math.sqrt(count);
    let drawn = 0;
    for (let i = 0; i < count; i += 1) {
      if (confirmed[i] < state.least) continue;
      drawn += 1;
      const [x, y, z] = place(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
      if (!(z > 0)) continue;
      const size = Math.max(1, Math.min(4, Math.round(spacing / z)));
      const left = Math.round(x - size / 2), top = Math.round(y - size / 2);
      if (left < 0 || top < 0 || left + size > wide || top + size > high) continue;
      for (let row = top; row < top + size; row += 1) {
        for (let to = row * wide + left, end = to + size; to < end; to += 1) {
          if (z < buffer[to]) { buffer[to] = z; words[to] = colours[i]; }
        }
      }
    }
    return `${drawn.toLocaleString("en")} of ${count.toLocaleString("en")} points`;
  }

  /** Draws the surface; gives the number of its triangles. */
  function triangles(target) {
    const screen = new Float32Array(surface.xyz.length), { corners } = surface;
    for (let i = 0; i < screen.length; i += 3) screen.set(place(surface.xyz[i], surface.xyz[i + 1], surface.xyz[i + 2]), i);
    for (let i = 0; i < corners.length; i += 3) fillTriangle(target, screen, corners.subarray(i, i + 3), surface.colours);
    return `${(corners.length / 3).toLocaleString("en")} triangles`;
  }

  /** From the upright frame to a place on the canvas and the distance. */
  function projection(wide, high) {
    const [ct, st, cp, sp] = [Math.cos(state.turn), Math.sin(state.turn), Math.cos(state.tilt), Math.sin(state.tilt)];
    const back = (DISTANCE * radius) / state.zoom;
    return (x0, y0, z0) => {
      const a = x0 - pivot[0], b = y0 - pivot[1], c = z0 - pivot[2];
      const far = ct * c - st * a, z = sp * b + cp * far + back;
      return [wide / 2 + (high * (ct * a + st * c)) / z, high / 2 + (high * (cp * b - sp * far)) / z, z - 0.02 * radius];
    };
  }

  function outline(camera, colour) {
    const [centre, ...corners] = camera.corners.map((corner) => place(...corner));
    camera.at = centre;
    if (![centre, ...corners].every(([, , z]) => z > 0)) { camera.at = null; return; }
    context.strokeStyle = colour;
    context.lineWidth = camera === state.near ? 3 : 1.5;
    context.beginPath();
    corners.forEach(([x, y], i) => {
      const [u, v] = corners[(i + 1) % 4];
      context.moveTo(centre[0], centre[1]);
      context.lineTo(x, y);
      context.lineTo(u, v);
    });
    context.stroke();
  }

  const act = orbit(canvas, {
    turn(dx, dy) {
      state.turn += dx;
      state.tilt = Math.max(-1.5, Math.min(1.5, state.tilt + dy));
      draw();
    },
    zoom(factor) { state.zoom = Math.max(0.2, Math.min(40, state.zoom * factor)); draw(); },
    reset() { Object.assign(state, start); draw(); },
  });
  let pressed = null;
  const point = (event) => {
    const box = canvas.getBoundingClientRect();
    return [((event.clientX - box.left) * canvas.width) / box.width, ((event.clientY - box.top) * canvas.height) / box.height];
  };
  canvas.addEventListener("pointermove", (event) => {
    const [x, y] = point(event);
    const far = (camera) => (camera.at ? Math.hypot(camera.at[0] - x, camera.at[1] - y) : Infinity);
    const nearest = pyramids.reduce((best, camera) => (far(camera) < far(best) ? camera : best), pyramids[0]);
    const near = nearest && far(nearest) < 16 ? nearest : null;
    if (near === state.near) return;
    state.near = near;
    canvas.style.cursor = near ? "pointer" : "";
    draw();
  });
  canvas.addEventListener("pointerdown", (event) => { pressed = point(event); });
  canvas.addEventListener("click", (event) => {
    const [x, y] = point(event);
    if (state.near && pressed && Math.hypot(pressed[0] - x, pressed[1] - y) < 5) location.href = `${encodeURIComponent(state.near.folder)}/report.html`;
  });

  const most = confirmed.reduce((high, value) => Math.max(high, value), 1);
  const levels = [1, 2, 3, 5, 8].filter((level) => level <= most).map((level) => [String(level), level === 1 ? "1 other photograph" : `${level} others`]);
  const least = choice(levels, "1", "Photographs that confirm a point", (level) => { state.least = Number(level); draw(); });
  const drawnAs = choice([["points", "Points"], ["surface", "Surface"]], "points", "Points or the surface", (name) => {
    state.surface = least.disabled = name === "surface";
    draw();
  });
  new ResizeObserver(draw).observe(canvas);
  return make("div", { class: "cloud" },
    make("div", { class: "stage" }, canvas),
    make("div", { class: "row" },
      surface && make("label", { class: "wide" }, "Drawn as", drawnAs),
      make("label", { class: "wide" }, "Confirmed by at least", least),
      make("button", { type: "button", onclick: () => act.zoom(1.25), "aria-label": "Zoom in" }, "+"),
      make("button", { type: "button", onclick: () => act.zoom(0.8), "aria-label": "Zoom out" }, "−"),
      make("button", { type: "button", onclick: act.reset }, "Reset")),
    shown);
}

/** Places in the upright frame, colours, and how many photographs confirm each. */
function unpacked({ range, data }, frame) {
  const bytes = bytesOf(data), count = bytes.length / POINT, values = new DataView(bytes.buffer);
  const xyz = new Float32Array(3 * count), colours = new Uint32Array(count), confirmed = new Uint8Array(count);
  for (let i = 0; i < count; i += 1) {
    const at = POINT * i;
    const world = range.map(([low, high], axis) => low + ((high - low) * values.getUint16(at + 2 * axis, true)) / 65535);
    xyz.set(frame.map((axis) => dot(axis, world)), 3 * i);
    colours[i] = 0xff000000 | (bytes[at + 8] << 16) | (bytes[at + 7] << 8) | bytes[at + 6];
    confirmed[i] = bytes[at + 9];
  }
  return { xyz, colours, confirmed };
}

/** Axes to the right, down and ahead, in the world: level for the mean camera, along its view. */
function uprightFrame(cameras) {
  const column = (index, sign) => [0, 1, 2].map((row) => sign * cameras.reduce((sum, { lens }) => sum + lens[6][row][index], 0));
  const unit = (v) => v.map((value) => value / (Math.hypot(...v) || 1));
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const down = unit(column(1, -1));
  // All round a table the views cancel, and any direction will do.
  const views = column(2, -1), level = views.map((value, axis) => value - dot(views, down) * down[axis]);
  const ahead = unit(Math.hypot(...level) > 0.05 * cameras.length ? level : cross(down, column(1, 1).map((value, axis) => value + (axis === 0 ? 7 : 3) * cameras.length)));
  return [cross(down, ahead), down, ahead];
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** Centre and the four corners of the image at that distance from it, in the upright frame. */
function pyramid([fx, fy, cx, cy, w, h, m], frame, length) {
  const world = ([x, y, z]) => [0, 1, 2].map((row) => m[row][0] * x - m[row][1] * y - m[row][2] * z + m[row][3]);
  const corners = [[0, 0], [w, 0], [w, h], [0, h]].map(([u, v]) => [((u - cx) / fx) * length, ((v - cy) / fy) * length, length]);
  return [[0, 0, 0], ...corners].map((corner) => frame.map((axis) => dot(axis, world(corner))));
}

document.getElementById("capture").append(captureView());
document.documentElement.dataset.ready = "yes";
