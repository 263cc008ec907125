// Start, stop, mark, shutter; each says what it did, from the server's answer.

const ANSWER_MS = 6000;

/** Show what a request did; a failure, or one that leads to a report, stays until it is closed. */
function showAnswer({ ok, text, fix, data }) {
  const report = data?.report_url;
  const close = el("button", { type: "button", onclick: () => line.remove() }, "Close");
  const line = el("p", { class: ok ? null : "failed" }, el("span", {}, [text, fix].filter(Boolean).join(" ")),
    report ? el("a", { class: "button", href: report, target: "_blank", rel: "noopener" }, "Report") : null, close);
  $("answers").replaceChildren(line);
  if (ok && !report) setTimeout(() => line.remove(), ANSWER_MS);
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
    const submit = fields.querySelector("[type=submit]");
    submit.disabled = true;
    const answer = await request(whatOf(fields.elements));
    submit.disabled = false;
    if (answer.ok) dialog.close();
    else say(error, [answer.text, answer.fix].filter(Boolean).join(" "));
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
  const whose = ours === false ? " It was not started from this page." : "";
  const sure = await confirmed("Stop the recording?", `${session ?? "The recording"} ends now and is checked and sealed.${whose}`, "Stop and seal", "Keep recording");
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
