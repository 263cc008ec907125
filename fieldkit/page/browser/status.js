// What is going on: state, clock, conditions, instruments, events.

const MOST_EVENTS = 100;
const PHASES = {
  preview: "Live preview, not recording", starting: "Starting …", waiting: "A recording waits for its time", recording: "Recording",
  sealing: "Stopping: checking and sealing …", "no-instruments": "No instruments",
};

const status = { state: { phase: "" }, streams: [], facts: new Map(), atMs: null };

on("hello", (hello) => {
  site.zone = hello.site.zone;
  say($("campaign"), hello.campaign);
  document.title = `${hello.campaign} – fieldkit`;
  say($("about"), `fieldkit ${hello.version}. ${hello.role === "control" ? "This link may start, stop and change." : "This link may only look."}`);
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
  const until = phase === "recording" && end ? `ends ${clockTime(end, minuteTime)}` : "";
  const bar = $("time-bar");
  bar.hidden = !until;
  if (until) Object.assign(bar, { max: end - started, value: Math.max(0, (status.atMs ?? started) - started) });
  say($("state"), [PHASES[phase] ?? phase, since, until, problem].filter(Boolean).join(" · "));
  $("state").className = phase;
}

/** A time with its date, where that is not the first of the recording. */
function clockTime(ms, shown = localTime) {
  const day = (one) => localTime(one, { day: "numeric", month: "short" });
  return day(ms) === day(status.state.started_ms ?? ms) ? shown(ms) : `${day(ms)} ${shown(ms)}`;
}

/** One line of the conditions; an unknown value is a dash. */
function fact(name, text) {
  if (!status.facts.has(name)) {
    const value = el("dd");
    status.facts.set(name, value);
    $("conditions-list").append(el("div", {}, el("dt", {}, name), value));
  }
  say(status.facts.get(name), text);
}

on("minute", ({ irradiance, sun, contact_c: contact }) => {
  fact("Direct irradiance", `${number(irradiance?.dni_w_m2)} W/m²${irradiance?.model ? ` (${irradiance.model})` : ""}`);
  if (contact.length) fact("Contact temperature", `${contact.map((celsius) => number(displayed(celsius), 1)).join(", ")} ${temperature.unit}`);
  fact("Sun", sun ? `${number(90 - sun.zenith_deg, 1)}° high, azimuth ${number(sun.azimuth_deg)}°` : "–");
});

on("now", (now) => {
  status.atMs = now.time_ms;
  say($("clock"), localTime(now.time_ms, { hour: "2-digit", minute: "2-digit", second: "2-digit", timeZoneName: "short" }));
  fact("Clock", `${dayTime(now.time_ms)}; ${clockDifference(now.time_ms)}`);
  fact("Disk", `${size(now.disk_free_bytes)} free${Number.isFinite(now.disk_left_s) ? `, full in ${duration(now.disk_left_s)}` : ""}`);
  if (now.bytes) fact("Recorded", size(now.bytes));
  showStreams(now.streams);
  showState();
});

/** How far the recorder's clock is from this device's. */
function clockDifference(ms) {
  const seconds = (ms - Date.now()) / 1000;
  if (Math.abs(seconds) < 2) return "as on this device";
  return `${duration(Math.abs(seconds))} ${seconds > 0 ? "ahead of" : "behind"} this device`;
}

on("streams", (message) => { status.streams = message.streams; });

function showStreams(latest = {}) {
  $("streams").replaceChildren(...status.streams.map((stream) => streamRow(stream, latest[stream.name] ?? {})));
}

function measured({ value, unit = "" }) {
  const [amount, word] = inUnit(value, unit);
  return `${number(amount, Math.abs(amount) < 1000 ? 1 : 0)} ${word}`;
}

function streamRow({ name, is_camera: isCamera, rows, cols, quantity }, now) {
  const value = isCamera ? `${cols} × ${rows}` : measured(now);
  const rate = now.rate_hz >= 1 ? `${number(now.rate_hz, 1)} /s` : `${number(now.rate_hz * 60, 1)} /min`;
  const lost = (now.gaps ?? 0) + (now.dropped ?? 0) + (now.rejected ?? 0) + (now.implausible ?? 0);
  const late = now.rate_hz > 0 && now.age_s > Math.max(5, 3 / now.rate_hz);
  return el("tr", {},
    el("th", { scope: "row" }, name, " ", el("small", {}, quantity === name ? "" : quantity)), el("td", {}, value), el("td", {}, rate),
    el("td", { class: lost ? "bad" : null }, number(lost)),
    el("td", { class: late ? "bad" : null }, now.age_s < 10 ? `${number(now.age_s, 1)} s` : duration(now.age_s)));
}

on("event", (event) => {
  const when = el("time", { datetime: new Date(event.time_ms).toISOString() }, clockTime(event.time_ms));
  const severity = { warning: "Warning: ", error: "Error: " }[event.severity] ?? "";
  const text = `${severity}${event.kind === "mark" ? "mark " : ""}${event.text}`;
  $("event-list").prepend(el("li", { class: event.severity }, when, el("span", {}, text)));
  $("no-events").hidden = true;
  while ($("event-list").children.length > MOST_EVENTS) $("event-list").lastChild.remove();
});
