// Drawing a region: a rectangle by dragging, a polygon by tapping, corners moved under a loupe, all of it by keyboard too.
// A skyline is drawn like an outline that stays open.

const MOVED_PX = 8; // a finger that moves less has tapped
const EDGE_PX = 16;
const SNAP_PX = 6;
const LOUPE = { across: 14, beside: 60, above: 120 };

// draft: {original, vertices, closed, cursor, history}; grip: what the finger holds
const drawing = { draft: null, grip: null, checking: false, unchecked: false };
const form = $("drawing");

/** Begin with a region to change, or with an empty draft. */
function beginDrawing(region = null) {
  if (!picture.header) return showAnswer(unanswered("drawing.no_image"));
  const kind = region?.kind ?? (regions.list.some((other) => other.kind === "reference") ? "target" : "reference");
  drawing.draft = {
    original: region?.name ?? null, vertices: region?.points_px.map((vertex) => [...vertex]) ?? [],
    closed: region !== null, cursor: null, history: [],
  };
  form.elements.kind.value = kind;
  form.elements.name.value = region?.name ?? freeName(kind);
  for (const key of ["tilt_deg", "azimuth_deg", "emissivity"]) form.elements[key].value = region?.[key] ?? "";
  if (!region && kind === "reference") form.elements.tilt_deg.value = 0;
  say($("drawing-title"), region ? phrase("drawing.region", { name: region.name }) : phrase("drawing.new"));
  $("remove-region").hidden = region === null;
  $("skyline-choice").hidden = region !== null;
  $("blackbody-choice").hidden = kind !== "blackbody"; // its probes are in the campaign's file
  $("drawing-error").hidden = true;
  $("answers").replaceChildren();
  changed();
  window.scrollTo(0, 0);
  stage.focus({ preventScroll: true });
}

/** A name that no region has: `flat` for the first reference, `bed-1`, `bed-2` … */
function freeName(kind) {
  const taken = new Set(regions.list.map((region) => region.name));
  if (kind === "reference" && !taken.has("flat")) return "flat";
  let count = 1;
  while (taken.has(`bed-${count}`)) count++;
  return `bed-${count}`;
}

function endDrawing() {
  Object.assign(drawing, { draft: null, grip: null });
  $("loupe").hidden = true;
  showDrawing();
  window.scrollTo(0, 0);
  $("draw").focus({ preventScroll: true });
}

function showDrawing() {
  const draft = drawing.draft;
  form.hidden = draft === null;
  document.body.classList.toggle("drawing", draft !== null);
  drawOverlay();
  if (!draft) return;
  form.classList.toggle("skyline", isSkyline());
  say($("drawing-help"), helpFor(draft));
  $("undo").disabled = draft.history.length === 0;
  $("close-outline").hidden = draft.closed || isSkyline();
  $("close-outline").disabled = draft.vertices.length < 3;
  $("save-region").hidden = !draft.closed && !(isSkyline() && draft.vertices.length > 1);
  if (!draft.closed) showVerdict({ text: phrase("drawing.corners", { count: draft.vertices.length }) });
}

const isSkyline = () => form.elements.kind.value === "skyline";

/** A skyline is an open line, a region a closed one. */
function changeKind() {
  const { draft } = drawing;
  if (isSkyline() && draft.closed) setVertices(draft.vertices, false);
  else showDrawing();
}

function helpFor(draft) {
  if (isSkyline()) return phrase("drawing.help.skyline");
  if (draft.closed) return phrase("drawing.help.closed");
  if (draft.vertices.length === 0) return phrase("drawing.help.empty");
  return phrase(draft.vertices.length < 3 ? "drawing.help.open" : "drawing.help.closable");
}

// ---- changes of the draft

/** Keep the draft as it is for undo. */
function remember() {
  const { vertices, closed, history } = drawing.draft;
  history.push({ vertices: vertices.map((vertex) => [...vertex]), closed });
}

function undo() {
  const before = drawing.draft?.history.pop();
  if (!before) return;
  Object.assign(drawing.draft, before);
  changed();
}

function changed() {
  showDrawing();
  if (drawing.draft.closed) checkDraft();
}

function setVertices(vertices, closed = drawing.draft.closed) {
  remember();
  Object.assign(drawing.draft, { vertices, closed });
  changed();
}

const within = ([x, y]) => [Math.min(pixels.width - 1, Math.max(0, Math.round(x))), Math.min(pixels.height - 1, Math.max(0, Math.round(y)))];
const rectangle = ([x0, y0], [x1, y1]) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];

