// The band of alarms, its sound (browsers allow it only after a tap) and its vibration.

const SOUND_EVERY_MS = 2500;
const NO_NEWS_MS = 10_000; // a page that hears nothing cannot know that all is well

const alarms = { list: [], audio: null };

on("alarms", (message) => {
  const known = new Set(alarms.list.map((alarm) => alarm.id));
  alarms.list = message.alarms;
  $("alarms").hidden = alarms.list.length === 0;
  $("alarms").replaceChildren(...alarms.list.map(alarmRow));
  fitHeader();
  if (message.alarms.some((alarm) => !known.has(alarm.id) && !alarm.acknowledged)) sound();
});

function alarmRow(alarm) {
  const { id, severity, since_ms: since, acknowledged } = alarm, text = alarmText(alarm);
  const answer = async () => showAnswer(await request({ do: "acknowledge", alarm: id }));
  const button = el("button", { type: "button", class: "control", "aria-label": phrase("alarms.acknowledge.title", { alarm: text }), onclick: answer }, phrase("alarms.acknowledge"));
  button.hidden = link.role !== "control";
  const about = phrase(acknowledged ? "alarms.acknowledged" : "alarms.since", { time: clockTime(since) });
  return el("div", { class: `alarm ${acknowledged ? "info" : severity}` }, el("p", {}, text, el("span", {}, about)), acknowledged ? null : button);
}

/** Keep what is sticky below the header, which grows with its alarms. */
function fitHeader() {
  document.documentElement.style.setProperty("--header", `${document.querySelector("header").offsetHeight}px`);
}

const isAlarming = () => alarms.list.some((alarm) => !alarm.acknowledged && alarm.severity !== "info")
  || (link.lostMs !== null && performance.now() - link.lostMs > NO_NEWS_MS);

/** Three short tones and a vibration, if the sound was switched on. */
function sound() {
  if (!alarms.audio) return;
  const start = alarms.audio.currentTime;
  for (const after of [0, 0.25, 0.5]) {
    const tone = new OscillatorNode(alarms.audio, { type: "square", frequency: 880 });
    const volume = new GainNode(alarms.audio, { gain: 0.2 });
    tone.connect(volume).connect(alarms.audio.destination);
    tone.start(start + after);
    tone.stop(start + after + 0.15);
  }
  navigator.vibrate?.([200, 100, 200]);
}

$("sound").onclick = async () => {
  const audio = alarms.audio;
  alarms.audio = audio ? null : new AudioContext();
  await audio?.close();
  $("sound").setAttribute("aria-pressed", String(alarms.audio !== null));
  say($("sound"), phrase(alarms.audio ? "sound.on" : "sound.off"));
  sound(); // to be heard once, so that one knows
};
setInterval(() => isAlarming() && sound(), SOUND_EVERY_MS);
new ResizeObserver(fitHeader).observe(document.querySelector("header"));
