// Elements, numbers and times. Text from outside enters the document only as text nodes.

const $ = (id) => document.getElementById(id);

/** A new element with properties (`class`, `on…` listeners, attributes) and children (elements or texts). */
function el(tag, props = {}, ...children) {
  const made = tag === "svg" || SVG_TAGS.has(tag) ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [key, value] of Object.entries(props)) {
    if (typeof value === "function") made.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== ""));
  return made;
}
const SVG = "http://www.w3.org/2000/svg";
const SVG_TAGS = new Set(["g", "polygon", "polyline", "circle", "text", "path"]);

/** Set a text only where it changes, so that a screen reader is not disturbed. */
function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** A number with fixed decimals, thin spaces every three digits; a dash where it is unknown. */
function number(value, digits = 0) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return value.toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits })
    .replaceAll(",", "\u202f").replace("-", "−");
}

/** A duration in its two largest units: `3 h 09 min`, `12 s`. */
function duration(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return `${whole} s`;
  if (whole < 600 && whole % 60) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min`;
  if (whole < 86400) return `${Math.floor(whole / 3600)} h ${String(Math.floor(whole / 60) % 60).padStart(2, "0")} min`;
  return `${number(Math.floor(whole / 86400))} d ${Math.floor(whole / 3600) % 24} h`;
}

/** A size in bytes as people read it. */
function size(bytes) {
  if (!Number.isFinite(bytes)) return "–";
  const power = Math.min(4, Math.floor(Math.log10(Math.max(1, bytes)) / 3));
  return `${number(bytes / 1000 ** power, power && bytes / 1000 ** power < 10 ? 1 : 0)} ${["B", "kB", "MB", "GB", "TB"][power]}`;
}

const site = { zone: "UTC" };

/** A time at the site; `options` as of Intl.DateTimeFormat. */
function localTime(ms, options = { hour: "2-digit", minute: "2-digit", second: "2-digit" }) {
  if (!(ms > 0)) return "–"; // nothing has a time before the first sample
  try {
    return new Intl.DateTimeFormat("en-GB", { ...options, timeZone: site.zone }).format(ms);
  } catch {
    return new Intl.DateTimeFormat("en-GB", { ...options, timeZone: "UTC" }).format(ms); // a zone unknown to this browser
  }
}
const minuteTime = (ms) => localTime(ms, { hour: "2-digit", minute: "2-digit" });
const dayTime = (ms) => localTime(ms, { year: "numeric", month: "short", day: "numeric", hour: "2-digit", minute: "2-digit" });

/** Give every `.stepper` its minus and plus buttons. */
function makeSteppers() {
  for (const box of document.querySelectorAll(".stepper")) {
    const input = box.querySelector("input");
    const name = box.closest("label").firstChild.textContent.replace(",", "").trim();
    const button = (sign, word) =>
      el("button", { type: "button", "aria-label": `${word} ${name}`, onclick: () => step(box, input, sign) }, sign > 0 ? "+" : "−");
    box.prepend(button(-1, "Decrease"));
    box.append(button(1, "Increase"));
  }
}

function step(box, input, sign) {
  const by = Number(box.dataset.step), wrap = Number(box.dataset.wrap);
  let value = input.value === "" ? Number(box.dataset.first ?? 0) : Number(input.value) + sign * by;
  if (wrap) value = ((value % wrap) + wrap) % wrap;
  if (input.min !== "") value = Math.max(Number(input.min), value);
  if (input.max !== "") value = Math.min(Number(input.max), value);
  input.value = String(Math.round(value * 1000) / 1000);
  input.dispatchEvent(new Event("input", { bubbles: true }));
}
