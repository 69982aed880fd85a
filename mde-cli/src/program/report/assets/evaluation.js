// The page of an evaluation.

function evaluationPage(page) {
  const { summary: all } = report;
  const { summary } = all;
  // Methods with a depth of their own; the tables have trivial sigmas too.
  const count = methodsOf(summary, report.groups[0]).length;
  page.append(make("h1", {}, report.title),
    make("p", { class: "soft" }, `${summary.scenes} scene${summary.scenes === 1 ? "" : "s"} · ${count} method${count === 1 ? "" : "s"} · mde ${all.versions["mde-cli"]}`),
    make("p", {}, all.alignment));
  if (all.verdict?.length > 0) page.append(make("ul", { id: "verdict" }, all.verdict.map((line) => make("li", {}, line))));
  const failed = (all.failures ?? []).map((f) => `failed: ${f.scene}, ${f.method ?? "all methods"}: ${f.error}`);
  const notes = warnings([...failed, ...(all.warnings ?? [])]);
  if (notes) page.append(notes);
  if (summary.scenes < 6) {
    page.append(make("p", { class: "soft small" }, `With ${summary.scenes} scene${summary.scenes === 1 ? "" : "s"} intervals are little more than the range of a few numbers, so nothing is marked.`));
  }
  section("Scores", null, scores(summary));
  if (report.figures.length > 0) {
    section("Uncertainty", null, make("div", { class: "figures" }, report.figures.map((figure) =>
      make("figure", {},
        make("div", { class: "picture", tabindex: "0", role: "region", "aria-label": `figure: ${figure.what}` }, make("img", { src: figure.image, alt: figure.what, width: "900", height: "560" })),
        make("figcaption", {}, figure.what)))));
  }
  section("Scenes", null, sceneList());
  section("Reproduce this run", null,
    all.command_line ? copyable(all.command_line, true) : null,
    make("details", {}, make("summary", {}, "Inputs, versions and settings (summary.json)"), make("pre", { tabindex: "0" }, JSON.stringify({ made_from: all.made_from, versions: all.versions, bootstrap: summary.bootstrap }, null, 2))),
    make("p", { class: "small soft" }, "Beside this page: table.md, summary.json (every metric), scenes.csv (every scene), the figures as SVG."));
}

/** Intervals over fewer scenes than this are not marked. */
const ENOUGH = 6;
const ARROW = { lower: " ↓", higher: " ↑", neither: "" };

function scores(summary) {
  const root = make("div", {});
  const groups = report.groups.filter((title) => columnsOf(summary, title).length > 0);
  const state = { group: groups[0], view: summary.reference ? "difference" : "mean", sort: null, up: true };
  const place = make("div", {});
  const show = () => place.replaceChildren(scoreNoteOf(summary, state), sortable(summary, state, show));
  root.append(make("div", { class: "row" },
    make("div", {}, choice(groups.map((title) => [title, title]), state.group, "Which scores", (title) => { state.group = title; state.sort = null; show(); })),
    summary.reference ? make("div", {}, choice(
      [["difference", `Means, and difference to ${summary.reference}`], ["ratio", `Means, and ratio to ${summary.reference}`], ["mean", "Means and ranks"]],
      state.view, "What is shown", (view) => { state.view = view; show(); })) : null), place);
  show();
  return root;
}

function columnsOf(summary, title) {
  return report.metrics.filter((metric) => metric.group === title && metric.shown && summary.methods.some((m) => metric.key in m.metrics));
}

function methodsOf(summary, title) {
  const metrics = columnsOf(summary, title);
  return summary.methods.filter((method) => metrics.some((metric) => metric.key in method.metrics));
}

function scoreNoteOf(summary, state) {
  const level = `${100 * summary.bootstrap.level} %`;
  const sample = summary.places < summary.scenes ? "places" : "scenes";
  const text = {
    difference: `Mean over scenes; below it the paired difference to ${summary.reference} with its ${level} interval over resampled ${sample}.`,
    ratio: `Mean over scenes; below it the ratio of means to ${summary.reference}'s with its ${level} interval over resampled ${sample}.`,
    mean: "Mean over scenes; below it the mean rank among the methods, 1 the best.",
  }[state.view];
  return make("p", { class: "soft small" }, `${text} Press a heading to sort by it.`);
}

function sortable(summary, state, show) {
  const metrics = columnsOf(summary, state.group);
  const methods = methodsOf(summary, state.group);
  if (state.sort !== null) {
    const value = (method) => (state.sort === "method" ? method.method : method.metrics[state.sort]?.mean);
    methods.sort((a, b) => {
      const [u, v] = [value(a), value(b)];
      if (u === undefined || v === undefined) return (u === undefined) - (v === undefined);
      return (u < v ? -1 : u > v ? 1 : 0) * (state.up ? 1 : -1);
    });
  }
  const heading = (key, text, better) => {
    const sorted = state.sort === key ? (state.up ? "ascending" : "descending") : "none";
    const press = () => {
      [state.up, state.sort] = [state.sort === key ? !state.up : better !== "higher", key];
      show();
      document.querySelector(`button[data-key="${key}"]`)?.focus();
    };
    return make("th", { scope: "col", "aria-sort": sorted }, make("button", { type: "button", "data-key": key, onclick: press }, text));
  };
  const head = [heading("method", "method", "lower"), ...metrics.map((m) => heading(m.key, m.label + (m.better === "near" ? ` → ${m.target}` : ARROW[m.better]), m.better))];
  const rows = methods.map((method) => make("tr", { class: method.method === summary.reference ? "reference" : null },
    make("th", { scope: "row" }, method.method), metrics.map((metric) => scoreCell(metric, method.metrics[metric.key], state.view, method.method === summary.reference))));
  return make("div", { class: "wide", tabindex: "0", role: "region", "aria-label": `${state.group}, a table that scrolls sideways` },
    make("table", { id: "scores" }, make("thead", {}, make("tr", {}, head)), make("tbody", {}, rows)));
}

