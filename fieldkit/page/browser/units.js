// Temperatures in the unit that this device shows; everything else, and every file, is in °C or kelvin.

const UNITS = ["°C", "°F"];
const temperature = { unit: UNITS.includes(localStorage.getItem("unit")) ? localStorage.getItem("unit") : "°C" };

const displayed = (celsius) => (temperature.unit === "°F" && Number.isFinite(celsius) ? celsius * 1.8 + 32 : celsius);
const fromDisplayed = (value) => (temperature.unit === "°F" ? (value - 32) / 1.8 : value);

/** A value and its unit as shown; what is no temperature stays as it is. */
const inUnit = (value, unit = "°C") => (unit === "°C" ? [displayed(value), temperature.unit] : [value, unit]);

function labelUnits() {
  for (const label of document.querySelectorAll(".unit")) say(label, temperature.unit);
}

/** Show everything anew in another unit; the choice is kept on this device. */
function chooseUnit(unit) {
  temperature.unit = unit;
  localStorage.setItem("unit", unit);
  labelUnits();
  regions.cards.clear();
  for (const type of ["regions", "minute", "now"]) if (link.last[type]) handle(link.last[type]);
  showLock();
  if (picture.header) draw();
}

$("unit").append(...UNITS.map((unit) => el("option", { value: unit }, unit)));
$("unit").value = temperature.unit;
$("unit").onchange = () => chooseUnit($("unit").value);
labelUnits();
