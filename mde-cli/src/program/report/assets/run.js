// The page of one refinement.

async function runPage(page) {
  const { record } = report;
  const unit = record.unit === "unscaled" ? "" : ` ${record.unit}`;
  const scene = await runLayers();
  const { layers, maps } = scene;

  const { camera } = record, degrees = (360 / Math.PI) * Math.atan((0.5 * camera.width) / camera.fx);
  const [source, value] = typeof camera.source === "string" ? [camera.source] : Object.entries(camera.source)[0];
  const origin = { assumed: "assumed", estimated: `± ${percent(value)}, estimated with the poses`, exif: "from EXIF", file: "from its file", network: "the network's estimate", scene: "the scene's own" }[source] ?? "given";
  const about = [
    record.preset && `preset ${record.preset}`, record.seed !== undefined && `seed ${record.seed}`,
    `${report.full[0]} × ${report.full[1]} pixels`, record.unit === "unscaled" ? "depth without a unit" : `depth in ${record.unit}`,
    `focal length ${number(camera.fx)} px (${number(degrees)}°), ${origin}`, seconds(record.total_seconds), `mde ${record.versions["mde-cli"]}`,
  ].filter(Boolean);
  page.append(make("h1", {}, report.title), make("p", { class: "soft" }, about.join(" · ")), headline(record, maps, unit));
  const notes = warnings(record.warnings);
  if (notes) page.append(notes);

  const first = ["image", ...(record.prior?.source === "none" ? [] : ["prior"]), "refined", "relative"];
  page.append(make("div", { class: "first" }, first.map((name) => figureOf(layers[name], layers[name].label))));

  const compare = viewer(scene);
  const hint = "Drag in the image to move the border; point at a pixel to read its values. Ctrl with the wheel, two fingers, or plus and minus zoom; then drag to move the picture. Measured distances are of the refined depth; its common error counts as shared by both ends, their other errors as independent. ";
  section("Before and after", hint + report.prior_sigma, compare.root);
  if (record.capture) photographSection(scene);

  const here = new Set(report.files.map((file) => file.name));
  const fileOf = Object.fromEntries(Object.entries({ image: "image.png", prior: "prior.npy", refined: "depth.npy", relative: "sigma.npy", truth: "gt.npy", evidence: "evidence.npz" }).filter(([, name]) => here.has(name)));
  const gallery = make("div", { class: "gallery" }, Object.entries(layers).map(([name, layer]) => tile(name, layer, fileOf[name], () => {
    compare.set("right", name);
    document.getElementById("viewer").scrollIntoView({ block: "center" });
    document.getElementById("viewer").focus({ preventScroll: true });
  })));
  section("All maps", "Press a map to show it on the right above. Colours run from the 1st to the 99th percentile, of depths evenly in the inverse depth, of sigma / depth to 30 %; missing pixels are grey. In differences and errors, orange is farther, purple nearer. The files below the maps are in the folder of this page, and not in the page itself.", gallery,
    make("div", { class: "charts" }, histogram("Depth", layers.refined), histogram("Sigma / depth", layers.relative)));

  section("Point cloud", "Drag to turn, wheel or pinch to zoom; on the keyboard: arrows, plus, minus, 0 to reset.", cloud(scene));
  section("Stages", null, secondsTable(record));
  if (record.iterations.length > 0) section("Iterations", null, iterationTable(record.iterations, unit));
  const curves = trainingCharts(record.training ?? []);
  if (curves) section("Training", "Loss and PSNR of the rays of a batch, every few steps.", curves);
  if (record.scores) section("Scores against ground truth", scoreNote(record.scores), scoreTable(record.scores));
  section("Reproduce this run", null,
    make("p", { class: "small soft" }, "The command line and all settings."),
    copyable(record.command_line ?? `mde ${record.command}`, true),
    make("details", {}, make("summary", {}, "Settings (config.toml)"), copyable(report.config)),
    make("details", {}, make("summary", {}, "Record (run.json)"), make("pre", { tabindex: "0" }, JSON.stringify(record, null, 2))));
  section("Files", null, fileTable(report.files));
}

