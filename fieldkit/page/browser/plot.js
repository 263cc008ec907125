// The whole session over time: temperatures, tilts with their regions of confidence, clouds, shade and marks. Wheel, pinch or
// + and − zoom; dragging moves what is zoomed; a cursor shows the values of its minute.

const PANELS = [
  { key: "temperature_c", title: () => `${phrase("plot.temperature")}, ${temperature.unit}`, shown: (celsius) => displayed(celsius) },
  { key: "tilt_deg", title: () => `${phrase("slope.tilt")}, °`, shown: (tilt) => tilt, low: "tilt_low_deg", high: "tilt_high_deg" },
];
const BOX = { left: 44, right: 8, top: 20, height: 110, between: 34 };
const TIME_STEPS_MIN = [1, 2, 5, 10, 15, 20, 30, 60, 120, 180, 360, 720, 1440];
const LINES = 6; // colours, as classes of page.css
const GAP_MS = 3600e3; // a longer pause is no line
const MARKS_STORED_MS = 2000;

const plot = { view: null, fingers: new Map(), cursor: null, marks: [], timer: 0 }; // view: [from, to] in milliseconds, null for all
const chart = $("plot");

const wholeSession = () => [regions.minutes[0], regions.minutes.at(-1)];
const viewed = () => plot.view ?? wholeSession();
const names = () => Object.keys(regions.series);

function drawPlot() {
  $("course").hidden = regions.minutes.length < 2;
  if ($("course").hidden) return;
  const width = chart.clientWidth || 300, [from, to] = viewed();
  const x = (ms) => BOX.left + ((ms - from) / (to - from)) * (width - BOX.left - BOX.right);
  chart.setAttribute("viewBox", `0 0 ${width} ${2 * (BOX.top + BOX.height) + BOX.between}`);
  chart.setAttribute("aria-label", phrase("plot.described", { names: names().join(", "), from: clockTime(from, minuteTime), to: clockTime(to, minuteTime) }));
  chart.replaceChildren(...PANELS.map((panel, i) => panelOf(panel, BOX.top + i * (BOX.height + BOX.between), x, width)), el("g", { class: "cursor" }));
  drawCursor(x);
}

function panelOf({ key, title, shown, low: lowKey, high: highKey }, top, x, width) {
  const [from, to] = viewed(), inView = regions.minutes.map((ms) => ms >= from && ms <= to);
  const column = (name) => names().map((region) => (regions.series[region][name] ?? []).map(shown));
  const series = column(key), lows = lowKey && column(lowKey), highs = highKey && column(highKey);
  const last = inView.lastIndexOf(true); // regions of confidence narrow: the last ones must fit, not the first
  const ends = [...(lows ?? []), ...(highs ?? [])].map((values) => values[last]);
  const finite = [...series.flatMap((values) => values.filter((value, i) => inView[i])), ...ends].filter(Number.isFinite);
  if (finite.length === 0) return el("g", {}, el("text", { x: BOX.left, y: top - 6 }, phrase("plot.none", { title: title() })));
  const step = evenStep(Math.max(...finite) - Math.min(...finite) || 1);
  const low = step * Math.floor(Math.min(...finite) / step), high = step * Math.ceil(Math.max(...finite) / step + 1e-9) || low + step;
  const y = (value) => top + BOX.height * (1 - (Math.min(high, Math.max(low, value)) - low) / (high - low || step));
  return el("g", {}, el("text", { x: BOX.left, y: top - 6 }, title()),
    ...clouds(x, top), ...valueAxis(low, high, step, y, width), ...timeAxis(x, top),
    ...series.flatMap((values, i) => [...(lows ? band(lows[i], highs[i], i, inView, x, y) : []), ...curves(values, i, inView, x, y)]),
    ...shades(x, top), ...markLines(x, top));
}

/** A step of 1, 2 or 5 times a power of ten, of which four or five span a range. */
function evenStep(range) {
  const power = 10 ** Math.floor(Math.log10(range / 4));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= range / 4);
}

function valueAxis(low, high, step, y, width) {
  const count = Math.round((high - low) / step);
  return Array.from({ length: count + 1 }, (_, i) => low + i * step).flatMap((value) => [
    el("path", { class: "grid", d: `M${BOX.left} ${y(value)}H${width - BOX.right}` }),
    el("text", { x: BOX.left - 6, y: y(value) + 4, class: "of-value" }, number(value, step < 1 ? Math.ceil(-Math.log10(step)) : 0))]);
}

