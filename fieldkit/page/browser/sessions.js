// Recorded sessions: report, check, download, and drawing on their pictures.

async function listSessions() {
  const answer = await request({ do: "sessions" });
  forgetChosen();
  if (!answer.ok) return showAnswer(answer);
  say($("list-sessions"), phrase("sessions.again"));
  $("session-list").replaceChildren(...answer.data.map(sessionItem));
  $("session-search").hidden = answer.data.length < 2;
  searchSessions();
  if (answer.data.length === 0) $("session-list").append(el("li", {}, phrase("sessions.none")));
}

function sessionItem(session) {
  const heading = `session-${session.id}`;
  const result = el("p", { role: "status" });
  const check = async () => {
    say(result, phrase("sessions.checking"));
    const answer = await request({ do: "check_session", session: session.id });
    say(result, answerText(answer));
  };
  const draw = async () => {
    const shown = await openPast(session);
    if (!shown.ok) say(result, answerText(shown));
  };
  const about = [wordFor("session", session.state), dayTime(session.started_ms), duration(session.duration_s), size(session.bytes)].join(", ");
  const reach = (url, key, props = { target: "_blank", rel: "noopener" }) => url && el("a", { class: "button", href: url, "aria-describedby": heading, ...props }, phrase(key));
  return el("li", {}, el("div", { class: "line" }, el("div", {}, el("h3", { id: heading }, session.title), el("p", { class: "small" }, about)), thumbnailOf(session)),
    session.thumbnail_url && compareChoice(session, heading),
    el("div", { class: "buttons" },
      reach(session.report_url, "sessions.report"),
      reach(session.image_url, "sessions.image"),
      reach(session.timelapse_url, "sessions.timelapse"),
      reach(session.download_url, "sessions.download", { download: true }),
      session.picture_url && el("button", { type: "button", "aria-describedby": heading, onclick: draw }, phrase("sessions.draw")),
      link.role === "control" && session.picture_url && el("button", { type: "button", "aria-describedby": heading, onclick: () => openMarks(session) }, phrase("marks.title")),
      el("button", { type: "button", "aria-describedby": heading, onclick: check }, phrase("sessions.check"))),
    result);
}

/** Hide the sessions in whose text a searched word does not occur. */
function searchSessions() {
  const words = $("session-search").querySelector("input").value.toLowerCase().split(" ");
  for (const item of $("session-list").children) {
    const text = item.textContent.toLowerCase();
    item.hidden = !words.every((word) => text.includes(word));
  }
  say($("no-match"), [...$("session-list").children].every((item) => item.hidden) ? phrase("sessions.no_match") : "");
}

$("list-sessions").onclick = listSessions;
$("session-search").oninput = searchSessions;
