// The page's words, asked for once; a language is chosen by ?lang=, else by the browser.
const asked = new URLSearchParams(location.search).get("lang");
export const query = asked ? `?lang=${encodeURIComponent(asked)}` : "";
const words = await (await fetch("/words" + query)).json();

export const t = (text) => words.texts[text] ?? text;
export const reason = (code) => words.reasons[code] ?? "";
export const status = (code) => words.statuses[code] ?? "";
export const refusal = (code) => words.refusals[code] ?? code;
export const language = words.language;

const whole = new Intl.NumberFormat(language, { maximumFractionDigits: 0 });
const tenth = new Intl.NumberFormat(language, { minimumFractionDigits: 1, maximumFractionDigits: 1 });
export const kg = (value) => whole.format(value);
export const one = (value) => tenth.format(value);
export const when = (iso) => new Date(iso).toLocaleString(language, { dateStyle: "short", timeStyle: "medium" });

export function translate(root) {
  for (const element of root.querySelectorAll("[data-t]")) element.textContent = t(element.dataset.t);
}
