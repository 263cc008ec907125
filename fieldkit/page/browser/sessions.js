// Recorded sessions: report, check, download, and drawing on their pictures.

async function listSessions() {
  const answer = await request({ do: "sessions" });
  forgetChosen();
  if (!answer.ok) return showAnswer(answer);
  say($("list-sessions"), "Show again");
  $("session-list").replaceChildren(...answer.data.map(sessionItem));
  $("session-search").hidden = answer.data.length < 2;
  searchSessions();
  if (answer.data.length === 0) $("session-list").append(el("li", {}, "Nothing was recorded yet."));
}

function sessionItem(session) {
  const heading = `session-${session.id}`;
  const result = el("p", { role: "status" });
  const check = async () => {
    say(result, "Checking …");
    const answer = await request({ do: "check_session", session: session.id });
    say(result, [answer.text, answer.fix].filter(Boolean).join(" "));
  };
  const draw = async () => {
    const shown = await openPast(session);
    if (!shown.ok) say(result, [shown.text, shown.fix].filter(Boolean).join(" "));
  };
  const about = [session.state, dayTime(session.started_ms), duration(session.duration_s), size(session.bytes)].join(", ");
  const reach = (url, words, props) => url && el("a", { class: "button", href: url, "aria-describedby": heading, ...props }, words);
  return el("li", {}, el("div", { class: "line" }, el("div", {}, el("h3", { id: heading }, session.title || session.id), el("p", { class: "small" }, about)), thumbnailOf(session)),
    session.thumbnail_url && compareChoice(session, heading),
    el("div", { class: "buttons" },
      reach(session.report_url, "Report", { target: "_blank", rel: "noopener" }) || null,
      reach(session.download_url, "Download", { download: true }) || null,
      session.picture_url && el("button", { type: "button", "aria-describedby": heading, onclick: draw }, "Draw regions"),
      link.role === "control" && session.picture_url && el("button", { type: "button", "aria-describedby": heading, onclick: () => openMarks(session) }, "Marks"),
      el("button", { type: "button", "aria-describedby": heading, onclick: check }, "Check")),
    result);
}

/** Hide the sessions in whose text a searched word does not occur. */
function searchSessions() {
  const words = $("session-search").querySelector("input").value.toLowerCase().split(" ");
  for (const item of $("session-list").children) {
    const text = item.textContent.toLowerCase();
    item.hidden = !words.every((word) => text.includes(word));
  }
  say($("no-match"), [...$("session-list").children].every((item) => item.hidden) ? "No session has these words." : "");
}

$("list-sessions").onclick = listSessions;
$("session-search").oninput = searchSessions;
