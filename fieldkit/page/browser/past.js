// A past session in place of the live picture: its regions are drawn anew and its slopes estimated with them.

const past = { session: null };

/** Show a session's picture in place of the live ones; a promise of `{ok, text, fix}`. */
async function openPast(session) {
  if (status.state.phase === "recording") return { ok: false, text: "Regions drawn now would be those of the recording.", fix: "Stop it first." };
  const response = await fetch(session.picture_url).catch(() => null);
  if (!response?.ok) return { ok: false, text: (await response?.text()) ?? "The picture did not come.", fix: "Try again." };
  past.session = session;
  showSuggestions([]);
  choosePictures();
  await takePicture(await response.arrayBuffer());
  $("past-slopes").replaceChildren();
  $("past").hidden = false;
  say($("past-title"), `${session.title || session.id}, ${dayTime(session.started_ms)}: draw regions on it, then estimate it anew.`);
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
  $("past-slopes").replaceChildren(el("li", {}, "Estimating …"));
  const answer = await request({ do: "estimate_session", session: session.id });
  button.disabled = false;
  if (past.session !== session) return;
  const lines = answer.ok ? answer.data.map(slopeLine) : [el("li", { class: "error" }, [answer.text, answer.fix].filter(Boolean).join(" "))];
  $("past-slopes").replaceChildren(...(lines.length ? lines : [el("li", {}, "No slopes: draw a target, and a reference where the slope is known.")]));
}

/** A slope with its likelihood region, or why there is none. */
function slopeLine({ region, state, reason, tilt_deg: tilt, tilt_region_deg: tilts, azimuth_deg: azimuth, azimuth_region_deg: azimuths }) {
  const angle = (value, [low, high], digits) => `${number(value, digits)}° (${number(low, digits)} to ${number(high, digits)})`;
  const slope = Number.isFinite(tilt) ? `tilt ${angle(tilt, tilts, 1)}, azimuth ${angle(azimuth, azimuths, 0)}` : "no slope";
  return el("li", {}, `${region}: ${slope}`, el("span", {}, [state.replaceAll("_", " "), reason].filter(Boolean).join(": ")));
}

on("state", ({ phase }) => { if (phase === "recording") leavePast(); }); // regions drawn now are those of the recording
$("estimate-past").onclick = estimatePast;
$("leave-past").onclick = leavePast;