/** Beside or in line with a neighbour's bounding box where one is near: regions must not share pixels. */
function snapped([x, y]) {
  if (isSkyline()) return within([x, y]);
  const reach = Math.max(1, SNAP_PX / zoom());
  let [bestX, bestY] = [x, y], [nearX, nearY] = [reach + 0.01, reach + 0.01];
  for (const box of regions.list.filter((region) => region.name !== drawing.draft.original && !region.camera).map((region) => boundsOf(region.points_px))) {
    const besideX = y >= box.top - 1 && y <= box.bottom + 1, besideY = x >= box.left - 1 && x <= box.right + 1;
    for (const at of besideX ? [box.left - 1, box.right + 1] : [box.left, box.right]) {
      if (Math.abs(at - x) < nearX) [bestX, nearX] = [at, Math.abs(at - x)];
    }
    for (const at of besideY ? [box.top - 1, box.bottom + 1] : [box.top, box.bottom]) {
      if (Math.abs(at - y) < nearY) [bestY, nearY] = [at, Math.abs(at - y)];
    }
  }
  return within([bestX, bestY]);
}

function boundsOf(vertices) {
  const x = vertices.map((vertex) => vertex[0]), y = vertices.map((vertex) => vertex[1]);
  return { left: Math.min(...x), right: Math.max(...x), top: Math.min(...y), bottom: Math.max(...y) };
}

// ---- the verdict

/** Have the draft checked while it is drawn: one request at a time, the newest draft wins. */
async function checkDraft(shrink) {
  if (drawing.checking && shrink === undefined) return void (drawing.unchecked = true);
  drawing.checking = true;
  const answer = await request({
    do: "check_region", region: drawnRegion(), instead_of: drawing.draft.original ?? null, session: past.session?.id ?? null,
    ...(shrink === undefined ? {} : { shrink }),
  });
  drawing.checking = false;
  if (!drawing.draft) return;
  if (answer.ok && shrink !== undefined) setVertices(answer.data.points_px.map(within));
  else if (drawing.unchecked) [drawing.unchecked] = [false, checkDraft()];
  else if (drawing.draft.closed) showVerdict(answer.ok ? answer.data : { text: answerText(answer) });
}

function showVerdict({ level = "", issues = [], text = issuesText(issues), pixels: count, spread_c: spread, shrink_px: shrink }) {
  const facts = [count === undefined ? "" : `${number(count)} px`, level === "ok" && Number.isFinite(spread) ? phrase("verdict.spread", { kelvin: number(spread, 2) }) : ""];
  $("verdict").className = level;
  say($("verdict-text"), [...facts, level === "ok" ? phrase("verdict.ok") : text].filter(Boolean).join(", "));
  $("shrink").hidden = !shrink;
  if (shrink) say($("shrink"), phrase("verdict.shrink", { pixels: shrink }));
  $("shrink").onclick = () => checkDraft(shrink);
}

/** The region as drawn and described, as requests carry it. */
function drawnRegion() {
  const field = form.elements, known = (input) => (input.value === "" ? null : Number(input.value));
  return {
    name: field.name.value.trim() || "new", kind: field.kind.value, points_px: drawing.draft.vertices,
    tilt_deg: known(field.tilt_deg), azimuth_deg: known(field.azimuth_deg), emissivity: known(field.emissivity),
  };
}

async function saveRegion(event) {
  event.preventDefault();
  if (isSkyline()) return saveSkyline();
  const region = drawnRegion(), { original, closed } = drawing.draft;
  if (!closed) return drawingError(phrase("drawing.not_closed"));
  const wrong = mistakeIn(form);
  if (wrong) return drawingError(wrong);
  const answer = await request(original ? { do: "edit_region", name: original, region } : { do: "add_region", region });
  if (!answer.ok) return drawingError(answerText(answer));
  endDrawing();
  showAnswer(answer);
}

async function saveSkyline() {
  const answer = await request({ do: "skyline", points: drawing.draft.vertices });
  if (!answer.ok) return drawingError(answerText(answer));
  endDrawing();
  showAnswer(answer);
}

function drawingError(text) {
  say($("drawing-error"), text);
  $("drawing-error").hidden = false;
  $("drawing-error").scrollIntoView({ block: "nearest" });
}

