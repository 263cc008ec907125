// Temperatures and tilts of the whole session over time: wheel, pinch or + and − zoom, dragging or arrow keys move.

const PANELS = [["temperature_c", () => `Temperature, ${temperature.unit}`, displayed], ["tilt_deg", () => "Tilt, °", (tilt) => tilt]];
const BOX = { left: 44, right: 8, top: 20, height: 110, between: 34 };
const TIME_STEPS_MIN = [1, 2, 5, 10, 15, 30, 60, 120, 180, 360, 720, 1440];
const LINES = 6; // colours, as classes of page.css

const plot = { view: null, fingers: new Map() }; // view: [from, to] in milliseconds, null for all
const chart = $("plot");

const wholeSession = () => [regions.minutes[0], regions.minutes.at(-1)];
const viewed = () => plot.view ?? wholeSession();

function drawPlot() {
  $("course").hidden = regions.minutes.length < 2;
  if ($("course").hidden) return;
  const width = chart.clientWidth || 300, [from, to] = viewed();
  const x = (ms) => BOX.left + ((ms - from) / (to - from)) * (width - BOX.left - BOX.right);
  chart.setAttribute("viewBox", `0 0 ${width} ${2 * (BOX.top + BOX.height) + BOX.between}`);
  chart.setAttribute("aria-label", `Temperatures and tilts of ${Object.keys(regions.series).join(", ")} from ${clockTime(from, minuteTime)} to ${clockTime(to, minuteTime)}`);
  chart.replaceChildren(...PANELS.map((panel, i) => panelOf(panel, BOX.top + i * (BOX.height + BOX.between), x, width)));
  $("plot-names").replaceChildren(...Object.keys(regions.series).map((name, i) => el("li", { class: `line-${i % LINES}` }, name)));
}

function panelOf([key, titled, asShown], top, x, width) {
  const title = titled();
  const [from, to] = viewed(), shown = regions.minutes.map((ms) => ms >= from && ms <= to);
  const series = Object.values(regions.series).map((one) => (one[key] ?? []).map(asShown));
  const finite = series.flatMap((values) => values.filter((value, i) => shown[i] && Number.isFinite(value)));
  if (finite.length === 0) return el("g", {}, el("text", { x: BOX.left, y: top - 6 }, `${title}: none yet`));
  const step = evenStep(Math.max(...finite) - Math.min(...finite) || 1);
  const low = step * Math.floor(Math.min(...finite) / step), high = step * Math.ceil(Math.max(...finite) / step + 1e-9) || low + step;
  const y = (value) => top + BOX.height * (1 - (value - low) / (high - low || step));
  return el("g", {}, el("text", { x: BOX.left, y: top - 6 }, title),
    ...valueAxis(low, high, step, y, width), ...timeAxis(x, top), ...series.flatMap((values, i) => curves(values, i, shown, x, y)));
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
    el("text", { x: x(ms), y: top + BOX.height + 14, class: "of-time" }, clockTime(ms, minuteTime))]);
}

/** The polylines of a series, one for each stretch without a gap. */
function curves(values, number, shown, x, y) {
  const stretches = [[]];
  regions.minutes.forEach((ms, i) => {
    if (ms - regions.minutes[i - 1] > 3600e3) stretches.push([]);
    if (shown[i] && Number.isFinite(values[i])) stretches.at(-1).push(`${x(ms).toFixed(1)},${y(values[i]).toFixed(1)}`);
    else if (stretches.at(-1).length) stretches.push([]);
  });
  return stretches.filter((one) => one.length).map((one) => el("polyline", { class: `line-${number % LINES}`, points: one.join(" ") }));
}

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

/** One finger moves, two fingers stretch about their middle. */
function fingerMoved(event) {
  if (!plot.fingers.has(event.pointerId)) return;
  const before = [...plot.fingers.values()];
  plot.fingers.set(event.pointerId, shareAt(event.clientX));
  const after = [...plot.fingers.values()];
  if (after.length === 1) return zoomPlot(1, 0.5, before[0] - after[0]);
  const apart = ([one, other]) => Math.max(0.02, Math.abs(one - other));
  zoomPlot(apart(before) / apart(after), (after[0] + after[1]) / 2);
}

const PLOT_KEYS = { "+": [0.5], "-": [2], ArrowLeft: [1, 0.5, -0.25], ArrowRight: [1, 0.5, 0.25], Home: [Infinity] };

chart.addEventListener("pointerdown", (event) => plot.fingers.set(event.pointerId, shareAt(event.clientX)));
chart.addEventListener("pointermove", fingerMoved);
for (const end of ["pointerup", "pointercancel", "pointerleave"]) chart.addEventListener(end, (event) => plot.fingers.delete(event.pointerId));
chart.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoomPlot(1.002 ** event.deltaY, shareAt(event.clientX));
}, { passive: false });
chart.addEventListener("keydown", (event) => {
  if (!PLOT_KEYS[event.key]) return;
  event.preventDefault();
  zoomPlot(...PLOT_KEYS[event.key]);
});
for (const type of ["history", "minute"]) on(type, drawPlot);
on("history", () => { plot.view = null; });
new ResizeObserver(drawPlot).observe(chart);
