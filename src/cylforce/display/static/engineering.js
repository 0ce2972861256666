// Signals with age and reason, nodes, cylinders, traffic.
import { count, one, reason, t } from "./words.js";

const at = (id) => document.getElementById(id);
const STATES = { 0: "booting", 4: "stopped", 5: "operational", 127: "pre-operational" };
const SHOWN = { Pa: [1e-5, "bar"], rad: [180 / Math.PI, "°"], "rad/s": [180 / Math.PI, "°/s"], K: [1, "K"], m: [1000, "mm"], N: [1e-3, "kN"] };
const RATES = [250, 500]; // kbit/s

function row(cells, bad) {
  const line = document.createElement("tr");
  cells.forEach((text, k) => {
    const cell = document.createElement("td");
    cell.textContent = text;
    if (bad && k === cells.length - 1) cell.className = "bad";
    line.append(cell);
  });
  return line;
}
const age = (ms) => (ms === null ? t("not seen") : `${count(ms)} ms`);

function value(signal) {
  if (signal.value === null) return "–";
  const [factor, unit] = SHOWN[signal.unit] ?? [1, signal.unit];
  return `${one(signal.value * factor)} ${unit}`;
}

export function showEngineering(picture) {
  at("signals").replaceChildren(...picture.signals.map((s) =>
    row([s.name, value(s), age(s.age_ms), s.reason ? reason(s.reason) : t("good")], s.reason !== 0)));
  at("nodes").replaceChildren(...picture.nodes.map((n) => {
    const state = n.state === null ? t("not seen") : t(STATES[n.state] ?? String(n.state));
    const code = n.emergency ? n.emergency.toString(16).toUpperCase().padStart(4, "0") + "h" : t("none");
    return row([`${n.id} ${n.name}`, state, age(n.age_ms), code], n.emergency !== 0);
  }));
  at("cylinders").replaceChildren(...picture.cylinders.map((c) =>
    row([c.name, c.force === null ? "–" : `${one(c.force / 1000)} kN`,
      c.unexplained === null ? "–" : `${count(c.unexplained)} N m`])));
  const kbit = picture.bits_per_second / 1000;
  at("load").textContent = `${count(kbit)} kbit/s` + RATES.map((r) => `, ${count((100 * kbit) / r)} % / ${r} kbit/s`).join("");
}