/** Rules of alignment, as a sentence has them. */
const RULES = {
  none: "nothing", "median-ratio": "the median of ratios", median: "the ratio of medians",
  "ls-depth": "least-squares scale and shift", "ls-disparity": "least-squares scale and shift of 1 / depth",
};

/** The most important numbers. */
function headline(record, maps, unit) {
  const moved = maps.refined.map((r, i) => (r > 0 && maps.prior[i] > 0 ? Math.abs(r / maps.prior[i] - 1) || 1e-9 : 0));
  const relative = maps.sigma.map((s, i) => (s > 0 && maps.refined[i] > 0 ? s / maps.refined[i] : 0));
  const [median, most] = quantiles(moved, [0.5, 0.9]);
  const last = record.iterations[record.iterations.length - 1];
  const changed = card(percent(median), `typical change of the depth (median); 90${NBSP}% of pixels changed by less than ${percent(most)}`);
  const cards = [
    ...(record.prior?.source === "none" ? [] : [changed]),
    card(`± ${number(quantiles(maps.sigma, [0.5])[0])}${unit}`, `median sigma: ${percent(quantiles(relative, [0.5])[0])} of the depth${assumed(record)}`),
  ];
  const scale = record.error_bar?.scale;
  if (scale) cards.push(card(`± ${percent(scale.relative, 3)}`, `all depths may be off by one common factor (${scale.by})`));
  const predictions = record.augmentation?.predictions ?? 1;
  if (predictions > 1) cards.push(card(String(predictions), planOf(record.augmentation)));
  if (last) cards.push(card(percent(last.fusion.nerf_weight), "weight of the field in the result; the rest is the prior"));
  const { capture } = record;
  if (capture && !capture.fallback) {
    const used = capture.photographs.filter((photograph) => photograph.used).length;
    const without = capture.poses === "estimated" ? ", without poses" : "";
    cards.push(card(String(used), `photographs used${without}; another one confirms the depth of ${percent(capture.confirmed ?? NaN)} of the pixels`));
    if (capture.novel?.psnr) cards.push(card(`${number(capture.novel.psnr)}${NBSP}dB`, `PSNR of a photograph ${capture.novel.withheld ? "withheld from" : "in"} the fit; ${number(capture.novel.psnr_of_prior)}${NBSP}dB by the prior's depth`));
  }
  if (last?.fit.psnr.length > 0) cards.push(card(`${number(last.fit.psnr[0])} dB`, "PSNR of the photograph as the field renders it; high values do not imply good depth"));
  const pair = record.scores?.by_alignment[record.scores.shown];
  if (pair) {
    const [before, after] = [pair.prior.abs_rel, pair.refined.abs_rel];
    cards.unshift(card(`${number(before)} → ${number(after)}`, `AbsRel against the truth: ${verdict(after / before - 1)} (aligned by ${RULES[record.scores.shown]})`));
  }
  return make("div", { class: "cards" }, cards);
}

/** What of sigma is not known of this network. */
function assumed(record) {
  const share = record.error_bar?.common_assumed;
  return share ? `; in it ${percent(share)} of the depth is FastDepth's error, assumed here: mde calibrate measures this network's` : "";
}

/** Which images the model predicted, and why so many. */
function planOf({ plan, reason, median_spread: spread }) {
  const levels = plan?.levels ?? [];
  const crops = levels.length > 0 ? `, crops of ${levels.map((n) => `${n} × ${n}`).join(", ")}` : "";
  const mirror = plan?.mirror ? ", each with its mirror image" : "";
  return `predictions of the model: the photograph${crops}${mirror}; their median spread ${percent(spread ?? NaN)}. ${reason ? `Why so many: ${reason}` : ""}`;
}

function verdict(change) {
  if (Math.abs(change) < 0.002) return "the same";
  return `${percent(Math.abs(change))} ${change < 0 ? "better" : "worse"}`;
}

function copyOf(layer) {
  const copy = make("canvas", { width: layer.canvas.width, height: layer.canvas.height, role: "img", "aria-label": layer.label });
  copy.getContext("2d").drawImage(layer.canvas, 0, 0);
  return copy;
}