function scoreCell(metric, statistics, view, isReference) {
  if (!statistics) return make("td", { class: "soft" }, "–");
  const cell = make("td", {}, number(statistics.mean));
  if (view === "mean") {
    if (statistics.rank !== null && statistics.rank !== undefined) cell.append(make("span", { class: "interval" }, `rank ${statistics.rank.toFixed(1)}`));
    return cell;
  }
  const estimate = statistics[view];
  if (!estimate || isReference) return cell;
  // As many decimals as the mean, and one more.
  const decimals = Math.min(6, (number(statistics.mean).split(".")[1] ?? "").length + 1);
  const show = view === "ratio" ? (v) => `×${fixed(v, 3, false)}` : (v) => fixed(v, decimals, true);
  const nothing = view === "ratio" ? 1 : 0;
  const outside = estimate.low > nothing || estimate.high < nothing;
  const better = { lower: -1, higher: 1 }[metric.better] ?? 0;
  const mark = outside && statistics.places >= ENOUGH && better !== 0 ? (better * (estimate.value - nothing) > 0 ? "good" : "bad") : "";
  cell.append(make("span", { class: "interval" }, make("span", { class: mark }, show(estimate.value)), ` [${show(estimate.low)}, ${show(estimate.high)}]`));
  return cell;
}

/** The colours of a scene's thumbnails; nothing where no method states a sigma. */
function thumbnailScale(name, colours, range) {
  if (!(range[1] > 0)) return null;
  return make("div", { class: "key" }, make("div", { class: "scale name" }, make("span", {}, name), make("span", { class: "soft" }, "prior's unit")), colourBar({ ramp: ramp(colours), range }));
}

function sceneList() {
  const root = make("div", {});
  // By the first method after the prior, where there is one.
  const { method: judged, metric: key } = report.judged ?? {};
  const metric = report.metrics.find((m) => m.key === key);
  const label = metric ? `${metric.label}: ` : "";
  root.append(make("p", { class: "soft small" }, "Depth of each method in the colours of the prior's range; below it its sigma, if it has one."));
  const without = [];
  const badness = (scene) => (scene.scores[judged]?.[metric?.key] ?? NaN) * (metric?.better === "higher" ? -1 : 1);
  const list = make("div", { id: "scene-list" });
  const order = make("input", { type: "checkbox", id: "worst-first", onchange: arrange });
  if (metric && judged && report.scenes.length > 1) {
    root.append(make("label", { class: "row" }, order, `worst scenes first, by ${metric.label} of ${judged}`));
  }
  const blocks = [];
  function arrange() {
    const sorted = order.checked ? [...blocks].sort((a, b) => b.bad - a.bad) : blocks;
    list.replaceChildren(...sorted.map(({ block }) => block));
  }
  for (const scene of report.scenes) {
    if (!scene.thumbnails) { without.push(scene.id); continue; }
    const figure = (title, more, ...images) => make("figure", {}, images, make("figcaption", {}, make("b", {}, title), more ? make("span", { class: "soft" }, ` ${more}`) : null));
    const picture = (address, alt) => (address ? make("img", { src: address, alt }) : null);
    const tiles = scene.thumbnails.maps.map((map) => {
      const score = metric ? scene.scores[map.method]?.[metric.key] : undefined;
      return figure(map.method, score === undefined ? null : label + number(score), picture(map.depth, `depth of ${map.method}`), picture(map.sigma, `sigma of ${map.method}`));
    });
    const photo = scene.thumbnails.image ? figure("picture", null, picture(scene.thumbnails.image, `picture of ${scene.id}`)) : null;
    const block = make("div", { class: "scene" }, make("div", { class: "row head" }, make("h3", {}, scene.id), thumbnailScale("depth", "depth", scene.thumbnails.depths), thumbnailScale("sigma", "magma", scene.thumbnails.sigmas)), make("div", { class: "strip", tabindex: "0", role: "region", "aria-label": `maps of ${scene.id}` }, photo, tiles));
    const bad = badness(scene);
    blocks.push({ block, bad: Number.isFinite(bad) ? bad : -Infinity });
  }
  root.append(list);
  arrange();
  if (without.length > 0) {
    const why = without.length === report.scenes.length ? "The maps are not in this folder" : `No thumbnails, which the worst ${report.thumbnails_of} scenes have`;
    root.append(make("p", { class: "soft small" }, `${why}: ${without.join(", ")}.`));
  }
  return root;
}
