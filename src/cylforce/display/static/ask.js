// The dialog, and changes: sent as JSON, with the PIN where one is needed. The PIN is kept until the page is closed.
import { formatNumber, parseNumber } from "./numbers.js";
import { language, t } from "./words.js";

const at = (id) => document.getElementById(id);
const EXAMPLE = 1500.5;

// Show the dialog; return what `read` makes of the entry, or null when it is cancelled. `read` throws an Error with
// a sentence for the person where the entry cannot be used: the dialog then stays open and shows it.
function ask(question, { entry = "", secret = false, read = (text) => text } = {}) {
  const [dialog, field] = [at("ask"), at("entry")];
  let value = null;
  at("question").textContent = question;
  at("complaint").textContent = "";
  field.value = entry;
  field.type = secret ? "password" : "text";
  field.inputMode = "decimal";
  const submit = (event) => {
    value = null;
    if (event.submitter?.value === "no") return;
    try {
      value = read(field.value);
    } catch (error) {
      event.preventDefault();
      at("complaint").textContent = error.message;
      field.select();
    }
  };
  dialog.querySelector("form").addEventListener("submit", submit);
  dialog.returnValue = "";
  dialog.showModal();
  field.select();
  return new Promise((done) => {
    dialog.addEventListener("close", () => {
      dialog.querySelector("form").removeEventListener("submit", submit);
      done(dialog.returnValue === "yes" ? value : null);
    }, { once: true });
  });
}

// Ask for a number of at least 0, as the page's language writes it. `present` is the value now; null: there is none.
export function askNumber(question, present, { whole = false } = {}) {
  const read = (text) => {
    if (text.trim() === "") throw new Error(t("Nothing was entered: write a number, or press Cancel."));
    const value = parseNumber(text, language);
    if (value === null) throw new Error(`${t("This is no number. Write it like this:")} ${formatNumber(whole ? 15 : EXAMPLE, language)}`);
    if (value < 0) throw new Error(t("The number is negative: write 0 or more."));
    if (whole && !Number.isInteger(value)) throw new Error(t("Write a whole number."));
    return value;
  };
  return ask(question, { entry: present === null ? "" : formatNumber(present, language), read });
}

async function post(address, what) {
  const headers = { "content-type": "application/json", "x-pin": sessionStorage.getItem("pin") ?? "" };
  return fetch(address, { method: "POST", headers, body: JSON.stringify(what) });
}

export async function change(address, what) {
  let answer = await post(address, what);
  if (answer.status === 401) {
    const pin = await ask(t("PIN"), { secret: true });
    if (pin === null) return { done: false, why: "" };
    sessionStorage.setItem("pin", pin);
    answer = await post(address, what);
    if (answer.status === 401) sessionStorage.removeItem("pin");
  }
  const kind = answer.headers.get("content-type") ?? "";
  return kind.startsWith("application/json") ? answer.json() : { done: false, why: await answer.text() };
}
