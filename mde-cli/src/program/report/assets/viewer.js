// Two layers with a slider between them, edges over both, and the values of the maps at a pixel.

/** A depth that changes by more than this factor within `REACH` pixels on either side has an edge. */
const EDGE_RATIO = 1.1;
const REACH = 2;

/** A canvas with `colour` where a depth map jumps the most along a row or a column. */
function edgePicture(values, [width, height], colour) {
  const canvas = make("canvas", { width, height });
  const context = canvas.getContext("2d");
  context.fillStyle = colour;
  const logs = values.map((v) => (v > 0 ? Math.log(v) : NaN));
  const least = Math.log(EDGE_RATIO);
  for (const [step, along, size] of [[1, (place) => place % width, width], [width, (place) => Math.floor(place / width), height]]) {
    const jump = (place) => {
      const at = along(place);
      if (at < REACH || at >= size - REACH) return 0;
      return Math.abs(logs[place + REACH * step] - logs[place - REACH * step]) || 0;
    };
    for (let place = 0; place < values.length; place += 1) {
      const here = jump(place);
      if (here <= least || here < jump(place - step) || here <= jump(place + step)) continue;
      // A receding floor is steep everywhere; an edge is not.
      const beside = Math.max(jump(place - 2 * REACH * step), jump(place + 2 * REACH * step));
      if (here > 1.25 * beside) context.fillRect(place % width, Math.floor(place / width), 1, 1);
    }
  }
  return canvas;
}

const EDGES = { prior: "#ff9d1e", refined: "#19e3ff" };

