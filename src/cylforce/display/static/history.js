// Bookings, totals, tickets.
import { change } from "./ask.js";
import { exact, mass, query, t, when } from "./words.js";

const at = (id) => document.getElementById(id);
const TOTALS = { short: "Short total", shift: "Shift total", grand: "Grand total" };

export async function showHistory() {
  const answer = await fetch("/history");
  const said = await answer.json();
  at("no-records").textContent = said.records ? "" : said.why ?? t("There are no records: start the service with --records.");
  at("bookings").replaceChildren(...(said.bookings ?? []).map(line));
  at("totals").replaceChildren(...Object.entries(said.totals ?? {}).map(total));
}

function line(booking) {
  const row = document.createElement("tr");
  const weight = `${exact(booking.mass_kg)} ± ${exact(booking.standard_error_kg)}`;
  const product = booking.product_name ?? (booking.product || t("none"));
  const taken = booking.status === "BY_HAND" ? t("by hand") : t("accepted");
  const state = booking.accepted ? taken : t("cancelled");
  for (const text of [booking.booking, when(booking.time), booking.truck, product, weight, state]) {
    row.append(Object.assign(document.createElement("td"), { textContent: text }));
  }
  const button = Object.assign(document.createElement("button"), { textContent: t("Print ticket") });
  button.dataset.truck = booking.truck;
  button.addEventListener("click", () => print(booking.truck));
  row.append(document.createElement("td"));
  row.lastChild.append(button);
  return row;
}

async function print(truck) {
  const said = await change("/print", { truck });
  if (said.done) location.href = `/ticket/${truck}${query}`;
  else at("no-records").textContent = t("No bucket of this truck counts: there is no ticket.");
}

function total([which, products]) {
  const box = document.createElement("div");
  const sum = products.reduce((all, p) => all + p.mass_kg, 0);
  const loads = products.reduce((all, p) => all + p.loads, 0);
  const parts = products.map((p) => `${p.product || t("none")}: ${mass(p.mass_kg)}`).join(", ");
  box.append(Object.assign(document.createElement("b"), { textContent: `${t(TOTALS[which])}: ${mass(sum)}` }));
  box.append(Object.assign(document.createElement("p"), { textContent: `${t("Loads")}: ${loads}. ${parts}` }));
  if (which !== "grand") {
    const button = Object.assign(document.createElement("button"), { textContent: t("Set to zero") });
    button.addEventListener("click", async () => {
      await change("/zero-total", { which });
      await showHistory();
    });
    box.append(button);
  }
  return box;
}
