// The thermal picture: decoded, coloured with a table fixed in temperature, greyed when stale, read under the finger.

// 256 x red, green, blue
const PALETTES = { inferno: Uint8Array.from(atob("{{inferno}}"), (character) => character.charCodeAt(0)) };
for (const [name, colours] of Object.entries({{palettes}})) PALETTES[name] = ramp(colours);
const STALE_AFTER = 2.5; // intervals: two expected pictures did not come
const UNKNOWN_INTERVAL_MS = 3000;

const picture = {
  header: null, counts: null, scale: 1, offset: 0, // value in °C = scale * count + offset
  palette: PALETTES.inferno, low: 0, high: 1, locked: null, mode: "jpeg",
  waiting: null, busy: false, arrivals: [], probe: null, probing: false,
};
const pixels = $("pixels"), stage = $("stage");
const screen2d = pixels.getContext("2d");
const decoder = document.createElement("canvas").getContext("2d", { willReadFrequently: true });

/** Take a picture off the socket; of those that wait while one is decoded only the newest is shown. */
async function takePicture(buffer) {
  picture.waiting = buffer;
  if (picture.busy) return;
  picture.busy = true;
  while (picture.waiting) {
    const next = picture.waiting;
    picture.waiting = null;
    try {
      Object.assign(picture, await decoded(next));
      picture.arrivals = [...picture.arrivals.slice(-8), performance.now()];
      draw();
    } catch (error) {
      console.warn("a picture could not be shown:", error);
    }
  }
  picture.busy = false;
}

/** A picture's header and counts, with the scale and offset that turn them into °C. */
async function decoded(buffer) {
  const headerSize = new DataView(buffer).getUint16(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 2, headerSize)));
  const body = new Blob([new Uint8Array(buffer, 2 + headerSize)], { type: "image/jpeg" });
  if (header.mode === "exact") return { header, counts: await exactCounts(body, header), scale: header.scale, offset: header.offset };
  const scale = (header.high_c - header.low_c) / 255;
  return { header, counts: await jpegCounts(body, header), scale, offset: header.low_c };
}

async function jpegCounts(body, { rows, cols }) {
  const image = await createImageBitmap(body, { colorSpaceConversion: "none" });
  Object.assign(decoder.canvas, { width: cols, height: rows });
  decoder.drawImage(image, 0, 0);
  image.close();
  const rgba = decoder.getImageData(0, 0, cols, rows).data;
  return Uint8Array.from({ length: rows * cols }, (_, i) => rgba[4 * i]);
}