async function removeRegion() {
  const name = drawing.draft.original;
  const sure = await confirmed(phrase("drawing.remove.title", { name }), phrase("drawing.remove.text"), phrase("drawing.remove"), phrase("drawing.remove.no"));
  if (!sure) return;
  const answer = await request({ do: "remove_region", name, confirm: true });
  if (answer.ok) endDrawing();
  showAnswer(answer);
}

// ---- by finger or mouse

const farFrom = (event, [x, y]) => {
  const box = stage.getBoundingClientRect();
  return Math.hypot(event.clientX - box.left - (x + 0.5) * zoom(), event.clientY - box.top - (y + 0.5) * zoom());
};

/** The index of the corner nearest to a pointer, within a finger's reach; -1 if there is none. */
function cornerAt(event) {
  const distances = drawing.draft.vertices.map((vertex) => farFrom(event, vertex));
  const nearest = Math.min(...distances);
  return nearest <= HIT_PX ? distances.indexOf(nearest) : -1;
}

/** The index of the edge under a pointer, by the corner it starts from; -1 if there is none. */
function edgeAt(event) {
  const { vertices } = drawing.draft;
  return vertices.findIndex((from, i) => farFrom(event, nearestOn(from, vertices[(i + 1) % vertices.length], placeOf(event))) <= EDGE_PX);
}

function nearestOn([x0, y0], [x1, y1], [x, y]) {
  const along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2 || 1);
  const share = Math.min(1, Math.max(0, along));
  return [x0 + share * (x1 - x0), y0 + share * (y1 - y0)];
}

const isInside = ([x, y], vertices) => vertices.reduce((inside, [x0, y0], i) => {
  const [x1, y1] = vertices[(i + 1) % vertices.length];
  return (y0 > y) !== (y1 > y) && x < x0 + ((x1 - x0) * (y - y0)) / (y1 - y0) ? !inside : inside;
}, false);

/** What a pointer takes hold of: a corner, an edge (which gains a corner), the whole, or a new corner. */
function gripAt(event) {
  const { vertices, closed } = drawing.draft, place = placeOf(event), corner = cornerAt(event);
  if (corner >= 0) return { corner, offset: [vertices[corner][0] - place[0], vertices[corner][1] - place[1]], closes: !closed && !isSkyline() && corner === 0 && vertices.length > 2 };
  const edge = closed ? edgeAt(event) : -1;
  if (edge >= 0) {
    vertices.splice(edge + 1, 0, place);
    return { corner: edge + 1, offset: [0, 0], isNew: true };
  }
  if (closed) return isInside(place, vertices) ? { whole: vertices.map((vertex) => [...vertex]), start: place } : null;
  vertices.push(place);
  return { corner: vertices.length - 1, offset: [0, 0], isNew: true, rectangleFrom: vertices.length === 1 && !isSkyline() ? place : null };
}

function press(event) {
  if (!drawing.draft || drawing.grip || !event.isPrimary || event.button !== 0) return;
  event.preventDefault();
  remember();
  drawing.grip = gripAt(event);
  if (!drawing.grip) return void drawing.draft.history.pop();
  Object.assign(drawing.grip, { downX: event.clientX, downY: event.clientY, moved: false });
  Object.assign(drawing.draft, { cursor: null });
  stage.setPointerCapture(event.pointerId);
  showDrawing();
  if (drawing.grip.corner !== undefined) showLoupe(event, drawing.draft.vertices[drawing.grip.corner]);
}

function drag(event) {
  const { draft, grip } = drawing;
  if (!draft || !grip) return;
  grip.moved ||= Math.hypot(event.clientX - grip.downX, event.clientY - grip.downY) > MOVED_PX;
  if (!grip.moved) return;
  const place = placeOf(event);
  if (grip.whole) moveWhole(draft, grip, place);
  else if (grip.rectangleFrom) Object.assign(draft, { vertices: rectangle(snapped(grip.rectangleFrom), snapped(place)), closed: true });
  else draft.vertices[grip.corner] = snapped([place[0] + grip.offset[0], place[1] + grip.offset[1]]);
  changed();
  if (!grip.whole) showLoupe(event, grip.rectangleFrom ? draft.vertices[2] : draft.vertices[grip.corner]);
}

function moveWhole(draft, grip, [x, y]) {
  const box = boundsOf(grip.whole);
  const dx = Math.min(pixels.width - 1 - box.right, Math.max(-box.left, x - grip.start[0]));
  const dy = Math.min(pixels.height - 1 - box.bottom, Math.max(-box.top, y - grip.start[1]));
  draft.vertices = grip.whole.map((vertex) => [vertex[0] + dx, vertex[1] + dy]);
}

