// The operator's page. A weight that is not valid is shown as its reason, never as a number.
import { drawArm } from "./arm.js";
import { bare, count, doubt, exact, mass, one, reason, status, t, unit } from "./words.js";

const at = (id) => document.getElementById(id);
const INVALID = 3;

export function showWork(picture) {
  document.body.classList.remove("waiting");
  showWeight(picture.weight, picture.rated);
  showForce(picture.force);
  const hanging = picture.weight.net !== null && picture.weight.net > 0.03 * picture.rated;
  drawArm(at("arm"), picture.arm, picture.force,
    hanging ? { share: picture.weight.net / picture.rated, text: mass(picture.weight.net) } : null);
  showTruck(picture);
  showTools(picture);
}

function showTools({ tools, truck }) {
  const box = at("attachment");
  box.hidden = tools.length < 2;
  if (box.options.length !== tools.length) box.replaceChildren(...tools.map((name, k) => new Option(`${t("Attachment")}: ${name}`, k)));
  if (truck && document.activeElement !== box) box.value = truck.tool;
}

function showWeight(weight, rated) {
  const valid = weight.status !== INVALID && weight.net !== null;
  at("weight").classList.toggle("words", !valid);
  at("weight").replaceChildren();
  if (valid) {
    const small = document.createElement("small");
    small.textContent = ` ${unit.symbol} ± ${doubt(weight.error)}`;
    at("weight").append(bare(weight.net), small);
  } else {
    at("weight").textContent = reason(weight.reason);
  }
  at("error-bar").style.width = valid ? `${Math.min(100, (100 * 20 * weight.error) / rated)}%` : "0";
  at("status").textContent = status(weight.status);
  at("status").className = `s${weight.status}`;
  at("reason").textContent = valid ? reason(weight.reason) : "";
  at("gross").textContent = valid ? `${t("net")} ${exact(weight.net)}, ${t("gross")} ${exact(weight.gross)}, ${t("rated")} ${mass(rated)}` : "";
}

function showForce(force) {
  const shown = force.magnitude !== null && force.direction !== null;
  const turn = shown ? `, ${t("direction")} ${count((force.direction * 180) / Math.PI)}°` : "";
  const spread = shown ? ` ± ${one(Math.hypot(force.error_x ?? 0, force.error_z ?? 0) / 1000)}` : "";
  const said = shown ? `${one(force.magnitude / 1000)}${spread} kN${turn}` : reason(force.reason);
  at("force").textContent = `${t("Force at the teeth")}: ${said}`;
}

function colour(share, marks) {
  if (share === null) return "";
  if (share > marks.red) return "red";
  if (share >= marks.green) return "green";
  return share >= marks.amber ? "amber" : "";
}

function showTruck({ truck, marks, buckets, check_zero: checkZero }) {
  at("alarm").hidden = !(truck && truck.records === 2);
  if (truck && truck.records === 2) at("alarm").textContent = t("Records have stopped: the disk is full or cannot be written.");
  at("saved").textContent = truck && truck.records === 1 ? `${t("booked")} ${truck.last}, ${t("on disk")} ${truck.recorded}` : "";
  at("bar").className = truck ? colour(truck.with_bucket, marks) : "";
  const width = (share) => `${Math.min(100, (100 * (share ?? 0)) / 1.25)}%`;
  at("filled").style.width = width(truck?.share);
  at("hanging").style.width = width(truck?.with_bucket);
  at("goal").style.left = "80%";
  at("goal").hidden = !truck || truck.share === null;
  if (!truck) {
    at("truck-text").textContent = reason(255);
    at("advice").textContent = "";
  } else {
    const goal = truck.target > 0 ? ` / ${bare(truck.target)}` : "";
    const split = truck.part > 1;
    const name = `${t("Truck")} ${truck.number}${split ? `, ${t("part")} ${truck.part}` : ""}`;
    const both = split ? `, ${t("in all")} ${mass(truck.total)}` : "";
    at("truck-text").textContent = `${name}: ${bare(truck.loaded)}${goal} ${unit.symbol}${both}, ${t("Buckets")}: ${truck.filled}` +
      (truck.product ? `, ${t("Product")} ${truck.product}` : "");
    at("advice").textContent = [advice(truck), checkZero ? t("Check zero: empty the bucket, lift it, press Zero") : ""].filter(Boolean).join(" – ");
  }
  at("buckets").replaceChildren(...buckets.map((bucket) => {
    const item = document.createElement("li");
    item.textContent = `${bucket.number}: ${mass(bucket.mass)}`;
    return item;
  }));
}

function advice(truck) {
  if (truck.remaining === null) return "";
  if (truck.remaining < 0) return `${mass(-truck.remaining)} ${t("too much")}`;
  if (truck.remaining === 0) return t("Target reached");
  const share = truck.last_bucket && truck.next_share !== null ? ` (${count(100 * truck.next_share)} % ${t("of a usual bucket")})` : "";
  const tip = truck.tip_off === null ? "" : `; ${t("tip off")} ${mass(truck.tip_off)}`;
  const over = truck.overloads ? `; ${t("a full bucket overloads")}` : "";
  return (truck.last_bucket ? `${t("Last bucket")}: ` : "") + `${mass(truck.remaining)} ${t("remaining")}${share}${tip}${over}`;
}

export function blank() {
  at("weight").classList.add("words");
  at("weight").textContent = t("The page gets no data: no weight is shown.");
  at("error-bar").style.width = "0";
  for (const id of ["status", "reason", "gross", "force"]) at(id).textContent = "";
  at("arm").replaceChildren();
}
