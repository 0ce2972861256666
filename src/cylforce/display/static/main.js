// Starts the page: which part is shown, the stream, and the watch over it.
import { askNumber, change } from "./ask.js";
import { showEngineering } from "./engineering.js";
import { showHistory } from "./history.js";
import { refusal, t, translate, unit } from "./words.js";
import { blank, showWork } from "./work.js";

const at = (id) => document.getElementById(id);
const PARTS = ["work", "history", "engineering"];
const SILENCE_MS = 800; // a weight that is older is not shown any more
const AGAIN_MS = 3000; // a page that was refused asks again: many of them must not keep the display busy
let [stream, part, heard, last, asked] = [null, "", 0, null, 0];

function open(name) {
  stream?.close();
  stream = new EventSource(`/stream/${name}`);
  asked = performance.now();
  stream.addEventListener("message", (event) => {
    heard = performance.now();
    last = JSON.parse(event.data);
    showWork(last);
    if (name === "engineering") showEngineering(last);
  });
}

function show() {
  const wanted = location.hash.slice(1);
  part = PARTS.includes(wanted) ? wanted : "work";
  for (const name of PARTS) at(name).hidden = name !== part;
  for (const link of document.querySelectorAll("nav a")) link.classList.toggle("here", link.hash === `#${part}`);
  open(part === "engineering" ? "engineering" : "work");
  if (part === "history") showHistory();
}

async function command(what, value = 0) {
  at("answer").textContent = "";
  const said = await change("/command", { what, value });
  at("answer").textContent = said.done ? t("Done.") : refusal(said.why);
}

// Ask for a mass in the page's unit; `present` [kg] is what holds now, null where there is nothing to show.
async function massed(what, question, present) {
  const value = await askNumber(`${t(question)} (${unit.symbol})`, present === null ? null : present / unit.kg);
  if (value !== null) await command(what, value * unit.kg);
}

async function product() {
  const value = await askNumber(t("Number of the product; 0: none"), last?.truck?.product ?? null, { whole: true });
  if (value !== null) await command("product", value);
}

function light(night) {
  document.body.classList.toggle("night", night);
  at("night").textContent = t(night ? "Day" : "Night");
  localStorage.setItem("night", night ? "1" : "");
}

translate(document);
light(localStorage.getItem("night") === "1");
at("night").addEventListener("click", () => light(!document.body.classList.contains("night")));
for (const button of document.querySelectorAll("[data-command]")) {
  button.addEventListener("click", () => command(button.dataset.command));
}
at("target").addEventListener("click", () => massed("target", "Target; 0: none", last?.truck?.target ?? null));
at("product").addEventListener("click", product);
at("trailer").addEventListener("click", () => massed("trailer", "Target of the trailer or next part; 0: none", last?.truck?.trailer ?? null));
at("add").addEventListener("click", () => massed("add", "Mass that was loaded unweighed", null));
at("attachment").addEventListener("change", async () => {
  at("attachment").blur();
  await command("attachment", Number(at("attachment").value));
});
at("cancel").addEventListener("click", () => command("cancel", last?.truck?.last ?? 0));
window.addEventListener("hashchange", show);
blank();
show();
setInterval(() => {
  if (performance.now() - heard > SILENCE_MS) {
    blank();
    if (stream.readyState === EventSource.CLOSED && performance.now() - asked > AGAIN_MS) open(part === "engineering" ? "engineering" : "work");
  }
}, 100);
