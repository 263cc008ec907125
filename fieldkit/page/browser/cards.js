// One card per region: temperature, tilt, azimuth, state, and its course over the session.

const MOST_POINTS = 1440; // a day of minutes
const SURE = new Set(["ok", "flat"]);

const SERIES = ["temperature_c", "tilt_deg", "tilt_low_deg", "tilt_high_deg", "shaded"];

const regions = { list: [], cards: new Map(), minutes: [], cloudy: [], series: {} };

on("regions", (message) => {
  regions.list = message.regions;
  $("no-regions").hidden = regions.list.length > 0;
  const names = new Set(regions.list.map((region) => region.name));
  for (const name of regions.cards.keys()) if (!names.has(name)) regions.cards.delete(name);
  $("cards").replaceChildren(...regions.list.map((region) => cardFor(region).root));
  drawOverlay();
  describePicture();
});

/** The card of a region, made when it is first seen or its kind has changed. */
function cardFor(region) {
  const known = regions.cards.get(region.name);
  if (known?.kind === region.kind) return Object.assign(known, { region });
  const card = newCard(region);
  regions.cards.set(region.name, card);
  showLine(card);
  return card;
}

function newCard(region) {
  const card = { region, kind: region.kind };
  const heading = `card-${region.name}`;
  for (const key of ["temperature", "tilt", "azimuth"]) card[key] = el("dd", {}, "–");
  for (const key of ["words", "reason"]) card[key] = el("p", { class: key === "words" ? "words" : "small" });
  card.course = el("div");
  // the picture is the first camera's: no region of another can be drawn on it
  const edit = region.camera ? el("small", {}, phrase("regions.other_camera", { camera: region.camera })) : el("button", { type: "button", class: "control", "aria-label": phrase("regions.edit.title", { name: region.name }), onclick: () => beginDrawing(card.region) }, phrase("action.edit"));
  if (!region.camera) edit.hidden = link.role !== "control";
  const fact = (name, value) => el("div", {}, el("dt", {}, name), value);
  const facts = [fact(`${phrase("regions.mean")}, ${temperature.unit}`, card.temperature)];
  if (region.kind === "target") facts.push(fact(`${phrase("slope.tilt")}, °`, card.tilt), fact(`${phrase("slope.azimuth")}, °`, card.azimuth));
  else if (region.kind === "reference") facts.push(fact(`${phrase("regions.given")}, °`, el("dd", {}, number(region.tilt_deg, 1))));
  card.root = el("article", { class: "card", "aria-labelledby": heading },
    el("div", { class: "line" }, el("h3", { id: heading }, region.name, el("small", {}, wordFor("kind", region.kind))), edit),
    el("dl", {}, ...facts), card.words, card.reason, card.course);
  return card;
}

on("now", (now) => {
  for (const [name, { temperature_c: celsius }] of Object.entries(now.regions ?? {})) {
    const card = regions.cards.get(name);
    if (card) say(card.temperature, number(displayed(celsius), 2));
  }
});

on("history", (history) => {
  Object.assign(regions, { minutes: history.minutes, cloudy: history.cloudy, series: history.regions });
  if (!regions.minutes.length) forgetSlopes();
  for (const card of regions.cards.values()) showLine(card);
});

/** Another recording or preview begins: what the cards show is over. */
function forgetSlopes() {
  delete link.last.minute;
  regions.cards.clear();
  if (link.last.regions) handle(link.last.regions);
}

on("minute", (minute) => {
  const isNew = minute.time_ms > (regions.minutes.at(-1) ?? -Infinity);
  if (isNew) {
    regions.minutes = [...regions.minutes, minute.time_ms].slice(-MOST_POINTS);
    regions.cloudy = [...regions.cloudy, minute.cloudy].slice(-MOST_POINTS);
  }
  for (const [name, values] of Object.entries(minute.regions)) {
    if (isNew) append(name, values);
    const card = regions.cards.get(name);
    if (card) showMinute(card, values, minute);
  }
});

