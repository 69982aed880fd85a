// The depth as points or as a surface, drawn with a depth buffer on a plain canvas, without WebGL.

/** A surface is torn where the disparities of neighbours differ by more than this share, as in the exported mesh. */
const TEAR = 0.05;

function cloud({ layers, maps, photo }) {
  const [width, height] = report.size;
  const camera = report.record.camera;
  const shrink = width / report.full[0];
  const focal = [camera.fx * shrink, camera.fy * (height / report.full[1])];
  const middle = [(camera.cx + 0.5) * shrink - 0.5, (camera.cy + 0.5) * (height / report.full[1]) - 0.5];
  const count = width * height;
  const photoWords = new Uint32Array(photo.buffer.slice(0));
  const colours = {
    photo: photoWords,
    relative: Uint32Array.from(maps.relative, (s) => layers.relative.ramp.shade(s, ...layers.relative.range)),
    depth: Uint32Array.from(maps.refined, (d) => layers.refined.ramp.shade(d, ...layers.refined.range)),
  };
  const sorted = Float32Array.from(maps.relative.filter((s) => s > 0)).sort();
  const start = { turn: 0.26, tilt: 0.12, zoom: 0.9 };
  const state = { ...start, colour: "photo", source: "refined", most: 0, surface: false };
  const points = {};

  /** x, y, z of every pixel of a map; z = 0 where it is missing. */
  function build(name) {
    const values = maps[name];
    const xyz = new Float32Array(3 * count);
    for (let place = 0; place < count; place += 1) {
      const z = values[place];
      xyz[3 * place] = (((place % width) - middle[0]) / focal[0]) * z;
      xyz[3 * place + 1] = ((Math.floor(place / width) - middle[1]) / focal[1]) * z;
      xyz[3 * place + 2] = z;
    }
    // The median keeps one far pixel from moving the pivot.
    return { xyz, pivot: quantiles(values, [0.5])[0] };
  }

  const canvas = make("canvas", {
    id: "cloud", tabindex: "0", role: "img",
    "aria-label": "The depth in space; arrow keys turn it, plus and minus zoom, 0 resets",
  });
  const context = canvas.getContext("2d");
  const shown = make("span", { class: "soft small", id: "cloud-count" });
  let picture = null, words = null, buffer = null;
  /** Place on the canvas and distance of each pixel; distance 0 where there is none. */
  const screen = new Float32Array(3 * count);

  const draw = oncePerFrame(() => {
    const wide = Math.max(64, Math.min(1000, Math.round((canvas.clientWidth || 640) * Math.min(devicePixelRatio || 1, 1.5))));
    const high = Math.round(wide * Math.min(0.75, Math.max(0.56, height / width)));
    if (!picture || picture.width !== wide || picture.height !== high) {
      canvas.width = wide;
      canvas.height = high;
      picture = context.createImageData(wide, high);
      words = new Uint32Array(picture.data.buffer);
      buffer = new Float32Array(wide * high);
    }
    words.fill(0);
    buffer.fill(Infinity);
    points[state.source] ??= build(state.source);
    const reach = project(points[state.source], wide, high);
    if (state.surface) triangles(maps[state.source], wide, high);
    else splat(reach, wide, high);
    context.putImageData(picture, 0, 0);
  });

  /** Fills `screen`; gives the side of a point times its distance over its depth. */
  function project({ xyz, pivot }, wide, high) {
    const [ct, st, cp, sp] = [Math.cos(state.turn), Math.sin(state.turn), Math.cos(state.tilt), Math.sin(state.tilt)];
    // At zoom 1 and no turn this is the photograph's own view.
    const lens = Math.min((wide / width) * focal[0], (high / height) * focal[1]) * 0.92;
    const back = pivot / state.zoom;
    const nearest = 0.02 * pivot;
    const unsure = maps.relative;
    let drawn = 0, all = 0;
    screen.fill(0);
    for (let place = 0; place < count; place += 1) {
      const z0 = xyz[3 * place + 2];
      if (!(z0 > 0)) continue;
      all += 1;
      if (!(unsure[place] <= state.most)) continue;
      drawn += 1;
      const x0 = xyz[3 * place], y0 = xyz[3 * place + 1], d = z0 - pivot;
      const x = ct * x0 + st * d, far = -st * x0 + ct * d;
      const y = cp * y0 - sp * far, z = sp * y0 + cp * far + back;
      if (z < nearest) continue;
      screen[3 * place] = wide / 2 + (lens * x) / z;
      screen[3 * place + 1] = high / 2 + (lens * y) / z;
      screen[3 * place + 2] = z;
    }
    shown.textContent = `${drawn.toLocaleString("en")} of ${all.toLocaleString("en")} points${drawn === 0 ? "; none is left: move the slider, or choose another depth" : ""}`;
    return (1.6 * lens) / focal[0];
  }

  function splat(reach, wide, high) {
    const colour = colours[state.colour], depths = maps[state.source];
    for (let place = 0; place < count; place += 1) {
      const z = screen[3 * place + 2];
      if (z === 0) continue;
      const size = Math.max(1, Math.min(5, Math.ceil((reach * depths[place]) / z)));
      const left = Math.round(screen[3 * place] - size / 2), top = Math.round(screen[3 * place + 1] - size / 2);
      if (left < 0 || top < 0 || left + size > wide || top + size > high) continue;
      for (let row = top; row < top + size; row += 1) {
        for (let at = row * wide + left, end = at + size; at < end; at += 1) {
          if (z < buffer[at]) { buffer[at] = z; words[at] = colour[place]; }
        }
      }
    }
  }

  /** Two triangles between four neighbours. */
  function triangles(depths, wide, high) {
    const colour = colours[state.colour];
    const tear = TEAR * Math.max(1, report.full[0] / width);
    for (let row = 0; row + 1 < height; row += 1) {
      for (let place = row * width, end = place + width - 1; place < end; place += 1) {
        fill(place, place + width, place + 1);
        fill(place + 1, place + width, place + width + 1);
      }
    }

    function fill(a, b, c) {
      const near = Math.min(depths[a], depths[b], depths[c]), far = Math.max(depths[a], depths[b], depths[c]);
      if (1 - near / far <= tear) fillTriangle({ words, buffer, wide, high }, screen, [a, b, c], colour);
    }
  }

  function turn(dx, dy) {
    state.turn = Math.max(-1.5, Math.min(1.5, state.turn + dx));
    state.tilt = Math.max(-1.3, Math.min(1.3, state.tilt + dy));
    draw();
  }
  function zoom(factor) {
    state.zoom = Math.max(0.2, Math.min(12, state.zoom * factor));
    draw();
  }

  function reset() {
    Object.assign(state, start);
    draw();
  }

  orbit(canvas, { turn, zoom, reset });

  const most = make("output", { id: "cloud-most" });
  const threshold = make("input", {
    id: "cloud-sigma", type: "range", min: "0", max: "100", value: "80", "aria-label": "Hide points above this sigma / depth",
    oninput: limit,
  });
  function limit() {
    const share = threshold.value / 100;
    state.most = share >= 1 || sorted.length === 0 ? Infinity : share === 0 ? 0 : sorted[Math.round(share * (sorted.length - 1))];
    most.textContent = Number.isFinite(state.most) ? `σ / depth ≤ ${number(state.most, 2)}${NBSP}%` : "all";
    draw();
  }

  const sources = [["refined", "Refined"], ["prior", "Prior"]];
  if (maps.truth) sources.push(["truth", "Truth"]);
  const root = make("div", { class: "split cloud" },
    make("div", { class: "stage" }, canvas),
    make("div", { class: "panel" },
      make("div", { class: "field" },
        make("span", {}, "Depth"), choice(sources, state.source, "Which depth", (name) => { state.source = name; draw(); }),
        make("span", {}, "Colour"), choice([["photo", "Photograph"], ["relative", "Sigma / depth"], ["depth", "Refined depth"]], state.colour, "Colour of the points", (name) => { state.colour = name; draw(); }),
        make("span", {}, "Drawn as"), choice([["points", "Points"], ["surface", "Surface"]], "points", "Points or a surface", (name) => { state.surface = name === "surface"; draw(); })),
      make("div", {},
        make("div", { class: "scale name" }, make("span", {}, "Hide what is less sure"), most),
        threshold),
      colourBarFor(layers.relative, "Sigma / depth"),
      make("div", { class: "row" },
        make("button", { type: "button", onclick: () => zoom(1.25), "aria-label": "Zoom in" }, "+"),
        make("button", { type: "button", onclick: () => zoom(0.8), "aria-label": "Zoom out" }, "−"),
        make("button", { type: "button", onclick: () => { Object.assign(state, { turn: 0, tilt: 0, zoom: 1 }); draw(); } }, "Photograph's view"),
        make("button", { type: "button", onclick: reset }, "Reset")),
      shown));
  new ResizeObserver(draw).observe(canvas);
  limit();
  return root;
}

function colourBarFor(layer, name) {
  return make("div", {},
    make("div", { class: "scale name" }, make("span", {}, name), make("span", { class: "soft" }, layer.unit)), colourBar(layer));
}
