// Start, stop, mark, shutter; each shows what it did, from the server's answer.

const ANSWER_MS = { brief: 6000, long: 20_000 };

/** Show what a request did; a failure, and what leads to a report, for longer. Each leaves by itself. */
function showAnswer(answer) {
  const report = answer.data?.report_url;
  const close = el("button", { type: "button", onclick: () => line.remove() }, phrase("action.close"));
  const line = el("p", { class: answer.ok ? null : "failed", "data-key": answer.key || answer.event?.kind }, el("span", {}, answerText(answer)),
    report ? el("a", { class: "button", href: report, target: "_blank", rel: "noopener" }, phrase("sessions.report")) : null, close);
  $("answers").replaceChildren(line);
  removeLater(line, answer.ok && !report ? ANSWER_MS.brief : ANSWER_MS.long);
}

/** Remove a line after a time, but not from under a finger or the focus. */
function removeLater(line, afterMs) {
  setTimeout(() => (line.matches(":hover, :focus-within") ? removeLater(line, ANSWER_MS.brief) : line.remove()), afterMs);
}

/** Ask before something that cannot be taken back; a promise of the decision. */
function confirmed(title, text, yes, no) {
  const dialog = $("confirm-dialog");
  for (const [id, words] of [["confirm-title", title], ["confirm-text", text], ["confirm-yes", yes], ["confirm-no", no]]) say($(id), words);
  dialog.returnValue = "";
  dialog.showModal();
  $("confirm-no").focus();
  return new Promise((resolve) => {
    dialog.onclose = () => resolve(dialog.returnValue === "yes");
    dialog.querySelector("form").onsubmit = (event) => { event.preventDefault(); dialog.close("yes"); };
  });
}

/** Open a dialog whose form makes a request; it stays open with the reason if that fails. */
function ask(id, whatOf, then = () => {}) {
  const dialog = $(id), fields = dialog.querySelector("form"), error = dialog.querySelector(".error");
  error.hidden = true;
  fields.onsubmit = async (event) => {
    event.preventDefault();
    const wrong = mistakeIn(fields);
    say(error, wrong);
    error.hidden = !wrong;
    if (wrong) return;
    const submit = fields.querySelector("[type=submit]");
    submit.disabled = true;
    const answer = await request(whatOf(fields.elements));
    submit.disabled = false;
    if (answer.ok) dialog.close();
    else say(error, answerText(answer));
    error.hidden = answer.ok;
    if (!answer.ok) return;
    showAnswer(answer);
    then();
  };
  dialog.showModal();
}

function startRequest(field) {
  const ends = field.ends.value, include_last = field.begins.value || null;
  return { do: "start", name: field.name.value.trim(), include_last, ...(ends === "stop" ? {} : { [ends]: field[ends].value.trim() }) };
}

function markRequest(field) {
  const at = field.at.value === "time" ? field.time.value : field.at.value;
  const kind = field.kind.value;
  return { do: "mark", text: field.text.value.trim() || kind, kind, at, to: field.since.checked ? "-0s" : null };
}

$("start").onclick = () => ask("start-dialog", startRequest);
$("mark").onclick = () => {
  openMarkFields(false);
  ask("mark-dialog", markRequest);
};
$("shutter").onclick = async () => showAnswer(await request({ do: "shutter" }));
$("stop").onclick = async () => {
  const { phase, session, ours } = status.state;
  if (phase === "waiting") return showAnswer(await request({ do: "stop", confirm: true }));
  const sure = await confirmed(phrase("stop.title"), phrase(ours ? "stop.text" : "stop.text.others", { session }), phrase("stop.yes"), phrase("stop.no"));
  if (sure) showAnswer(await request({ do: "stop", confirm: true }));
};

/** Show the fields that belong to what is chosen. */
function showFields() {
  const start = $("start-dialog").querySelector("form").elements, mark = $("mark-dialog").querySelector("form").elements;
  $("duration-field").hidden = start.ends.value !== "duration";
  $("until-field").hidden = start.ends.value !== "until";
  $("mark-time-field").hidden = mark.at.value !== "time";
}
for (const name of document.querySelectorAll("[name=name]")) name.onfocus = () => name.select(); // typing replaces it
for (const dialog of document.querySelectorAll("dialog")) {
  dialog.querySelector(".cancel").onclick = () => dialog.close();
  dialog.addEventListener("change", showFields);
}
