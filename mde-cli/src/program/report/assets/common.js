// Elements, numbers and colours that every part of the page uses.

const report = JSON.parse(document.getElementById("data").textContent);

/** An element with attributes, handlers (on...) and children. */
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

function bytesOf(base64) {
  const text = atob(base64);
  return Uint8Array.from(text, (character) => character.charCodeAt(0));
}

/** With `digits` significant digits. */
function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1).replaceAll("-", "−").replace("e+", "e");
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return value.toFixed(Math.min(decimals, 6)).replace("-", "−");
}

/** With `decimals` decimals, and optionally a sign. */
function fixed(value, decimals, sign) {
  const text = value.toFixed(decimals);
  // No sign for a rounded zero.
  const bare = /[1-9]/.test(text) ? text : text.replace("-", "");
  return (sign && value > 0 && /[1-9]/.test(text) ? `+${bare}` : bare).replace("-", "−");
}

function signed(value, digits = 3) {
  return value > 0 ? `+${number(value, digits)}` : number(value, digits);
}

/** Keeps a number and its unit on one line. */
const NBSP = "\u00a0";

function percent(share, digits = 2) {
  if (Math.abs(share) < 5e-6) return `0${NBSP}%`;
  return Number.isFinite(share) ? `${number(100 * share, digits)}${NBSP}%` : "–";
}

function seconds(value) {
  if (!Number.isFinite(value)) return "–";
  if (value < 60) return `${number(value, 2)} s`;
  const whole = Math.round(value);
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

function bytes(value) {
  const units = ["B", "kB", "MB", "GB"];
  let unit = 0;
  while (value >= 1000 && unit < units.length - 1) { value /= 1000; unit += 1; }
  return `${unit === 0 ? value : number(value, 2)} ${units[unit]}`;
}

/** Quantiles of what is finite and not 0 (missing). */
function quantiles(values, shares) {
  const known = Float32Array.from(values.filter((v) => v !== 0 && Number.isFinite(v))).sort();
  if (known.length === 0) return shares.map(() => NaN);
  return shares.map((share) => known[Math.round(share * (known.length - 1))]);
}

/** A titled section with an explanation. */
function section(title, text, ...children) {
  const id = title.toLowerCase().replace(/[^a-z]+/g, "-");
  const part = make("section", { "aria-labelledby": id }, make("h2", { id }, title));
  if (text) part.append(make("p", { class: "soft small" }, text));
  part.append(...children);
  document.getElementById("page").append(part);
  return part;
}

function card(value, label) {
  return make("div", { class: "card" }, make("b", {}, value), make("span", {}, label));
}

function warnings(list) {
  if (!list || list.length === 0) return null;
  return make("div", { class: "warning", role: "note" }, make("ul", {}, list.map((text) => make("li", {}, text))));
}

/** Text with a copy button; it is selected where the browser allows no copying. `words`: lines break between words only. */
function copyable(text, words = false) {
  const parts = words ? text.split(" ").flatMap((word, i) => [i > 0 ? " " : "", make("span", { class: "word" }, word)]) : text;
  const code = make("pre", { tabindex: "0" }, parts);
  const button = make("button", { type: "button", onclick: copy }, "Copy");
  async function copy() {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(code);
      button.textContent = "Selected";
    }
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  }
  return make("div", { class: "copyable" }, code, button);
}

function choice(options, chosen, label, changed) {
  const select = make("select", { "aria-label": label, onchange: () => changed(select.value) });
  for (const [value, text] of options) select.append(make("option", { value, selected: value === chosen }, text));
  return select;
}

/** Calls `work` at most once per frame. */
function oncePerFrame(work) {
  let pending = false;
  return () => {
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => { pending = false; work(); });
  };
}
