// Every text of the page, from the catalogue of its language; what happened arrives as kinds and values.

const TEXTS = {{texts}};
const LANGUAGES = {{languages}}; // their own names by code

/** A text with its `{slots}` filled; `{count:sample|samples}` is one for a count with its noun. */
const filled = (text, values) =>
  text.replace(/\{(\w+)(?::(\w+)\|(\w+))?\}/g, (_, name, noun, nouns) => {
    const value = values[name] ?? "–";
    return noun ? `${value} ${`${value}` === "1" ? noun : nouns}` : value;
  });

/** A text in which sessions have the names that they were given; their ids begin with the time. */
const withNames = (text) => text.replace(/\b\d{8}T\d{6}Z-/g, "");

const phrase = (key, values = {}) => withNames(filled(TEXTS[key], values));

/** The word for a name of the product, such as a state; a name that the catalogue has not is shown as it is. */
const wordFor = (group, name) => TEXTS[`${group}.${name}`] ?? name;

/** An event by the most particular text that the catalogue has for its kind and data, whose later names are more particular. */
function eventText({ kind, stream, severity, time_ms, text, data }) {
  const names = Object.keys(data).reverse().flatMap((name) => [`.${name}.${data.phase}`, `.${name}.${data[name]}`, `.${name}`]);
  const key = [...names, `.${data.phase}`, `.${severity}`, ""].map((end) => `event.${kind}${end}`).find((name) => name in TEXTS);
  const values = Object.fromEntries(Object.entries(data).map(([name, value]) => [name, shownValue(name, value)]));
  const mark = markText({ kind: data.label, text, time_ms, end_ms: data.end_ns / 1e6 });
  return key ? phrase(key, { ...values, stream, mark, alarm: data.condition && alarmText(data) }) : text;
}

/** A value of an event's data: durations and times by the unit in their name, numbers with two decimals at most. */
function shownValue(name, value) {
  if (name.endsWith("_s")) return duration(value);
  if (name.endsWith("_ns")) return value > 1e17 ? clockTime(value / 1e6, minuteTime) : `${value < 0 ? "−" : ""}${duration(Math.abs(value) / 1e9)}`;
  if (name === "refusals") return inLanguage(value);
  return typeof value === "number" ? number(value, value % 1 ? 2 : 0) : Array.isArray(value) ? value.join(", ") : value;
}

/** A mark with its kind and how long it lasted: `cloud, 3 min: over the ridge`. */
function markText({ kind, text, time_ms: start, end_ms: end }) {
  const about = [kind && wordFor("mark.kind", kind), end > start ? duration((end - start) / 1000) : ""].filter(Boolean).join(", ");
  return about && text !== kind ? `${about}: ${text}` : about || text;
}

const alarmText = ({ condition, subject }) => phrase(`alarm.${condition}`, { subject });

/** What is wrong with a region or a session; an event is in its own words, which name what it is about. */
function issueText({ what, text, happened }) {
  if (happened) return filled(text, { event: eventText(happened) });
  return what ? `${what}: ${text}` : text;
}

const issuesText = (issues) => issues.map(issueText).join(phrase("language.between"));

/** What a request did, or why not and what to do next. */
const answerText = ({ event, data, text }) => (event ? eventText(event) : withNames([text, issuesText(data?.issues ?? [])].filter(Boolean).join(" ")));

/** An answer that never left this page. */
const unanswered = (key) => ({ ok: false, key, text: phrase(key) });

/** A text of a message for every browser, which has it in each language. */
const inLanguage = (texts) => texts?.[phrase("language.code")];