function figureOf(layer, label) {
  const heading = make("div", { class: "scale name" }, make("b", {}, label), make("span", { class: "soft" }, layer.unit ?? ""));
  return make("figure", {}, copyOf(layer), make("figcaption", {}, heading, layer.ramp ? colourBar(layer) : null));
}

/** How many pixels have which value, within the range of the colours. */
function histogram(title, layer) {
  const bins = 48, [low, high] = layer.range;
  const counts = new Float64Array(bins);
  layer.values.forEach((value, place) => {
    const bin = Math.floor(((value - low) / (high - low || 1)) * bins);
    if (layer.known(place) && bin >= 0 && bin < bins) counts[bin] += 1;
  });
  const most = Math.max(1, ...counts);
  const svg = (tag, attributes, ...children) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.append(...children);
    return element;
  };
  const bars = [...counts].map((count, i) => svg("rect", { x: 10 * i, y: 90 - (90 * count) / most, width: 9, height: (90 * count) / most, fill: "var(--series-0)" }));
  const picture = svg("svg", { viewBox: "0 0 480 92", role: "img", "aria-label": `histogram of ${title}`, preserveAspectRatio: "none" }, ...bars);
  picture.style.height = "7rem";
  const ends = [low, (low + high) / 2, high].map((v) => make("span", {}, number(v)));
  return make("figure", { class: "chart histogram" }, make("div", { class: "scale name" }, make("b", {}, title), make("span", { class: "soft" }, `${layer.unit}, number of pixels`)),
    picture, make("div", { class: "scale" }, make("div", { class: "ends" }, ends)));
}

function tile(name, layer, file, pressed) {
  const copy = copyOf(layer);
  const heading = make("div", { class: "scale name" }, make("span", {}, layer.label), make("span", { class: "soft" }, layer.unit ?? ""));
  return make("figure", {},
    make("button", { type: "button", onclick: pressed, "aria-label": `Show ${layer.label} above`, "data-layer": name }, copy),
    make("figcaption", {}, heading, colourBar(layer), layer.key ? evidenceKey(layer, false) : null,
      file ? make("a", { class: "small", href: file, download: file }, file) : null));
}

/** `heads` are rows of headings. */
function table(heads, rows, name) {
  const cell = (tag, scope) => (text) => (text instanceof Node ? text : make(tag, scope ? { scope } : {}, text));
  return make("div", { class: "wide narrow", tabindex: "0", role: "region", "aria-label": name },
    make("table", {},
      make("thead", {}, heads.map((head) => make("tr", {}, head.map(cell("th", "col"))))),
      make("tbody", {}, rows.map((row) => make("tr", {}, make("th", { scope: "row" }, row[0]), row.slice(1).map(cell("td")))))));
}

/** A column for each iteration: there are few of them, and many numbers. */
function iterationTable(iterations, unit) {
  const name = unit.trim();
  const of = name && ` [${name}]`;
  const mean = (values) => values.reduce((sum, v) => sum + v, 0) / (values.length || NaN);
  const rows = [
    ["a, scale of the field's depth", ({ fusion }) => number(fusion.a, 4)],
    [`b, its shift${of}`, ({ fusion }) => number(fusion.b)],
    [`σₒ, error of the prior${of}`, ({ fusion }) => number(fusion.sigma_o)],
    ["weight of the field in the result", ({ fusion }) => percent(fusion.nerf_weight)],
    ["typical deviation of the field from the prior", (one) => percent(one.field_prior_deviation ?? NaN)],
    ["PSNR, original view [dB]", ({ fit }) => number(fit.psnr[0])],
    ["PSNR, mean of the views [dB]", ({ fit }) => number(mean(fit.psnr.filter((psnr) => psnr > 0)))],
    ["loss", ({ fit }) => number(fit.loss)],
    ["holes in the views", ({ warp }) => percent(warp.mean_hole_fraction)],
  ];
  const heads = [["", ...iterations.map((_, index) => `iteration ${index + 1}`)]];
  return table(heads, rows.map(([label, value]) => [label, ...iterations.map(value)]), "iterations");
}

