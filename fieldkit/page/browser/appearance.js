// How this device shows the page: theme and language. Both are remembered here; the server reads the language's cookie.

const THEMES = ["device", "sunlight", "dark"];
const prefersDark = matchMedia("(prefers-color-scheme: dark)");

function applyTheme() {
  const chosen = $("theme").value;
  document.documentElement.dataset.theme = chosen === "device" ? (prefersDark.matches ? "dark" : "sunlight") : chosen;
}

function chooseTheme() {
  localStorage.setItem("theme", $("theme").value);
  applyTheme();
}

/** The server writes the document in the chosen language. */
function chooseLanguage() {
  document.cookie = `language=${$("language").value}; max-age=31536000; path=/; samesite=strict`;
  location.reload();
}

$("theme").append(...THEMES.map((theme) => el("option", { value: theme }, phrase(`theme.${theme}`))));
$("theme").value = THEMES.includes(localStorage.getItem("theme")) ? localStorage.getItem("theme") : "device";
$("theme").onchange = chooseTheme;
prefersDark.onchange = applyTheme;
applyTheme();
$("language").append(...Object.entries(LANGUAGES).map(([code, name]) => el("option", { value: code, lang: code }, name)));
$("language").value = document.documentElement.lang;
$("language").onchange = chooseLanguage;