function timeAxis(x, top) {
  const [from, to] = viewed(), wanted = (to - from) / 60e3 / Math.max(2, Math.floor((x(to) - x(from)) / 84));
  const step = 60e3 * (TIME_STEPS_MIN.find((minutes) => minutes >= wanted) ?? 1440);
  const first = Math.ceil(from / step) * step, count = Math.max(0, Math.floor((to - first) / step) + 1);
  return Array.from({ length: count }, (_, i) => first + i * step).flatMap((ms) => [
    el("path", { class: "grid", d: `M${x(ms)} ${top}v${BOX.height}` }),
    el("text", { x: Math.min(x(ms), x(to) - 10), y: top + BOX.height + 14, class: "of-time" }, clockTime(ms, minuteTime))]);
}

/** Runs of minutes for which `holds`, each as the indices of its minutes; a long pause ends a run. */
function runs(holds) {
  const stretches = [[]];
  regions.minutes.forEach((ms, i) => {
    if (ms - regions.minutes[i - 1] > GAP_MS) stretches.push([]);
    if (holds(i)) stretches.at(-1).push(i);
    else if (stretches.at(-1).length) stretches.push([]);
  });
  return stretches.filter((stretch) => stretch.length);
}

const place = (x, y) => `${x.toFixed(1)},${y.toFixed(1)}`;

function curves(values, line, inView, x, y) {
  return runs((i) => inView[i] && Number.isFinite(values[i])).map((run) =>
    el("polyline", { class: `line-${line % LINES}`, points: run.map((i) => place(x(regions.minutes[i]), y(values[i]))).join(" ") }));
}

/** The region of confidence around a line. */
function band(lows, highs, line, inView, x, y) {
  return runs((i) => inView[i] && Number.isFinite(lows[i]) && Number.isFinite(highs[i])).map((run) => {
    const edge = (values, indices) => indices.map((i) => place(x(regions.minutes[i]), y(values[i])));
    return el("polygon", { class: `band-${line % LINES}`, points: [...edge(highs, run), ...edge(lows, [...run].reverse())].join(" ") });
  });
}

/** Rectangles over the minutes for which `holds`, within the view. */
function stripes(holds, name, x, top, height) {
  const [from, to] = viewed(), minute = 60e3;
  return runs((i) => holds(i) && regions.minutes[i] > from - minute && regions.minutes[i] < to).map((run) => {
    const start = Math.max(from, regions.minutes[run[0]]), end = Math.min(to, regions.minutes[run.at(-1)] + minute);
    return el("path", { class: name, d: `M${x(start)} ${top}H${x(end)}v${height}H${x(start)}z` });
  });
}

const clouds = (x, top) => stripes((i) => regions.cloudy[i], "clouds", x, top, BOX.height);

/** At the foot of a panel, a stripe in the colour of each region while it was shaded. */
const shades = (x, top) => names().flatMap((name, line) =>
  stripes((i) => regions.series[name].shaded?.[i], `shades fill-${line % LINES}`, x, top + BOX.height - 4 * (line % LINES + 1), 4));

function markLines(x, top) {
  const [from, to] = viewed();
  return plot.marks.filter(({ time_ms: ms }) => ms >= from && ms <= to).map(({ time_ms: ms }) => el("path", { class: "marks", d: `M${x(ms)} ${top}v${BOX.height}` }));
}

/** Once for several marks, which a recording stores within a second or two. */
function fetchMarksSoon() {
  clearTimeout(plot.timer);
  plot.timer = setTimeout(fetchMarks, MARKS_STORED_MS);
}

/** Keep the marks that count, of the recording; a preview has none. */
async function fetchMarks() {
  const answer = await request({ do: "marks", session: null });
  plot.marks = answer.ok ? answer.data.filter((mark) => mark.counts) : [];
  drawPlot();
}

// ---- the cursor

/** Show the values of the cursor's minute, or of the last one. */
function drawCursor(x) {
  const i = plot.cursor === null ? regions.minutes.length - 1 : nearestMinute(plot.cursor), ms = regions.minutes[i], [from, to] = viewed();
  if (plot.cursor !== null && ms >= from && ms <= to) chart.querySelector(".cursor").append(el("path", { d: `M${x(ms)} ${BOX.top}V${2 * (BOX.top + BOX.height) + BOX.between - BOX.top}` }));
  const notes = [regions.cloudy[i] ? phrase("plot.cloud") : "", ...plot.marks.filter((mark) => Math.floor(mark.time_ms / 60e3) === Math.floor(ms / 60e3)).map(markText)];
  say($("plot-time"), [clockTime(ms, minuteTime), ...notes].filter(Boolean).join(" · "));
  $("plot-names").replaceChildren(...names().map((name, line) => el("li", { class: `line-${line % LINES}` }, name, " ", el("span", { class: "figure" }, valuesAt(name, i)))));
}

