// Changes: sent as JSON, with the PIN where one is wanted; it is asked for once and kept until the page is closed.
import { t } from "./words.js";

const at = (id) => document.getElementById(id);

export function ask(question, secret = false) {
  at("question").textContent = question;
  at("entry").value = "";
  at("entry").type = secret ? "password" : "text";
  at("entry").inputMode = "decimal";
  at("ask").showModal();
  return new Promise((done) => {
    at("ask").addEventListener("close", () => done(at("ask").returnValue === "yes" ? at("entry").value : null), { once: true });
  });
}

async function post(address, what) {
  const headers = { "content-type": "application/json", "x-pin": sessionStorage.getItem("pin") ?? "" };
  return fetch(address, { method: "POST", headers, body: JSON.stringify(what) });
}

export async function change(address, what) {
  let answer = await post(address, what);
  if (answer.status === 401) {
    const pin = await ask(t("PIN"), true);
    if (pin === null) return { done: false, why: "" };
    sessionStorage.setItem("pin", pin);
    answer = await post(address, what);
    if (answer.status === 401) sessionStorage.removeItem("pin");
  }
  const kind = answer.headers.get("content-type") ?? "";
  return kind.startsWith("application/json") ? answer.json() : { done: false, why: await answer.text() };
}
