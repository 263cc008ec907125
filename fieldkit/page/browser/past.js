// A past session in place of the live picture: its regions are drawn anew and its slopes estimated with them.

const past = { session: null };

/** Show a session's picture in place of the live ones; a promise of its answer. */
async function openPast(session) {
  if (status.state.phase === "recording") return unanswered("past.recording");
  const response = await fetch(session.picture_url).catch(() => null);
  if (!response?.ok) return unanswered("past.no_image");
  past.session = session;
  showSuggestions([]);
  choosePictures();
  await takePicture(await response.arrayBuffer());
  $("past-slopes").replaceChildren();
  $("past").hidden = false;
  say($("past-title"), phrase("past.title", { session: session.title, time: dayTime(session.started_ms) }));
  window.scrollTo(0, 0);
  $("past-title").focus({ preventScroll: true });
  return { ok: true };
}

function leavePast() {
  if (!past.session) return;
  if (drawing.draft) endDrawing();
  past.session = null;
  showSuggestions([]);
  $("past").hidden = true;
  choosePictures();
}

async function estimatePast() {
  const button = $("estimate-past"), { session } = past;
  button.disabled = true;
  $("past-slopes").replaceChildren(el("li", {}, phrase("past.estimating")));
  const answer = await request({ do: "estimate_session", session: session.id });
  button.disabled = false;
  if (past.session !== session) return;
  const lines = answer.ok ? answer.data.map(slopeLine) : [el("li", { class: "error" }, answerText(answer))];
  $("past-slopes").replaceChildren(...(lines.length ? lines : [el("li", {}, phrase("past.no_slopes"))]));
}

/** A slope with its likelihood region, or why there is none. */
function slopeLine({ region, state, tilt_deg: tilt, tilt_region_deg: tilts, azimuth_deg: azimuth, azimuth_region_deg: azimuths }) {
  const angle = (value, [low, high], digits) => `${number(value, digits)}° (${number(low, digits)}–${number(high, digits)})`;
  const isGiven = azimuths[0] === azimuths[1], direction = isGiven ? phrase("slope.given", { azimuth: `${number(azimuth)}°` }) : angle(azimuth, azimuths, 0);
  const slope = Number.isFinite(tilt) ? phrase("past.slope", { tilt: angle(tilt, tilts, 1), azimuth: direction }) : phrase("past.no_slope");
  return el("li", {}, `${region}: ${slope}`, el("span", {}, stateText({ state, tilt_high_deg: tilts[1] })));
}

on("state", ({ phase }) => { if (phase === "recording") leavePast(); }); // regions drawn now are those of the recording
$("estimate-past").onclick = estimatePast;
$("leave-past").onclick = leavePast;