/** Seconds of the stages in their order; with the rest, they sum to the whole. */
function secondsTable(record) {
  const several = record.capture && !record.capture.fallback ? record.capture.seconds : {};
  const own = (stage) => record.iterations.reduce((sum, one) => sum + one.seconds[stage], several[stage] ?? 0);
  const times = [
    ["prior", several.prior ?? record.augmentation?.seconds ?? 0], ["poses", several.poses ?? 0], ["sweeps and consensus", several.sweep ?? 0],
    ["synthetic views", own("warp")], ["fit of the field", own("fit")], ["rendering", own("render")], ["fusion", own("fuse")], ["scores", record.score_seconds],
  ];
  const known = times.reduce((sum, [, value]) => sum + value, 0);
  // Photographs of a capture share stages that the seconds of one do not have.
  const all = Math.max(known, record.total_seconds);
  const rows = [...times, ["the rest", all - known]].filter(([, value]) => value >= 0.005).map(([stage, value]) => [stage, fixed(value, 2)]);
  return table([["stage", "seconds"]], [...rows, ["all", fixed(all, 2)]], "seconds");
}

function trainingCharts(training) {
  const lines = (key) => training.map((curve, index) => ({ name: `iteration ${index + 1}`, points: curve.step.map((step, i) => [step, curve[key][i]]) })).filter((line) => line.points.length > 1);
  if (lines("psnr").length === 0) return null;
  return make("div", { class: "charts" },
    chart({ title: "PSNR", x: "step", y: "dB, higher is better", series: lines("psnr") }),
    chart({ title: "Loss", x: "step", y: "lower is better, logarithmic", series: lines("loss"), logarithmic: true }));
}

function scoreNote(scores) {
  return `Ground truth: ${scores.truth}. Each map is aligned to the truth by the rule of the heading. Changes of ${percent(0.01, 1)} or more are coloured; a single image is no evidence for a method.`;
}

function scoreTable(scores) {
  const rows = [
    ["AbsRel ↓", "abs_rel", -1], ["RMSE [m] ↓", "rmse", -1], ["MSE [m²] ↓", "mse", -1], ["within a factor 1.25 ↑", "delta1", 1],
    ["edge F1, 0.25 m, 1 px ↑", "f1@0.25m_r1", 1], ["boundary F1 ↑", "boundary_f1", 1], ["wrong order across edges (D3R) ↓", "d3r", -1],
    ["sharpness on edges ↑", "sharpness_on", 1], ["sharpness off edges ↓", "sharpness_off", -1], ["Spearman of sigma and error ↑", "spearman", 0],
    [`90${NBSP}% intervals hold`, "coverage_90", 0], ["mean z² (1: calibrated; above 1: sigma too small)", "mean_z2", 0],
  ];
  const names = [scores.shown, ...Object.keys(scores.by_alignment).filter((name) => name !== scores.shown)];
  const heads = [
    ["", ...names.map((name) => make("th", { scope: "colgroup", colspan: "2" }, name === "none" ? "no alignment" : `by ${RULES[name]}`))],
    ["", ...names.flatMap(() => ["prior", "refined"])],
  ];
  const body = rows.map(([label, key, better]) => [label.replace(/ (?=[↓↑]$)/, NBSP), ...names.flatMap((name) => {
    const [before, after] = [scores.by_alignment[name].prior[key], scores.by_alignment[name].refined[key]];
    const gain = better * (after - before);
    const mark = better !== 0 && Math.abs(after / before - 1) >= 0.01 ? (gain > 0 ? "good" : "bad") : null;
    return [number(before), make("td", { class: mark }, number(after))];
  })]).filter((row) => row.slice(1).some((cell) => (cell.textContent ?? cell) !== "–"));
  return table(heads, body, "scores");
}

function fileTable(files) {
  const rows = files.map((file) => make("tr", {},
    make("td", {}, make("a", { href: file.name }, make("code", {}, file.name))), make("td", { class: "soft" }, file.what), make("td", { class: "soft" }, file.bytes ? bytes(file.bytes) : file.folder ? "folder" : "")));
  return make("div", { class: "wide files" }, make("table", {}, make("tbody", {}, rows)));
}
