// Several photographs: which were used, where each pixel's depth comes from, and what the field renders.

/** Codes of the embedded map: 0 missing, 1 seen by no other photograph, 2 confirmed by none, 2 + n confirmed by n. */
const UNSEEN = 1, UNCONFIRMED = 2;

function evidenceColours(most) {
  const [from, to] = [[198, 219, 239], [8, 61, 132]];
  const colours = [[128, 128, 128], [94, 60, 153], [230, 127, 26]];
  for (let n = 1; n <= Math.max(most, 1); n += 1) {
    const share = most > 1 ? (n - 1) / (most - 1) : 1;
    colours.push(from.map((v, c) => Math.round(v + share * (to[c] - v))));
  }
  return colours;
}

function evidenceName(code) {
  if (code === 0) return "no depth";
  if (code === UNSEEN) return "in no other photograph";
  if (code === UNCONFIRMED) return "confirmed by none";
  const count = code - UNCONFIRMED;
  return `confirmed by ${count}`;
}

/** A layer of the viewer: colours for codes. */
function evidenceLayer(codes, [width, height]) {
  const colours = evidenceColours(codes.reduce((most, code) => Math.max(most, code), 0) - UNCONFIRMED);
  const canvas = make("canvas", { width, height });
  const context = canvas.getContext("2d");
  const picture = context.createImageData(width, height);
  const counts = new Array(colours.length).fill(0);
  codes.forEach((code, place) => {
    picture.data.set([...colours[code], 255], 4 * place);
    counts[code] += 1;
  });
  context.putImageData(picture, 0, 0);
  const key = counts.map((count, code) => ({ code, share: count / codes.length, colour: `rgb(${colours[code].join(" ")})` }));
  return { label: "Evidence", canvas, key: key.filter(({ share }) => share > 0) };
}

/** What the colours of the evidence mean; shares of the pixels with `shares`. */
function evidenceKey(layer, shares = true) {
  return make("ul", { class: "key-list small" }, layer.key.map(({ code, share, colour }) => {
    const swatch = make("span", { class: "swatch" });
    swatch.style.background = colour;
    return make("li", {}, swatch, ` ${evidenceName(code)}`, shares ? make("span", { class: "soft" }, ` ${share < 0.001 ? `< 0.1${NBSP}%` : percent(share)}`) : null);
  }));
}

const POSES = {
  given: "Their poses are those of the capture: a refinement on matches did not explain withheld matches better.",
  refined: "Their poses are those of the capture, refined on matches.",
  estimated: "They came without poses: these were estimated from matches between the photographs and the prior's depth.",
};

function photographSection({ layers }) {
  const { capture } = report.record;
  const used = capture.photographs.filter((photograph) => photograph.used).length;
  const about = [`${used} of ${capture.photographs.length} photographs were used.`, POSES[capture.poses]];
  about.push("Parallax is the distance from the reference over the depth, overlap the share of the reference's pixels, verified the share of the photograph's own pixels that another confirms, exposure the factor to the reference's colours.");
  if (capture.withheld_pixels) {
    about.push(`Withheld matches are off by ${number(capture.withheld_pixels[0], 2)} pixels with the given poses, ${number(capture.withheld_pixels[1], 2)} with the refined (at 640 pixels).`);
  }
  if (capture.focal_factor && Math.abs(capture.focal_factor - 1) > 1e-9) about.push(`The matches multiplied the assumed focal length by ${number(capture.focal_factor)}.`);
  const held = capture.withheld_colours;
  if (held) about.push(`A check: moved to ${held.name} with the depth of the others, their colours are ${percent(held.found)} off; with the prior's, ${percent(held.prior)}.`);
  if (capture.fallback) about.push(`The photograph was refined alone: ${capture.fallback}.`);
  // Of a long capture those that were used or have no pose.
  const shown = (photograph) => capture.photographs.length <= 32 || photograph.used || photograph.verdict !== "has a pose";
  const tiles = capture.photographs.map((photograph, index) => shown(photograph) ? photographTile(photograph, index) : null);
  section("Photographs", about.join(" "), make("div", { class: "gallery photographs" }, tiles));
  if (layers.evidence) {
    const { origin } = report;
    const shares = [["the radiance field", origin.field], ["the consensus of the sweeps", origin.consensus], ["the prior alone", origin.prior]]
      .filter(([, share]) => share > 0).map(([name, share]) => `from ${name} (${percent(share)} of the pixels)`);
    const text = `The depth comes ${shares.join(", ")}. A photograph confirms a pixel where its own depth, found without the field, agrees there and back within a pixel and 10${NBSP}%.`;
    const canvas = make("canvas", { width: report.size[0], height: report.size[1], role: "img", "aria-label": "Number of photographs that confirm each pixel" });
    canvas.getContext("2d").drawImage(layers.evidence.canvas, 0, 0);
    section("Where the depth comes from", text, make("div", { class: "split" }, make("div", { class: "stage" }, canvas), evidenceKey(layers.evidence)));
  }
  if (report.novel) novelSection(capture);
}

