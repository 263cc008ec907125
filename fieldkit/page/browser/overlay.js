// Outlines and names of regions over the picture, the cross, and the draft that is being drawn.

const overlay = $("overlay");
const HIT_PX = 22; // half of the 44 px that a finger needs

const points = (vertices) => vertices.map((vertex) => vertex.join(",")).join(" ");

/** Two outlines, dark under bright, to be seen on every colour. */
const outline = (vertices, tag = "polygon") => ["outline", "outline over"].map((name) => el(tag, { class: name, points: points(vertices) }));

function drawOverlay() {
  overlay.setAttribute("viewBox", `-0.5 -0.5 ${pixels.width} ${pixels.height}`);
  const edited = drawing.draft?.original;
  const focused = document.activeElement?.dataset?.corner;
  overlay.replaceChildren(
    ...regions.list.filter((region) => region.name !== edited && !region.camera).map((region) => regionShape(region)),
    ...suggesting.list.map((region) => regionShape(region, "suggested")),
    ...(drawing.draft ? [draftShape(drawing.draft)] : []),
    ...crossShapes(drawing.draft ? drawing.draft.cursor : picture.probe),
  );
  if (focused !== undefined) overlay.querySelector(`[data-corner="${focused}"]`)?.focus();
}

function regionShape(region, kind = region.kind) {
  const x = Math.min(...region.points_px.map((vertex) => vertex[0])), y = Math.min(...region.points_px.map((vertex) => vertex[1]));
  const letters = 15 / zoom();
  const name = el("text", { x: x + 2 / zoom(), y: y > letters ? y - 4 / zoom() : y + letters, "font-size": letters, "stroke-width": 3.5 / zoom() }, region.name);
  return el("g", { class: kind }, ...outline(region.points_px), name);
}

function draftShape(draft) {
  const shape = draft.closed || draft.vertices.length < 2 ? outline(draft.vertices) : outline(draft.vertices, "polyline");
  return el("g", { class: "draft" }, ...shape, ...draft.vertices.flatMap((vertex, i) => cornerShapes(vertex, i)));
}

function cornerShapes([x, y], i) {
  const hit = el("circle", {
    class: "hit", cx: x, cy: y, r: HIT_PX / zoom(), tabindex: 0, role: "button", "data-corner": i,
    "aria-label": phrase("drawing.corner", { number: i + 1, x, y }),
  });
  return [el("circle", { class: "dot", cx: x, cy: y, r: 6 / zoom() }), hit];
}

function crossShapes(place) {
  if (!place) return [];
  const [x, y] = place, arm = 12 / zoom();
  const d = `M${x - arm} ${y}H${x + arm}M${x} ${y - arm}V${y + arm}`;
  return [el("path", { class: "cross under", d }), el("path", { class: "cross", d })];
}