/** Lossless counts: zlib of 16-bit values, each the difference from its left neighbour. */
async function exactCounts(body, { cols }) {
  const bytes = await new Response(body.stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
  const counts = new Uint16Array(bytes);
  for (let i = 1; i < counts.length; i++) if (i % cols) counts[i] += counts[i - 1];
  return counts;
}

function draw() {
  const { rows, cols } = picture.header;
  if (pixels.width !== cols || pixels.height !== rows) resizeStage(rows, cols);
  setScale();
  paint(screen2d, picture, picture.low, picture.high);
  showStale();
  if (picture.mode === "exact") showProbe();
}

/** Paint a decoded picture in the palette's colours, from `low` to `high` °C. */
function paint(canvas, { header: { rows, cols }, counts, scale, offset }, low, high) {
  const image = canvas.createImageData(cols, rows), { palette } = picture;
  const factor = (scale * 255) / (high - low), start = ((offset - low) * 255) / (high - low);
  for (let i = 0; i < counts.length; i++) {
    const colour = 3 * Math.round(Math.min(255, Math.max(0, counts[i] * factor + start)));
    image.data[4 * i] = palette[colour];
    image.data[4 * i + 1] = palette[colour + 1];
    image.data[4 * i + 2] = palette[colour + 2];
    image.data[4 * i + 3] = 255;
  }
  canvas.putImageData(image, 0, 0);
}

function resizeStage(rows, cols) {
  Object.assign(pixels, { width: cols, height: rows });
  document.documentElement.style.setProperty("--ratio", cols / rows);
  drawOverlay();
}

/** The locked scale, or from the 1st to the 99th percentile in whole degrees, moved only when it no longer fits. */
function setScale() {
  let [low, high] = picture.locked ?? [picture.low, picture.high];
  if (!picture.locked) {
    const stride = Math.max(1, Math.floor(picture.counts.length / 2000));
    const sample = picture.counts.filter((_, i) => i % stride === 0).sort();
    const at = (share) => picture.scale * sample[Math.round(share * (sample.length - 1))] + picture.offset;
    if (at(0.01) < low || at(0.01) > low + 1.5) low = Math.floor(at(0.01));
    if (at(0.99) > high || at(0.99) < high - 1.5) high = Math.ceil(at(0.99));
    high = Math.max(high, low + 2);
  }
  Object.assign(picture, { low, high });
  for (const [id, end] of [["low", low], ["high", high]]) {
    const [value, unit] = inUnit(end, picture.header.unit); // or counts, of a camera without known temperatures
    say($(id), `${number(value, value % 1 ? 1 : 0)} ${unit}`);
  }
}

/** Milliseconds between pictures, as they arrived. */
function interval() {
  const gaps = picture.arrivals.slice(1).map((at, i) => at - picture.arrivals[i]).sort((a, b) => a - b);
  return gaps.length ? gaps[Math.floor(gaps.length / 2)] : UNKNOWN_INTERVAL_MS;
}

/** Grey the picture, and say how old it is, once two more should have come. */
function showStale() {
  const last = picture.arrivals.at(-1);
  if (last === undefined) return;
  const ageMs = performance.now() - last;
  const stale = !past.session && ageMs > Math.max(600, STALE_AFTER * interval());
  stage.classList.toggle("stale", stale);
  $("stale").hidden = !stale;
  if (stale) say($("stale"), phrase("image.stale", { age: duration(Math.max(1, ageMs / 1000)) }));
  say($("age"), stale ? "" : past.session ? phrase("image.recorded") : localTime(picture.header.time_ms));
}

/** 256 colours in even steps between those given in hexadecimal. */
function ramp(colours) {
  const stops = colours.split(" ").map((colour) => [0, 2, 4].map((at) => parseInt(colour.slice(at, at + 2), 16)));
  return Uint8Array.from({ length: 768 }, (_, i) => {
    const place = (Math.floor(i / 3) / 255) * (stops.length - 1), before = Math.min(Math.floor(place), stops.length - 2);
    const [from, to] = [stops[before][i % 3], stops[before + 1][i % 3]];
    return Math.round(from + (place - before) * (to - from));
  });
}

/** Colour the picture and the legend anew; the choice is kept on this device. */
function choosePalette(name) {
  picture.palette = PALETTES[name] ?? PALETTES.inferno;
  localStorage.setItem("palette", name);
  drawLegend();
  if (picture.header) draw();
  paintThumbnails();
}

function drawLegend() {
  const legend = $("legend").getContext("2d"), image = legend.createImageData(256, 1);
  for (let i = 0; i < 256; i++) image.data.set([...picture.palette.subarray(3 * i, 3 * i + 3), 255], 4 * i);
  legend.putImageData(image, 0, 0);
}

/** Describe the picture to a screen reader. */
function describePicture() {
  if (!picture.header) return;
  const names = regions.list.map((region) => region.name).join(", ");
  stage.setAttribute("aria-label",
    phrase(names ? "image.described" : "image.described.empty", { low: $("low").textContent, high: $("high").textContent, names }));
}

function lockScale(values) {
  picture.locked = values;
  $("lock").setAttribute("aria-pressed", String(values !== null));
  $("locked-scale").hidden = values === null;
  if (picture.counts) draw();
}

/** The ends of the locked scale, in the unit shown. */
function showLock() {
  if (picture.locked) [$("lock-low").value, $("lock-high").value] = picture.locked.map((end) => Math.round(10 * displayed(end)) / 10);
}

/** Ask for pictures of the mode chosen; none while the tab is hidden, a past session is shown or the link is gone. */
function choosePictures() {
  const mode = document.hidden || past.session ? "off" : picture.mode;
  if (link.socket?.readyState === WebSocket.OPEN) request({ do: "picture", mode });
}

/** A pointer event's place in camera pixels, within the picture. */
function placeOf(event) {
  const box = stage.getBoundingClientRect();
  const along = (at, start, length, count) => Math.min(count - 1, Math.max(0, Math.round(((at - start) / length) * count - 0.5)));
  return [along(event.clientX, box.left, box.width, pixels.width), along(event.clientY, box.top, box.height, pixels.height)];
}

/** Screen pixels per camera pixel. */
const zoom = () => (stage.clientWidth || pixels.width) / pixels.width;

function moveProbe([x, y]) {
  picture.probe = [Math.min(pixels.width - 1, Math.max(0, x)), Math.min(pixels.height - 1, Math.max(0, y))];
  drawOverlay();
  showProbe();
}

/** Show the temperature under the cross: from exact counts here, otherwise from the recorder. */
async function showProbe() {
  if (!picture.probe || !picture.header) return;
  const [x, y] = picture.probe;
  if (picture.header.mode === "exact") {
    return showValue(x, y, picture.scale * picture.counts[y * pixels.width + x] + picture.offset);
  }
  if (picture.probing) return;
  picture.probing = true;
  const answer = await request({ do: "value", x, y });
  picture.probing = false;
  if (answer.ok) showValue(x, y, answer.data.temperature_c);
  if (answer.ok && (picture.probe[0] !== x || picture.probe[1] !== y)) showProbe();
}

function showValue(x, y, celsius) {
  const [value, unit] = inUnit(celsius, picture.header.unit);
  say($("value"), phrase("image.value", { value: number(value, 2), unit, x, y }));
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** The move in camera pixels of an arrow key, with Shift by 10; undefined for other keys. */
const moveOf = (event) => ARROWS[event.key]?.map((by) => by * (event.shiftKey ? 10 : 1));

stage.addEventListener("pointerdown", (event) => drawing.draft || moveProbe(placeOf(event)));
stage.addEventListener("pointermove", (event) => {
  if (!drawing.draft && (event.pointerType === "mouse" || event.buttons)) moveProbe(placeOf(event));
});
stage.addEventListener("keydown", (event) => {
  const move = moveOf(event);
  if (!move || event.target !== stage) return;
  event.preventDefault();
  const [x, y] = picture.probe ?? [Math.floor(pixels.width / 2), Math.floor(pixels.height / 2)];
  $("value").setAttribute("aria-live", "polite"); // moved by key: read out where the cross is
  moveProbe(picture.probe ? [x + move[0], y + move[1]] : [x, y]);
});
document.addEventListener("visibilitychange", choosePictures);
on("hello", choosePictures);
on("now", () => { showProbe(); describePicture(); });
$("lock").onclick = () => {
  const values = picture.locked ? null : [picture.low, picture.high];
  lockScale(values);
  showLock();
};
for (const id of ["lock-low", "lock-high"]) {
  $(id).oninput = () => {
    const [low, high] = ["lock-low", "lock-high"].map((end) => fromDisplayed(Number($(end).value)));
    if (high > low) lockScale([low, high]);
  };
}
$("exact").onclick = () => {
  picture.mode = picture.mode === "exact" ? "jpeg" : "exact";
  $("exact").setAttribute("aria-pressed", String(picture.mode === "exact"));
  choosePictures();
};
new ResizeObserver(() => drawOverlay()).observe(stage);
$("palette").append(...Object.keys(PALETTES).map((name) => el("option", { value: name }, wordFor("palette", name))));
$("palette").value = localStorage.getItem("palette") in PALETTES ? localStorage.getItem("palette") : "inferno";
$("palette").onchange = () => choosePalette($("palette").value);
choosePalette($("palette").value);
setInterval(() => { showStale(); checkConnection(); }, 250);
