// The maps as numbers and as pictures.

/** The values of an embedded map: deflated differences of 16 bits, evenly spaced in the logarithm; 0 = missing. */
async function decodeMap(map, [width, height]) {
  const stream = new Blob([bytesOf(map.data)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const packed = new Uint8Array(await new Response(stream).arrayBuffer());
  const count = width * height;
  const values = new Float32Array(count);
  const table = new Float32Array(map.steps + 2);
  for (let step = 1; step < table.length; step += 1) {
    table[step] = Math.exp(map.low + ((step - 1) / map.steps) * (map.high - map.low));
  }
  for (let place = 0, left = 0; place < count; place += 1) {
    if (place % width === 0) left = 0;
    left = (left + packed[place] + 256 * packed[count + place]) & 65535;
    values[place] = table[left];
  }
  return values;
}

async function decodePicture(address, [width, height]) {
  const image = new Image();
  image.src = address;
  await image.decode();
  const canvas = make("canvas", { width, height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0, width, height);
  return { canvas, pixels: context.getImageData(0, 0, width, height).data };
}

/** `shade(value, low, high)` gives a little-endian RGBA word, `middle` the value of the middle colour; depths are even in their inverse. */
function ramp(name) {
  const of = name === "depth" ? (value) => -1 / value : (value) => value;
  const table = bytesOf(report.gradients[name]);
  const words = new Uint32Array(256);
  for (let i = 0; i < 256; i += 1) {
    words[i] = (255 << 24) | (table[3 * i + 2] << 16) | (table[3 * i + 1] << 8) | table[3 * i];
  }
  const shade = (value, low, high) => {
    const share = high > low ? (of(value) - of(low)) / (of(high) - of(low)) : 0.5;
    return words[Math.max(0, Math.min(255, Math.round(share * 255)))];
  };
  const css = () => {
    const stops = [];
    for (let i = 0; i < 256; i += 15) stops.push(`rgb(${table[3 * i]} ${table[3 * i + 1]} ${table[3 * i + 2]})`);
    return `linear-gradient(to right, ${stops.join(", ")})`;
  };
  // Both functions are their own inverse.
  return { shade, css, middle: (low, high) => of((of(low) + of(high)) / 2) };
}

const MISSING = (255 << 24) | (128 << 16) | (128 << 8) | 128;

/** A map as a canvas of its own size. */
function paint(layer, [width, height]) {
  const canvas = make("canvas", { width, height });
  const context = canvas.getContext("2d");
  const picture = context.createImageData(width, height);
  const words = new Uint32Array(picture.data.buffer);
  const [low, high] = layer.range;
  for (let place = 0; place < words.length; place += 1) {
    const value = layer.values[place];
    words[place] = layer.known(place) ? layer.ramp.shade(value, low, high) : MISSING;
  }
  context.putImageData(picture, 0, 0);
  return canvas;
}

/** A colour bar with its unit, or nothing for a photograph. */
function colourBar(layer) {
  if (!layer.ramp) return null;
  const [low, high] = layer.range;
  const bar = make("span", { class: "bar", role: "img", "aria-label": `colours from ${number(low)} to ${number(high)}` });
  bar.style.background = layer.ramp.css();
  const ends = [low, layer.ramp.middle(low, high), high].map((v) => make("span", {}, layer.signed ? signed(v) : number(v)));
  return make("div", { class: "scale" }, bar, make("div", { class: "ends" }, ends));
}

/** Every layer of a run by its name, in the order of the page. */
async function runLayers() {
  const size = report.size;
  const unit = report.record.unit === "unscaled" ? "no unit" : report.record.unit;
  const names = Object.keys(report.maps);
  const decoded = await Promise.all(names.map((name) => decodeMap(report.maps[name], size)));
  const maps = Object.fromEntries(names.map((name, i) => [name, decoded[i]]));
  const photo = await decodePicture(report.image, size);
  const spectral = ramp("depth"), magma = ramp("magma"), diverging = ramp("diverging");
  const { prior, refined, sigma } = maps;
  maps.prior_sigma = prior.map((d) => (d > 0 ? Math.hypot(report.prior_error[0], report.prior_error[1] * d) : 0));
  const both = prior.map((p, i) => (p > 0 && refined[i] > 0 ? 1 : 0));
  const compared = [prior, refined, ...(maps.truth && unit === "m" ? [maps.truth] : [])];
  const ends = compared.map((values) => quantiles(values, [0.01, 0.99])).filter(([low]) => low > 0);
  const depths = [Math.min(...ends.map(([low]) => low)), Math.max(...ends.map(([, high]) => high))];
  const positive = (values) => (place) => values[place] > 0;
  const difference = refined.map((r, i) => (both[i] ? r - prior[i] : 0));
  // Differences below a thousandth of the depth do not get full colours.
  const largest = Math.max(quantiles(difference.map(Math.abs), [0.99])[0] || 0, 0.001 * depths[1]) || 1;
  const relative = sigma.map((s, i) => (s > 0 && refined[i] > 0 ? (100 * s) / refined[i] : 0));

  maps.relative = relative;
  const layers = {
    image: { label: "Photograph", canvas: photo.canvas, smooth: true },
    prior: { label: "Prior", values: prior, ramp: spectral, range: depths, unit, known: positive(prior) },
    refined: { label: "Refined", values: refined, ramp: spectral, range: depths, unit, known: positive(refined) },
    relative: { label: "Sigma / depth", values: relative, ramp: magma, range: [0, 30], unit: "%", known: positive(relative) },
    difference: { label: "Refined − prior", values: difference, ramp: diverging, range: [-largest, largest], unit, signed: true, known: (place) => both[place] === 1 },
  };
  if (maps.truth) {
    layers.truth = { label: "Truth", values: maps.truth, ramp: spectral, range: unit === "m" ? depths : quantiles(maps.truth, [0.01, 0.99]), unit: "m", known: positive(maps.truth) };
  }
  const alignment = report.record.scores?.by_alignment[report.record.scores.shown];
  if (maps.truth && alignment) {
    const errors = (name) => maps[name].map((d, i) => (d > 0 && maps.truth[i] > 0 ? align(d, alignment[name].alignment) - maps.truth[i] : 0));
    const known = (name) => (place) => maps[name][place] > 0 && maps.truth[place] > 0;
    for (const name of ["prior", "refined"]) maps[`error_${name}`] = errors(name);
    const worst = quantiles(maps.error_prior.map(Math.abs), [0.98])[0] || 1e-6;
    layers.error_prior = { label: "Error of the prior", values: maps.error_prior, ramp: diverging, range: [-worst, worst], unit: "m", signed: true, known: known("prior") };
    layers.error_refined = { label: "Error of the refined", values: maps.error_refined, ramp: diverging, range: [-worst, worst], unit: "m", signed: true, known: known("refined") };
  }
  if (maps.evidence) {
    maps.evidence = maps.evidence.map(Math.round);
    layers.evidence = evidenceLayer(maps.evidence, size);
  }
  for (const layer of Object.values(layers)) {
    if (layer.values && !layer.range.every(Number.isFinite)) layer.range = [0, 1];
    layer.canvas ??= paint(layer, size);
  }
  return { layers, maps, photo: photo.pixels };
}

/** A depth on the truth's scale. */
function align(depth, { space, scale, shift, floor }) {
  return space === "disparity" ? 1 / Math.max(scale / depth + shift, floor) : scale * depth + shift;
}
