// Suggested regions: outlines over the picture, each added by one tap.

const suggesting = { list: [] };

async function suggestRegions() {
  $("suggest").disabled = true;
  const answer = await request({ do: "suggest_regions", session: past.session?.id ?? null });
  $("suggest").disabled = false;
  if (!answer.ok) return showAnswer(answer);
  showSuggestions(answer.data);
  window.scrollTo(0, 0);
  $("suggestion-list").querySelector("button").focus({ preventScroll: true });
}

function showSuggestions(list) {
  suggesting.list = list;
  $("suggestions").hidden = list.length === 0;
  $("suggestion-list").replaceChildren(...list.map(suggestionButton));
  drawOverlay();
}

function suggestionButton(region) {
  const { name, kind, points_px, contrast_k: contrast } = region;
  const add = async () => {
    const answer = await request({ do: "add_region", region: { name, kind, points_px } });
    if (answer.ok) showSuggestions(suggesting.list.filter((other) => other !== region));
    showAnswer(answer);
  };
  return el("button", { type: "button", onclick: add }, phrase("suggest.add", { name }), el("small", {}, `${wordFor("kind", kind)}, ${number(contrast, 1)} K`));
}

$("suggest").onclick = suggestRegions;
$("dismiss-suggestions").onclick = () => showSuggestions([]);
