// Lines over a pair of axes, as SVG.

const SVG = "http://www.w3.org/2000/svg";

function drawn(tag, attributes, text) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

/** Round values that divide a range into about `parts`. */
function ticks(low, high, parts) {
  const rough = (high - low) / parts || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
  return found;
}

/** The logarithms of 1, 2, 5, 10, ... in a range, or of powers of ten alone where that is enough. */
function decades(low, high) {
  const found = (steps) => {
    const list = [];
    for (let power = Math.floor(low); power <= high; power += 1) {
      for (const step of steps) list.push(power + Math.log10(step));
    }
    return list.filter((v) => v >= low && v <= high);
  };
  const whole = found([1]);
  return whole.length >= 4 ? whole : found([1, 2, 5]);
}

/** A number without trailing zeros. */
function plain(value) {
  return String(Number(value.toPrecision(6))).replace("-", "−");
}

/** `series`: { name, points: [[x, y], ...] }; a `logarithmic` vertical axis shows powers of ten and their halves. */
function chart({ title, x, y, series, logarithmic = false }) {
  const [wide, high, left, right, top, bottom] = [560, 260, 56, 20, 14, 38];
  const scaled = ([u, v]) => [u, logarithmic ? Math.log10(v) : v];
  series = series.map((line) => ({ ...line, points: line.points.map(scaled) }));
  const all = series.flatMap((line) => line.points).filter(([, v]) => Number.isFinite(v));
  const range = (values) => [Math.min(...values), Math.max(...values)];
  const [x0, x1] = range(all.map((p) => p[0]));
  let [y0, y1] = range(all.map((p) => p[1]));
  if (y1 - y0 < 1e-9) { y0 -= 0.5; y1 += 0.5; }
  const margin = 0.04 * (y1 - y0);
  [y0, y1] = [y0 - margin, y1 + margin];
  const px = (v) => left + ((v - x0) / (x1 - x0 || 1)) * (wide - left - right);
  const py = (v) => high - bottom - ((v - y0) / (y1 - y0)) * (high - top - bottom);
  const svg = drawn("svg", { viewBox: `0 0 ${wide} ${high}`, role: "img", "aria-label": title });
  const levels = logarithmic ? decades(y0, y1) : ticks(y0, y1, 4);
  for (const v of levels) {
    svg.append(drawn("line", { class: "grid", x1: left, x2: wide - right, y1: py(v), y2: py(v) }));
    svg.append(drawn("text", { x: left - 7, y: py(v) + 4, "text-anchor": "end" }, plain(logarithmic ? 10 ** v : v)));
  }
  for (const v of ticks(x0, x1, 5)) svg.append(drawn("text", { x: px(v), y: high - bottom + 17, "text-anchor": "middle" }, plain(v)));
  svg.append(drawn("text", { x: (left + wide - right) / 2, y: high - 4, "text-anchor": "middle" }, x));
  series.forEach((line, index) => {
    const points = line.points.filter(([, v]) => Number.isFinite(v)).map(([u, v]) => `${px(u).toFixed(1)},${py(v).toFixed(1)}`);
    const style = `stroke: var(--series-${index % 4})`;
    svg.append(drawn("polyline", { points: points.join(" "), fill: "none", "stroke-width": 2, "stroke-linejoin": "round", style }));
  });
  const legend = series.length < 2 ? null : make("div", { class: "legend" }, series.map((line, index) => {
    const swatch = make("span", { class: "swatch" });
    swatch.style.background = `var(--series-${index % 4})`;
    return make("span", {}, swatch, ` ${line.name}`);
  }));
  return make("figure", { class: "chart" }, make("figcaption", { class: "small" }, make("b", {}, title), make("span", { class: "soft" }, ` · ${y}`)), svg, legend);
}
