// What is going on: state, clock, conditions, instruments, events.

const MOST_EVENTS = 100;

const status = { state: { phase: "" }, streams: [], missing: [], facts: new Map(), atMs: null, isSimulated: false };

on("hello", (hello) => {
  site.zone = hello.site.zone;
  status.isSimulated = hello.simulated;
  say($("campaign"), hello.campaign);
  document.title = `${hello.campaign} – fieldkit`;
  say($("about"), phrase(`device.${hello.role}`, { version: hello.version }));
  for (const button of document.querySelectorAll(".control")) button.hidden = hello.role !== "control";
  $("actions").hidden = hello.role !== "control";
  $("event-list").replaceChildren();
  $("no-events").hidden = false;
});

on("state", (state) => {
  status.state = state;
  showState();
  $("start").hidden = ["waiting", "recording", "sealing"].includes(state.phase);
  $("start").disabled = state.phase === "starting";
  $("stop").hidden = !$("start").hidden;
  $("stop").disabled = state.phase === "sealing";
  for (const id of ["mark", "shutter", "edit-marks"]) $(id).disabled = state.phase !== "recording";
});

function showState() {
  const { phase, session, started_ms: started, planned_end_ms: end, problem } = status.state;
  const since = phase === "recording" && started ? `${session}, ${duration(Math.floor(((status.atMs ?? started) - started) / 60e3) * 60)}` : session;
  const until = phase === "recording" && end ? phrase("page.ends", { time: clockTime(end, minuteTime) }) : "";
  const bar = $("time-bar");
  bar.hidden = !until;
  if (until) Object.assign(bar, { max: end - started, value: Math.max(0, (status.atMs ?? started) - started) });
  say($("state"), withNames([wordFor("phase", phase), since, until, inLanguage(problem), status.missing.length && phrase("problem.missing", { names: status.missing.join(", ") })].filter(Boolean).join(" · ")));
  $("state").className = phase;
}

/** A time with its date, where that is not the first of the recording. */
function clockTime(ms, shown = localTime) {
  const day = (time) => localTime(time, { day: "numeric", month: "short" });
  return day(ms) === day(status.state.started_ms ?? ms) ? shown(ms) : `${day(ms)} ${shown(ms)}`;
}

/** One line of the conditions; an unknown value is a dash. */
function fact(name, text) {
  if (!status.facts.has(name)) {
    const value = el("dd");
    status.facts.set(name, value);
    $("conditions-list").append(el("div", {}, el("dt", {}, phrase(`conditions.${name}`)), value));
  }
  say(status.facts.get(name), text);
}

on("minute", ({ irradiance, sun, contact_c: contact }) => {
  fact("irradiance", `${number(irradiance.dni_w_m2)} W/m²`);
  const probes = status.streams.filter(({ quantity }) => quantity === "temperature").flatMap(({ channels }) => channels);
  if (contact.length) fact("contact", `${contact.map((celsius, i) => `${probes[i] ?? ""} ${number(displayed(celsius), 1)}`.trim()).join(", ")} ${temperature.unit}`);
  fact("sun", phrase("conditions.sun.value", { elevation: number(90 - sun.zenith_deg, 1), azimuth: number(sun.azimuth_deg) }));
});

on("now", (now) => {
  status.atMs = now.time_ms;
  say($("clock"), localTime(now.time_ms, { hour: "2-digit", minute: "2-digit", second: "2-digit", timeZoneName: "short" }));
  fact("clock", `${dayTime(now.time_ms)}; ${clockDifference(now.time_ms)}`);
  fact("disk", phrase(Number.isFinite(now.disk_left_s) ? "conditions.disk.until" : "conditions.disk.free", { free: size(now.disk_free_bytes), time: duration(now.disk_left_s) }));
  if (now.bytes) fact("recorded", size(now.bytes));
  showStreams(now.streams);
  showState();
});

/** How far the recorder's clock is from this device's; a simulated field has a time of its own. */
function clockDifference(ms) {
  if (status.isSimulated) return phrase("clock.simulated");
  const seconds = (ms - Date.now()) / 1000;
  if (Math.abs(seconds) < 2) return phrase("clock.same");
  return phrase(seconds > 0 ? "clock.ahead" : "clock.behind", { time: duration(Math.abs(seconds)) });
}

on("history", ({ minutes }) => {
  if (minutes.length) return;
  status.facts.clear(); // of another recording
  $("conditions-list").replaceChildren();
});

on("streams", ({ streams, missing }) => Object.assign(status, { streams, missing }));

function showStreams(latest = {}) {
  $("streams").replaceChildren(...status.streams.map((stream) => streamRow(stream, latest[stream.name] ?? {})));
}

function measured({ value, unit = "" }) {
  const [amount, word] = inUnit(value, unit);
  return `${number(amount, Math.abs(amount) < 1000 ? 1 : 0)} ${word}`;
}

function streamRow({ name, is_camera: isCamera, rows, cols, quantity }, now) {
  const value = isCamera ? `${cols} × ${rows}` : measured(now);
  const rate = now.rate_hz >= 1 ? phrase("rate.per_s", { rate: number(now.rate_hz, 1) }) : phrase("rate.per_min", { rate: number(now.rate_hz * 60, 1) });
  const lost = (now.gaps ?? 0) + (now.dropped ?? 0) + (now.rejected ?? 0) + (now.implausible ?? 0);
  const late = now.rate_hz > 0 && now.age_s > Math.max(5, 3 / now.rate_hz);
  return el("tr", {},
    el("th", { scope: "row" }, name, " ", el("small", {}, quantity === name ? "" : wordFor("quantity", quantity))), el("td", {}, value), el("td", {}, rate),
    el("td", { class: lost ? "bad" : null }, number(lost)),
    el("td", { class: late ? "bad" : null }, now.age_s < 10 ? phrase("time.s", { s: number(now.age_s, 1) }) : duration(now.age_s)));
}

on("event", (event) => {
  const when = el("time", { datetime: new Date(event.time_ms).toISOString() }, clockTime(event.time_ms));
  $("event-list").prepend(el("li", { class: event.severity, "data-kind": event.kind }, when,
    el("span", {}, phrase(`severity.${event.severity}`, { event: eventText(event) }))));
  $("no-events").hidden = true;
  while ($("event-list").children.length > MOST_EVENTS) $("event-list").lastChild.remove();
});