function viewer({ layers, maps }) {
  const [width, height] = report.size;
  const unit = report.record.unit === "unscaled" ? "" : `${NBSP}${report.record.unit}`;
  const state = { left: report.record.prior?.source === "none" ? "image" : "prior", right: "refined", split: 0.5, at: null, edges: new Set(), measure: false, ends: [] };
  const edges = {};
  /** Upper left corner of the part of the maps that is shown, and how many times larger than the whole it is. */
  const view = { x: 0, y: 0, zoom: 1 };

  const canvas = make("canvas", {
    id: "viewer", tabindex: "0", role: "img",
    "aria-label": "Two maps side by side; arrow keys move the pixel that is read, Page Up and Page Down the slider; plus and minus zoom, 0 shows the whole",
  });
  const context = canvas.getContext("2d");
  const tags = { left: make("span", { class: "tag left" }), right: make("span", { class: "tag right" }) };
  const slider = make("input", {
    id: "split", type: "range", min: "0", max: "1000", value: "500", "aria-label": "Border between the maps",
    oninput: () => { state.split = slider.value / 1000; draw(); },
  });
  const readout = make("dl", { id: "readout", "aria-live": "polite" }, make("dt", {}, "Point at a pixel: its values stand here."));
  const scales = make("div", { class: "panel" });

  const draw = oncePerFrame(() => {
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const wide = Math.max(1, Math.round((canvas.clientWidth || width) * ratio));
    const high = Math.max(1, Math.round((wide * height) / width));
    if (canvas.width !== wide || canvas.height !== high) { canvas.width = wide; canvas.height = high; }
    const scale = (view.zoom * wide) / width;
    const onto = (picture) => context.drawImage(picture, -view.x * scale, -view.y * scale, width * scale, height * scale);
    const on = ([x, y]) => [(x + 0.5 - view.x) * scale, (y + 0.5 - view.y) * scale];
    const middle = state.split * wide;
    const part = (name, from, to) => {
      context.save();
      context.beginPath();
      context.rect(from, 0, to - from, high);
      context.clip();
      context.imageSmoothingEnabled = Boolean(layers[name].smooth) && view.zoom < 4;
      onto(layers[name].canvas);
      context.restore();
    };
    part(state.left, 0, middle);
    part(state.right, middle, wide);
    context.imageSmoothingEnabled = false;
    for (const name of Object.keys(EDGES).filter((name) => state.edges.has(name))) {
      edges[name] ??= edgePicture(maps[name], report.size, EDGES[name]);
      onto(edges[name]);
    }
    bar(context, middle, high, ratio);
    if (state.at) cross(context, ...on(state.at), ratio);
    ruler(context, state.ends.map(on), ratio);
    tags.left.hidden = state.split < 0.12;
    tags.right.hidden = state.split > 0.88;
  });

  function read() {
    if (!state.at) return;
    const [x, y] = state.at;
    const place = y * width + x;
    const depth = (values, sigmas) => {
      if (!(values[place] > 0)) return "missing";
      const sigma = sigmas[place] > 0 ? `${NBSP}±${NBSP}${number(sigmas[place])}` : "";
      return `${number(values[place], 4)}${sigma}${unit}`;
    };
    const change = maps.prior[place] > 0 && maps.refined[place] > 0 ? changeOf(maps.prior[place], maps.refined[place]) : "–";
    const full = [x, y].map((v, i) => Math.floor(((v + 0.5) * report.full[i]) / report.size[i]));
    const rows = [
      ["pixel", `${full[0]}, ${full[1]}`],
      ["prior", depth(maps.prior, maps.prior_sigma)],
      ["refined", depth(maps.refined, maps.sigma)],
      ["sigma / depth", maps.relative[place] > 0 ? `${number(maps.relative[place], 2)}${NBSP}%` : "–"],
      ["change", change],
    ];
    if (state.measure) rows.push(["distance", state.ends.length === 2 ? distance(...state.ends) : state.ends.length === 1 ? "press a second point" : "press two points"]);
    if (maps.evidence) rows.push(["evidence", evidenceName(maps.evidence[place])]);
    if (maps.truth) rows.push(["truth", maps.truth[place] > 0 ? `${number(maps.truth[place], 4)} m` : "missing"], ...errorsAt(place));
    readout.replaceChildren(...rows.flatMap(([name, value]) => [make("dt", {}, name), make("dd", { "data-name": name }, value)]));
  }

  /** With the decimals of the depths. */
  function changeOf(before, after) {
    const decimals = (number(before, 4).split(".")[1] ?? "").length;
    return `${fixed(after - before, decimals, true)}${unit} (${fixed(100 * (after / before - 1), 1, true)}${NBSP}%)`;
  }

  /** Error of both depths after the alignment of the scores, where the truth is known. */
  function errorsAt(place) {
    if (!maps.error_prior || !(maps.truth[place] > 0)) return [];
    const of = (name) => (maps[name][place] > 0 ? fixed(maps[`error_${name}`][place], 3, true) : "–");
    return [["error, aligned", `${of("prior")} → ${of("refined")}${NBSP}m`]];
  }

  function show() {
    for (const side of ["left", "right"]) tags[side].textContent = layers[state[side]].label;
    const both = [...new Set([state.left, state.right])];
    const [shown, keyed] = [both.filter((name) => layers[name].ramp), both.filter((name) => layers[name].key)];
    const groups = new Map();
    for (const name of shown) {
      const key = `${layers[name].range} ${layers[name].unit}`;
      groups.set(key, [...(groups.get(key) ?? []), name]);
    }
    scales.replaceChildren(...[...groups.values()].map((names) => make("div", {},
      make("div", { class: "scale name" }, make("span", {}, names.map((name) => layers[name].label).join(", ")), make("span", { class: "soft" }, layers[names[0]].unit)),
      colourBar(layers[names[0]]))), ...keyed.map((name) => evidenceKey(layers[name])));
    draw();
  }

  function set(side, name) {
    state[side] = name;
    pick[side].value = name;
    show();
  }

  /** Between two pixels of the refined depth, with its standard deviation. */
  function distance(...ends) {
    const camera = report.record.camera;
    const points = ends.map(([x, y]) => {
      const place = y * width + x, z = maps.refined[place];
      const [u, v] = [x, y].map((value, i) => ((value + 0.5) * report.full[i]) / report.size[i] - 0.5);
      const ray = [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1];
      return { z, ray, sigma: maps.sigma[place], at: ray.map((r) => r * z) };
    });
    if (!points.every(({ z, sigma }) => z > 0 && sigma > 0)) return "missing";
    const [a, b] = points;
    const line = a.at.map((value, i) => value - b.at[i]);
    const length = Math.hypot(...line);
    if (!(length > 0)) return `0${unit}`;
    // The scale's error moves the whole scene. The common error, which all predictions of a pixel share, counts as shared by both ends; what remains of sigma is each pixel's own.
    const common = report.common_error, whole = Math.hypot(common, report.scale_error ?? 0);
    const own = points.map(({ ray, z, sigma }) => {
      const along = ray.reduce((sum, r, i) => sum + r * line[i], 0) / length;
      return along * along * Math.max(0, sigma * sigma - (common * z) ** 2);
    });
    const sigma = Math.sqrt(own[0] + own[1] + (whole * length) ** 2);
    return `${number(length)}${NBSP}±${NBSP}${number(sigma, 2)}${unit}`;
  }

  /** The upper left corner to that point of the maps, as far as they reach. */
  function moveTo(x, y) {
    view.x = Math.max(0, Math.min(width - width / view.zoom, x));
    view.y = Math.max(0, Math.min(height - height / view.zoom, y));
    whole.disabled = view.zoom === 1;
    canvas.classList.toggle("zoomed", view.zoom > 1);
    draw();
  }

  /** Zooms about a point, given as shares of the picture's sides. */
  function zoomBy(factor, [u, v] = [0.5, 0.5]) {
    const [x, y] = [view.x + (u * width) / view.zoom, view.y + (v * height) / view.zoom];
    view.zoom = Math.max(1, Math.min(32, view.zoom * factor));
    moveTo(x - (u * width) / view.zoom, y - (v * height) / view.zoom);
  }

  function share(event) {
    const box = canvas.getBoundingClientRect();
    const part = (value, from, size) => Math.max(0, Math.min(1, (value - from) / size));
    return [part(event.clientX, box.left, box.width), part(event.clientY, box.top, box.height)];
  }

  function place(event) {
    const [u, v] = share(event);
    const at = [view.x + (u * width) / view.zoom, view.y + (v * height) / view.zoom];
    state.at = [Math.min(width - 1, Math.floor(at[0])), Math.min(height - 1, Math.floor(at[1]))];
    if (state.measure) {
      if (event.type === "pointerdown") state.ends = [...(state.ends.length === 2 ? [] : state.ends), [...state.at]];
    } else if (view.zoom === 1 && (event.buttons & 1 || event.type === "pointerdown")) {
      state.split = u;
      slider.value = String(Math.round(1000 * u));
    }
    read();
    draw();
  }

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, share(event));
    if (fingers.size === 1) place(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId), now = share(event);
    const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
    if (before && other) {
      const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]) || 1;
      zoomBy(apart(now) / apart(before), other);
    } else if (before && view.zoom > 1 && !state.measure) {
      moveTo(view.x + ((before[0] - now[0]) * width) / view.zoom, view.y + ((before[1] - now[1]) * height) / view.zoom);
    }
    if (before) fingers.set(event.pointerId, now);
    if (fingers.size < 2) place(event);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    // The wheel alone scrolls the page; a pinch on a touchpad comes with this key.
    if (!(event.ctrlKey || event.metaKey)) return;
    event.preventDefault();
    zoomBy(Math.exp(-event.deltaY / 200), share(event));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? 10 : 1;
    const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
    const move = moves[event.key];
    const at = state.at ?? [width >> 1, height >> 1];
    if (event.key === "Enter" && state.measure) {
      state.ends = [...(state.ends.length === 2 ? [] : state.ends), [...at]];
    } else if (move) {
      state.at = [Math.max(0, Math.min(width - 1, at[0] + move[0])), Math.max(0, Math.min(height - 1, at[1] + move[1]))];
    } else if (["+", "=", "-", "0"].includes(event.key)) {
      const factors = { "+": 1.5, "=": 1.5, "-": 1 / 1.5, 0: 0 };
      zoomBy(factors[event.key], [0, 1].map((i) => ((at[i] + 0.5 - [view.x, view.y][i]) * view.zoom) / report.size[i]));
    } else if (event.key === "PageUp" || event.key === "PageDown") {
      state.split = Math.max(0, Math.min(1, state.split + (event.key === "PageUp" ? -0.05 : 0.05)));
      slider.value = String(Math.round(1000 * state.split));
    } else {
      return;
    }
    event.preventDefault();
    read();
    draw();
  });

  const options = Object.entries(layers).map(([name, layer]) => [name, layer.label]);
  const pick = {
    left: choice(options, state.left, "Left map", (name) => set("left", name)),
    right: choice(options, state.right, "Right map", (name) => set("right", name)),
  };
  const edgeBox = (name, text) => {
    const box = make("input", {
      type: "checkbox", id: `edges-${name}`,
      onchange: () => { if (box.checked) state.edges.add(name); else state.edges.delete(name); draw(); },
    });
    const swatch = make("span", { class: "swatch" });
    swatch.style.background = EDGES[name];
    return make("label", {}, box, swatch, text);
  };

  const measure = make("button", {
    type: "button", id: "measure", "aria-pressed": "false",
    onclick: () => {
      [state.measure, state.ends] = [!state.measure, []];
      measure.setAttribute("aria-pressed", String(state.measure));
      read();
      draw();
    },
  }, "Measure a distance");

  const whole = make("button", { type: "button", id: "zoom-whole", disabled: true, onclick: () => zoomBy(0) }, "Whole");
  const root = make("div", { class: "split viewer" },
    make("div", {}, make("div", { class: "stage" }, canvas, tags.left, tags.right), slider),
    make("div", { class: "panel" },
      make("div", { class: "readout" }, readout),
      make("div", { class: "field" }, make("span", {}, "Left"), pick.left, make("span", {}, "Right"), pick.right),
      make("div", { class: "row" },
        make("button", { type: "button", id: "zoom-in", onclick: () => zoomBy(1.5), "aria-label": "Zoom into the maps" }, "+"),
        make("button", { type: "button", onclick: () => zoomBy(1 / 1.5), "aria-label": "Zoom out of the maps" }, "−"),
        whole, measure),
      make("div", { class: "row" }, edgeBox("prior", "edges of the prior"), edgeBox("refined", "edges of the refined")),
      scales));
  new ResizeObserver(draw).observe(canvas);
  read();
  show();
  return { root, set };
}