function photographTile(photograph, index) {
  const novel = report.record.capture.novel;
  const reference = index === report.reference;
  const tag = reference ? "reference" : photograph.used ? "used" : novel?.withheld && novel.photograph === index ? "withheld" : "not used";
  const rows = [];
  const row = (name, value) => rows.push(make("dt", {}, name), make("dd", {}, value));
  if (!reference && photograph.verdict !== "has a pose") row("verdict", photograph.verdict);
  if (photograph.parallax !== null) row("parallax", percent(photograph.parallax, 3));
  if (photograph.rotation_degrees !== null) row("rotation", `${number(photograph.rotation_degrees, 2)}°`);
  if (photograph.overlap !== null) row("overlap", percent(photograph.overlap));
  if (photograph.verified !== null) row("verified", percent(photograph.verified));
  if (photograph.exposure) {
    const gain = photograph.exposure.gain.reduce((sum, v) => sum + v, 0) / 3;
    row("exposure", `× ${number(gain, 3)}`);
  }
  const image = report.photographs[index];
  return make("figure", {},
    image ? make("img", { src: image, alt: `Photograph ${photograph.name}` }) : null,
    make("figcaption", {},
      make("div", { class: "scale name" }, make("b", {}, photograph.name), make("span", { class: `chip ${tag.replace(" ", "-")}` }, tag)),
      make("dl", { class: "facts" }, rows)));
}

function novelSection(capture) {
  const { novel, photographs } = capture;
  const name = photographs[novel.photograph]?.name ?? "";
  const share = ` on the ${percent(novel.compared)} of its pixels that the field and the moved reference both reach`;
  const scores = Number.isFinite(novel.psnr) && novel.psnr !== null
    ? `PSNR ${number(novel.psnr)}${NBSP}dB, where the reference moved there by the prior's depth has ${number(novel.psnr_of_prior)}${NBSP}dB,${share}.`
    : `The field and the moved reference both reach ${percent(novel.compared)} of its pixels, too few for a PSNR.`;
  const honest = novel.withheld
    ? `${name} took no part in the sweeps and the fit; its matches took part in the estimation of the poses.`
    : `${name} is in the fit, so this shows how well the field explains its photographs, not how it generalises. With more photographs than a fit takes, one that is left out is shown.`;
  const picture = (source, title) => make("figure", {}, make("img", { src: source, alt: title }), make("figcaption", { class: "scale" }, title));
  section("A novel view", `${scores} ${honest}`, make("div", { class: "pair" },
    picture(report.novel.image, novel.withheld ? "withheld photograph, in the reference's exposure" : "photograph, in the reference's exposure"),
    picture(report.novel.rendered, "rendered by the field; grey: outside of it")));
}