function release() {
  const { draft, grip } = drawing;
  if (!draft || !grip) return;
  drawing.grip = null;
  $("loupe").hidden = true;
  if (grip.closes && !grip.moved) draft.closed = true;
  else if (!grip.moved && !grip.isNew) draft.history.pop();
  changed();
}

/** The picture around a corner, enlarged beside the finger that hides it. */
function showLoupe(event, [x, y]) {
  const loupe = $("loupe"), context = loupe.getContext("2d"), scale = loupe.width / LOUPE.across;
  const at = ([px, py]) => [(px - x) * scale + loupe.width / 2, (py - y) * scale + loupe.height / 2];
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, loupe.width, loupe.height);
  context.imageSmoothingEnabled = false;
  context.drawImage(pixels, ...at([-0.5, -0.5]), pixels.width * scale, pixels.height * scale);
  for (const [colour, width] of [["#000", 7], ["#ffe600", 3]]) {
    context.beginPath();
    drawing.draft.vertices.forEach((vertex, i) => context[i ? "lineTo" : "moveTo"](...at(vertex)));
    if (drawing.draft.closed) context.closePath();
    Object.assign(context, { strokeStyle: colour, lineWidth: width });
    context.stroke();
  }
  context.strokeStyle = "#fff";
  context.strokeRect(loupe.width / 2 - scale / 2, loupe.height / 2 - scale / 2, scale, scale);
  const left = event.clientX > window.innerWidth / 2 ? event.clientX - LOUPE.beside - 112 : event.clientX + LOUPE.beside;
  loupe.style.left = `${Math.min(window.innerWidth - 116, Math.max(4, left))}px`;
  loupe.style.top = `${Math.max(4, event.clientY - LOUPE.above)}px`;
  loupe.hidden = false;
}

// ---- by keyboard

function drawByKey(event) {
  const { draft } = drawing, corner = event.target.dataset?.corner, move = moveOf(event);
  if (!draft) return;
  if (event.key === "Escape") endDrawing();
  else if (event.key === "Backspace" || (event.key === "z" && event.ctrlKey)) undo();
  else if (corner !== undefined) changeCorner(event, Number(corner), move);
  else if (move) moveCursor(move);
  else if (event.key === "Enter" || event.key === " ") addAtCursor();
  else return;
  if (event.key !== "Tab") event.preventDefault();
  event.stopImmediatePropagation();
}

function changeCorner(event, i, move) {
  const vertices = drawing.draft.vertices.map((vertex) => [...vertex]);
  const next = vertices[(i + 1) % vertices.length];
  if (move) vertices[i] = within([vertices[i][0] + move[0], vertices[i][1] + move[1]]);
  else if (event.key === "Delete" && vertices.length > (isSkyline() ? 1 : 3)) vertices.splice(i, 1);
  else if (event.key === "Insert") vertices.splice(i + 1, 0, within([(vertices[i][0] + next[0]) / 2, (vertices[i][1] + next[1]) / 2]));
  else return;
  setVertices(vertices);
}

function moveCursor([dx, dy]) {
  const { draft } = drawing;
  const [x, y] = draft.cursor ?? picture.probe ?? [Math.floor(pixels.width / 2), Math.floor(pixels.height / 2)];
  draft.cursor = within([x + dx, y + dy]);
  say($("value"), phrase("drawing.cross", { x: draft.cursor[0], y: draft.cursor[1] }));
  $("value").setAttribute("aria-live", "polite");
  drawOverlay();
}

function addAtCursor() {
  const { draft } = drawing;
  if (draft.closed || !draft.cursor) return;
  setVertices([...draft.vertices, snapped(draft.cursor)]);
}

stage.addEventListener("pointerdown", press);
stage.addEventListener("pointermove", drag);
for (const end of ["pointerup", "pointercancel"]) stage.addEventListener(end, release);
stage.addEventListener("keydown", drawByKey, { capture: true });
form.addEventListener("submit", saveRegion);
form.addEventListener("input", () => { $("drawing-error").hidden = true; });
form.addEventListener("change", (event) => { if (event.target.name === "kind") changeKind(); });
$("undo").onclick = undo;
$("close-outline").onclick = () => setVertices(drawing.draft.vertices, true);
$("cancel-drawing").onclick = endDrawing;
$("remove-region").onclick = removeRegion;
$("draw").onclick = () => beginDrawing();
