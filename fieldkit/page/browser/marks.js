// Marks of the recording or of a past session: edited and taken back; the session keeps them as they were made.

const MARKS_EVERY_MS = 1000; // a recording stores them within a second or two
const marks = { session: null, shown: "", timer: 0 };

/** List the marks of a session of the list, or of the recording, which are asked for again until the dialog is closed. */
async function openMarks(session) {
  Object.assign(marks, { session, shown: "" });
  const answer = await listMarks();
  if (!answer.ok) return showAnswer(answer);
  say($("marks-title"), phrase("marks.title.of", { session: session?.title ?? status.state.session }));
  if (!$("marks-dialog").open) $("marks-dialog").showModal();
  $("marks-title").focus();
  clearInterval(marks.timer);
  if (!session) marks.timer = setInterval(() => ($("marks-dialog").open ? listMarks() : clearInterval(marks.timer)), MARKS_EVERY_MS);
}

const ofMarks = (what) => request({ ...what, session: marks.session?.id ?? null });

async function listMarks() {
  const answer = await ofMarks({ do: "marks" }), listed = JSON.stringify(answer.data);
  if (!answer.ok || listed === marks.shown) return answer;
  marks.shown = listed;
  const list = $("mark-list"), touched = [...list.children].findIndex((item) => item.contains(document.activeElement));
  list.replaceChildren(...(answer.data.length ? answer.data.map(markItem) : [el("li", {}, phrase("marks.none"))]));
  list.children[touched]?.querySelector("button")?.focus(); // it was replaced
  return answer;
}

async function correctMark(what) {
  const error = $("marks-dialog").querySelector(".error"), answer = await ofMarks(what);
  error.hidden = answer.ok;
  say(error, answer.ok ? "" : answerText(answer));
  listMarks();
}

function markItem(mark) {
  const words = `${mark.mark}: ${clockTime(mark.time_ms)} ${markText(mark)}`;
  const button = (key, onclick) => el("button", { type: "button", "aria-label": phrase("marks.button", { action: phrase(key), mark: words }), onclick }, phrase(key));
  return el("li", { class: mark.counts ? null : "gone" }, el("p", {}, words, mark.counts ? null : el("small", {}, ` ${phrase("marks.taken_back")}`)),
    el("div", { class: "buttons" }, ...(mark.counts
      ? [button("action.edit", () => editMark(mark)), button("marks.take_back", () => correctMark({ do: "take_back", mark: mark.mark }))]
      : [button("marks.restore", () => correctMark({ do: "edit_mark", mark: mark.mark }))])));
}

function editMark(mark) {
  const { session } = marks;
  $("marks-dialog").close();
  const field = openMarkFields(true);
  const kinds = [...field.kind].map((choice) => choice.value);
  field.kind.value = kinds.includes(mark.kind) ? mark.kind : "";
  field.text.value = mark.text;
  ask("mark-dialog", (now) => ({
    do: "edit_mark", mark: mark.mark, session: session?.id ?? null, text: now.text.value.trim() || mark.text,
    kind: kinds.includes(mark.kind) ? now.kind.value : now.kind.value || null,
    at: now.at.value === "same" ? null : now.time.value,
  }), () => openMarks(session));
}

/** The fields of a mark, emptied: of a new one, or of one that is edited. */
function openMarkFields(isEdit) {
  const form = $("mark-dialog").querySelector("form"), field = form.elements;
  form.reset();
  form.classList.toggle("editing", isEdit);
  say($("mark-title"), phrase(isEdit ? "mark.title.edit" : "mark.title"));
  $("mark-kept").hidden = !isEdit;
  field.at.value = isEdit ? "same" : "-0s";
  showFields();
  return field;
}

$("edit-marks").onclick = () => openMarks(null);
