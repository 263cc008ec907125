// Sessions beside each other: small images in the list, and the chosen ones with their slopes in one table.

const compared = { chosen: new Map(), images: new Map() }; // sessions, and their decoded images, by id

/** A canvas that is filled once the session comes into sight. */
function thumbnailOf(session) {
  if (!session.thumbnail_url) return null;
  const canvas = el("canvas", { class: "thumbnail", width: 4, height: 3, "aria-hidden": true, "data-session": session.id });
  new IntersectionObserver(async ([seen], observer) => {
    if (!seen.isIntersecting) return;
    observer.disconnect();
    const image = await imageOf(session);
    if (image) paintWhole(canvas, image);
    else canvas.remove();
  }).observe(canvas);
  return canvas;
}

async function imageOf({ id, thumbnail_url: url }) {
  if (!compared.images.has(id)) {
    const response = await fetch(url).catch(() => null);
    compared.images.set(id, response?.ok ? await decoded(await response.arrayBuffer()) : null);
  }
  return compared.images.get(id);
}

function paintWhole(canvas, image, [low, high] = [image.header.low_c, image.header.high_c]) {
  Object.assign(canvas, { width: image.header.cols, height: image.header.rows });
  paint(canvas.getContext("2d"), image, low, high);
}

/** Colour all small images anew, as after another palette was chosen. */
function paintThumbnails() {
  for (const canvas of document.querySelectorAll("canvas.thumbnail")) {
    const image = compared.images.get(canvas.dataset.session);
    if (image) paintWhole(canvas, image);
  }
}

function compareChoice(session, heading) {
  const choose = ({ target }) => {
    if (target.checked) compared.chosen.set(session.id, session);
    else compared.chosen.delete(session.id);
    target.parentElement.after($("compare")); // where the finger is
    showCompare();
  };
  return el("label", { class: "check" }, el("input", { type: "checkbox", "aria-describedby": heading, onchange: choose }), phrase("compare.choose"));
}

function forgetChosen() {
  compared.chosen.clear();
  $("session-list").after($("compare"));
  showCompare();
}

function showCompare() {
  $("compare").hidden = compared.chosen.size < 2;
  say($("compare"), phrase("compare.button", { count: compared.chosen.size }));
}

/** One column for each session: its image, all from one scale of temperature, then the slope of each region. */
async function compareSessions() {
  const sessions = [...compared.chosen.values()];
  const images = await Promise.all(sessions.map(imageOf));
  const answers = await Promise.all(sessions.map(({ id }) => request({ do: "slopes", session: id })));
  const failed = answers.find((answer) => !answer.ok);
  if (failed) return showAnswer(failed);
  showColumns(sessions, images);
  showSlopes(answers.map((answer) => answer.data));
  $("compare-dialog").showModal();
  $("compare-title").focus();
}

function showColumns(sessions, images) {
  const known = images.filter(Boolean).map((image) => image.header);
  const scale = [Math.min(...known.map((header) => header.low_c)), Math.max(...known.map((header) => header.high_c))];
  const [low, high] = scale.map((end) => `${number(displayed(end))} ${temperature.unit}`);
  say($("compare-scale"), known.length ? phrase("compare.scale", { low, high }) : "");
  const heads = sessions.map((session, i) => {
    const canvas = images[i] && el("canvas", { role: "img", "aria-label": phrase("compare.image", { session: session.title }) });
    if (canvas) paintWhole(canvas, images[i], scale);
    return el("th", { scope: "col" }, canvas, session.title, el("small", {}, dayTime(session.started_ms)));
  });
  $("compare-head").replaceChildren(el("tr", {}, el("th", { scope: "col" }, phrase("compare.region")), ...heads));
}

function showSlopes(slopes) {
  const names = [...new Set(slopes.flat().map((slope) => slope.region))];
  const cell = (slope) => (slope ? el("td", {}, `${phrase("slope.tilt")} ${slope.tilt}${Number.isFinite(slope.tilt_deg) ? "°" : ""}`, el("small", {}, `${phrase("slope.azimuth")} ${azimuthText(slope)}`), el("small", {}, stateText(slope))) : el("td", {}, "–"));
  const row = (name) => el("tr", {}, el("th", { scope: "row" }, name), ...slopes.map((of) => cell(of.find((slope) => slope.region === name))));
  $("compare-slopes").replaceChildren(...names.map(row));
}

$("compare").onclick = compareSessions;