function bar(context, x, high, ratio) {
  context.fillStyle = "rgb(0 0 0 / 0.55)";
  context.fillRect(x - 2 * ratio, 0, 4 * ratio, high);
  context.fillStyle = "#fff";
  context.fillRect(x - ratio, 0, 2 * ratio, high);
  context.beginPath();
  context.arc(x, high / 2, 11 * ratio, 0, 2 * Math.PI);
  context.fill();
  context.fillStyle = "#333";
  for (const side of [-1, 1]) {
    context.beginPath();
    context.moveTo(x + side * 7 * ratio, high / 2);
    context.lineTo(x + side * 2.5 * ratio, high / 2 - 4.5 * ratio);
    context.lineTo(x + side * 2.5 * ratio, high / 2 + 4.5 * ratio);
    context.fill();
  }
}

/** The ends of a measured distance and the line between them. */
function ruler(context, ends, ratio) {
  if (ends.length === 0) return;
  for (const [colour, thick] of [["rgb(0 0 0 / 0.7)", 4.5], ["#ffd60a", 2]]) {
    context.strokeStyle = colour;
    context.lineWidth = thick * ratio;
    context.beginPath();
    ends.forEach(([x, y], index) => (index === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
    context.stroke();
    for (const [x, y] of ends) {
      context.beginPath();
      context.arc(x, y, 5 * ratio, 0, 2 * Math.PI);
      context.stroke();
    }
  }
}

function cross(context, x, y, ratio) {
  for (const [colour, thick] of [["rgb(0 0 0 / 0.7)", 3.5], ["#fff", 1.5]]) {
    context.strokeStyle = colour;
    context.lineWidth = thick * ratio;
    context.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + 4 * dx * ratio, y + 4 * dy * ratio);
      context.lineTo(x + 10 * dx * ratio, y + 10 * dy * ratio);
    }
    context.stroke();
  }
}
