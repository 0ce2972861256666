// The arm in its posture, the load in the bucket, the force at the teeth with the area in which it lies (2 standard errors).
const COLOURS = ["#1668b8", "#e06c00", "#2c8a4b", "#8a4fbf"];
const SCALE = 4e-5; // m of arrow per newton: 100 kN are 4 m
const MARGIN = 1.5; // m around all postures seen so far
let box = null; // [left, right, low, high] of all postures seen so far
const NAMESPACE = "http://www.w3.org/2000/svg";

function add(svg, name, attributes, text) {
  const element = document.createElementNS(NAMESPACE, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  svg.append(element);
}
const known = (points) => points.every((p) => p !== null);
const corners = (points) => points.map(([x, z]) => `${x},${-z}`).join(" ");

function lines(svg, name, shapes) {
  for (const points of shapes.filter(known)) {
    const [a, b] = points;
    add(svg, "line", { class: name, x1: a[0], y1: -a[1], x2: b[0], y2: -b[1] });
  }
}

export function drawArm(svg, arm, force, load) {
  svg.replaceChildren();
  if (!arm) return;
  const r = arm.reach;
  frame(svg, arm);
  add(svg, "rect", { class: "house", x: -0.22 * r, y: -0.06 * r, width: 0.2 * r, height: 0.2 * r });
  add(svg, "line", { class: "ground", x1: -r, y1: 0.16 * r, x2: 2 * r, y2: 0.16 * r });
  arm.links.filter(known).forEach((points, k) =>
    add(svg, "polygon", { class: "link", points: corners(points), fill: COLOURS[k % 4], stroke: COLOURS[k % 4] }));
  for (const points of arm.rockers.filter(known)) add(svg, "polygon", { class: "rocker", points: corners(points) });
  lines(svg, "bar", arm.bars);
  lines(svg, "cylinder", arm.cylinders);
  if (!arm.tool) return;
  if (load) drawLoad(svg, arm, load);
  if (force && force.magnitude !== null && force.direction !== null) drawForce(svg, arm.tool, force);
}

function frame(svg, arm) {
  const points = [...arm.links, ...arm.cylinders].flat().filter((p) => p !== null);
  const seen = [...points, [-0.2 * arm.reach, -0.16 * arm.reach]];
  const [x, z] = [seen.map((p) => p[0]), seen.map((p) => p[1])];
  const now = [Math.min(...x), Math.max(...x), Math.min(...z), Math.max(...z)];
  box = box ? box.map((old, k) => (k % 2 ? Math.max(old, now[k]) : Math.min(old, now[k]))) : now;
  const [left, right, low, high] = box;
  svg.setAttribute("viewBox", `${left - MARGIN} ${-high - MARGIN} ${right - left + 2 * MARGIN} ${high - low + 2 * MARGIN}`);
}

function drawLoad(svg, arm, load) {
  const points = arm.links[arm.links.length - 1].filter((p) => p !== null);
  const x = points.reduce((sum, p) => sum + p[0], 0) / points.length;
  const z = points.reduce((sum, p) => sum + p[1], 0) / points.length;
  const radius = 0.15 + 0.5 * Math.sqrt(Math.min(Math.max(load.share, 0), 1.5));
  add(svg, "circle", { class: "load", cx: x, cy: -z, r: radius });
  add(svg, "text", { class: "load-text", x, y: -z - radius - 0.15 }, load.text);
}

function drawForce(svg, [x, z], force) {
  const [dx, dz] = [force.x * SCALE, force.z * SCALE];
  const [ex, ez] = [x + dx, z + dz];
  add(svg, "ellipse", {
    class: "doubt", cx: ex, cy: -ez,
    rx: Math.max(2 * (force.error_x ?? 0) * SCALE, 0.02), ry: Math.max(2 * (force.error_z ?? 0) * SCALE, 0.02),
  });
  add(svg, "line", { class: "force", x1: x, y1: -z, x2: ex, y2: -ez });
  const length = Math.hypot(dx, dz) || 1;
  const [ux, uz] = [dx / length, dz / length];
  const head = [[ex + 0.3 * ux, ez + 0.3 * uz], [ex - 0.16 * uz, ez + 0.16 * ux], [ex + 0.16 * uz, ez - 0.16 * ux]];
  add(svg, "polygon", { class: "head", points: corners(head) });
}
