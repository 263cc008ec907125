// Elements, numbers and times. Text from outside enters the document only as text nodes.

const $ = (id) => document.getElementById(id);

/** A new element with properties (`class`, `on…` listeners, attributes) and children (elements or texts). */
function el(tag, props = {}, ...children) {
  const element = tag === "svg" || SVG_TAGS.has(tag) ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [key, value] of Object.entries(props)) {
    if (typeof value === "function") element.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child || child === 0));
  return element;
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
  const whole = Math.max(0, Math.round(seconds)), min = Math.floor(whole / 60) % 60;
  if (whole < 60) return phrase("time.s", { s: whole });
  if (whole < 600 && whole % 60) return phrase("time.min_s", { min, s: whole % 60 });
  if (whole < 3600) return phrase("time.min", { min });
  if (whole < 86400) return phrase("time.h_min", { h: Math.floor(whole / 3600), min: String(min).padStart(2, "0") });
  return phrase("time.d_h", { d: number(Math.floor(whole / 86400)), h: Math.floor(whole / 3600) % 24 });
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
    return new Intl.DateTimeFormat(phrase("language.locale"), { ...options, timeZone: site.zone }).format(ms);
  } catch {
    return new Intl.DateTimeFormat(phrase("language.locale"), { ...options, timeZone: "UTC" }).format(ms); // a zone unknown to this browser
  }
}
const minuteTime = (ms) => localTime(ms, { hour: "2-digit", minute: "2-digit" });
const dayTime = (ms) => localTime(ms, { year: "numeric", month: "short", day: "numeric", hour: "2-digit", minute: "2-digit" });

/** Give every `.stepper` its minus and plus buttons. */
function makeSteppers() {
  for (const box of document.querySelectorAll(".stepper")) {
    const input = box.querySelector("input");
    const name = box.closest("label").firstChild.textContent.replace(",", "").trim();
    const button = (sign, key) =>
      el("button", { type: "button", "aria-label": phrase(key, { name }), onclick: () => step(box, input, sign) }, sign > 0 ? "+" : "−");
    box.prepend(button(-1, "stepper.decrease"));
    box.append(button(1, "stepper.increase"));
  }
}

/** The first shown field of a form that is empty or out of range, with the browser's reason; "" if there is none. */
function mistakeIn(form) {
  const input = [...form.elements].find((field) => field.checkVisibility() && !field.validity.valid);
  return input ? `${input.closest("label").firstChild.textContent.trim()}: ${input.validationMessage}` : "";
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