function valuesAt(name, i) {
  const { temperature_c: celsius, tilt_deg: tilt, tilt_low_deg: low, tilt_high_deg: high, shaded } = regions.series[name], at = (column) => column?.[i];
  return [`${number(displayed(at(celsius)), 1)} ${temperature.unit}`,
    Number.isFinite(at(tilt)) ? `${number(at(tilt), 1)}° (${number(at(low), 1)}–${number(at(high), 1)})` : "",
    at(shaded) ? phrase("plot.shade") : ""].filter(Boolean).join(", ");
}

function nearestMinute(ms) {
  return regions.minutes.reduce((best, minute, i) => (Math.abs(minute - ms) < Math.abs(regions.minutes[best] - ms) ? i : best), 0);
}

function setCursor(ms) {
  plot.cursor = ms;
  drawPlot();
}

const cursorAt = (clientX) => setCursor(viewed()[0] + shareAt(clientX) * (viewed()[1] - viewed()[0]));

/** Move the cursor by minutes; the view follows it. */
function stepCursor(by) {
  const i = plot.cursor === null ? regions.minutes.length - 1 : nearestMinute(plot.cursor);
  const ms = regions.minutes[Math.min(regions.minutes.length - 1, Math.max(0, i + by))], [from, to] = viewed();
  plot.cursor = ms;
  zoomPlot(1, 0.5, ms < from ? (ms - from) / (to - from) : ms > to ? (ms - to) / (to - from) : 0);
}

// ---- the view

/** Show `factor` times the present span, the place `share` of it kept, moved by `by` spans; never beyond the session. */
function zoomPlot(factor, share = 0.5, by = 0) {
  const [start, end] = wholeSession(), [from, to] = viewed();
  const span = Math.min(end - start, Math.max(2 * 60e3, factor * (to - from)));
  const begin = Math.min(end - span, Math.max(start, from + share * (to - from - span) + by * (to - from)));
  plot.view = span >= end - start ? null : [begin, begin + span];
  drawPlot();
}

const shareAt = (clientX) => {
  const box = chart.getBoundingClientRect();
  return Math.min(1, Math.max(0, (clientX - box.left - BOX.left) / (box.width - BOX.left - BOX.right)));
};

/** A mouse or one finger moves the cursor, or what is zoomed; two fingers stretch about their middle. */
function pointerMoved(event) {
  if (!plot.fingers.has(event.pointerId)) return event.pointerType === "mouse" ? cursorAt(event.clientX) : undefined;
  const before = [...plot.fingers.values()];
  plot.fingers.set(event.pointerId, shareAt(event.clientX));
  const after = [...plot.fingers.values()];
  if (after.length === 1) return plot.view ? zoomPlot(1, 0.5, before[0] - after[0]) : cursorAt(event.clientX);
  const apart = ([first, second]) => Math.max(0.02, Math.abs(first - second));
  zoomPlot(apart(before) / apart(after), (after[0] + after[1]) / 2);
}

const PLOT_KEYS = {
  "+": () => zoomPlot(0.5), "-": () => zoomPlot(2), Home: () => zoomPlot(Infinity), Escape: () => setCursor(null),
  ArrowLeft: (event) => stepCursor(event.shiftKey ? -10 : -1), ArrowRight: (event) => stepCursor(event.shiftKey ? 10 : 1),
};

chart.addEventListener("pointerdown", (event) => {
  plot.fingers.set(event.pointerId, shareAt(event.clientX));
  cursorAt(event.clientX);
});
chart.addEventListener("pointermove", pointerMoved);
for (const end of ["pointerup", "pointercancel", "pointerleave"]) chart.addEventListener(end, (event) => plot.fingers.delete(event.pointerId));
chart.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoomPlot(1.002 ** event.deltaY, shareAt(event.clientX));
}, { passive: false });
chart.addEventListener("keydown", (event) => {
  if (!PLOT_KEYS[event.key]) return;
  event.preventDefault();
  PLOT_KEYS[event.key](event);
});
for (const type of ["history", "minute"]) on(type, drawPlot);
on("history", () => {
  Object.assign(plot, { view: null, cursor: null });
  fetchMarksSoon();
});
on("event", ({ kind }) => { if (kind === "mark") fetchMarksSoon(); });
new ResizeObserver(drawPlot).observe(chart);
