// The page's words, asked for once; a language is chosen by ?lang=, else by the browser;
// a unit of mass by ?unit=, else by the display's option.
const kept = new URLSearchParams([...new URLSearchParams(location.search)].filter(([name]) => name === "lang" || name === "unit"));
export const query = kept.size ? `?${kept}` : "";
const words = await (await fetch("/words" + query)).json();

export const t = (text) => words.texts[text] ?? text;
export const reason = (code) => words.reasons[code] ?? "";
export const status = (code) => words.statuses[code] ?? "";
export const refusal = (code) => words.refusals[code] ?? code;
export const language = words.language;

const whole = new Intl.NumberFormat(language, { maximumFractionDigits: 0 });
const decimals = (digits) => new Intl.NumberFormat(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
const tenth = decimals(1);
export const unit = words.unit;
const [coarse, fine] = [decimals(unit.digits), decimals(unit.fine)];
export const count = (value) => whole.format(value);
export const bare = (kg) => coarse.format(kg / unit.kg);
export const mass = (kg) => `${bare(kg)} ${unit.symbol}`;
export const exact = (kg) => `${fine.format(kg / unit.kg)} ${unit.symbol}`;
export const doubt = (kg) => coarse.format(Math.ceil((kg / unit.kg) * 10 ** unit.digits) / 10 ** unit.digits);
export const one = (value) => tenth.format(value);
export const when = (iso) => new Date(iso).toLocaleString(language, { dateStyle: "short", timeStyle: "medium" });

export function translate(root) {
  for (const element of root.querySelectorAll("[data-t]")) element.textContent = t(element.dataset.t);
}