/** Append a minute to a region's series, as long as the minutes before it. */
function append(name, values) {
  const series = (regions.series[name] ??= {});
  for (const key of SERIES) {
    const before = series[key] ?? [];
    const missing = Math.max(0, regions.minutes.length - 1 - before.length);
    series[key] = [...Array(missing).fill(null), ...before, values[key] ?? null].slice(-MOST_POINTS);
  }
}

function showMinute(card, values, minute) {
  say(card.temperature, number(displayed(values.temperature_c), 2));
  if (card.kind === "target") {
    say(card.tilt, values.tilt ?? "–");
    say(card.azimuth, azimuthText(values));
    const sensitivity = Number.isFinite(values.kelvin_per_degree) ? ` (${phrase("slope.sensitivity", { kelvin: number(values.kelvin_per_degree, 2) })})` : "";
    say(card.words, stateText(values) + sensitivity);
    say(card.reason, reasonText(values, minute));
    card.root.classList.toggle("unsure", !SURE.has(values.state));
  }
  showLine(card);
}

/** The azimuth with its region; one that was given is no estimate. */
const azimuthText = ({ azimuth, azimuth_deg: degrees, azimuth_low_deg: low, azimuth_high_deg: high }) =>
  (Number.isFinite(degrees) && low === high ? phrase("slope.given", { azimuth: number(degrees) }) : azimuth ?? "–");

/** The state of a slope, and the other slope that fits as well. */
function stateText({ state, tilt_high_deg: high, along_sun_deg: along, second_tilt_deg: tilt, second_azimuth_deg: azimuth }) {
  if (Number.isFinite(along)) return phrase("state.along_sun", { tilt: number(along, 1) });
  const words = phrase(`state.${state}`, { tilt: number(high, 1) });
  return Number.isFinite(tilt) ? phrase("state.second", { words, tilt: number(tilt, 1), azimuth: number(azimuth) }) : words;
}

/** Why a slope is not certain, or what is missing, from its numbers and those of its minute. */
function reasonText({ state, temperature_c: celsius, tilt_low_deg: low, tilt_high_deg: high }, { irradiance }) {
  const missing = !Number.isFinite(celsius) ? ".frames" : !Number.isFinite(irradiance.dni_w_m2) ? ".light" : "";
  const key = [`reason.${state}${missing}`, `reason.${state}`].find((name) => name in TEXTS);
  return key ? phrase(key, { low: number(low, 1), high: number(high, 1) }) : "";
}

/** The course of tilt, or of temperature where there is no tilt, as a line with its range in words. */
function showLine(card) {
  const series = regions.series[card.region.name] ?? {};
  const known = (values) => (values ?? []).filter(Number.isFinite);
  const isTilt = card.kind === "target" && known(series.tilt_deg).length > 1;
  const values = isTilt ? series.tilt_deg : series.temperature_c, finite = known(values);
  if (finite.length < 2) return card.course.replaceChildren();
  const low = Math.min(...finite), high = Math.max(...finite);
  const words = phrase("regions.course", {
    quantity: phrase(isTilt ? "slope.tilt" : "plot.temperature"), unit: isTilt ? "°" : ` ${temperature.unit}`,
    low: number(isTilt ? low : displayed(low), 1), high: number(isTilt ? high : displayed(high), 1), time: duration(60 * values.length),
  });
  card.course.replaceChildren(
    el("svg", { role: "img", "aria-label": words, viewBox: "0 0 100 30", preserveAspectRatio: "none" }, ...lines(values, low, high)),
    el("p", { class: "small", "aria-hidden": true }, words));
}

/** The polylines of a series in a box of 100 x 30, one for each stretch without a gap. */
function lines(values, low, high) {
  const stretches = [[]];
  values.forEach((value, i) => {
    if (Number.isFinite(value)) stretches.at(-1).push([(100 * i) / (values.length - 1), 28 - (26 * (value - low)) / (high - low || 1)].map((at) => at.toFixed(1)));
    else if (stretches.at(-1).length) stretches.push([]);
  });
  return stretches.filter((stretch) => stretch.length).map((stretch) => el("polyline", { points: stretch.join(" ") }));
}
