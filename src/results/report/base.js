"use strict";
// What every section uses: elements, numbers with units, the hint beside the pointer, the selected configuration.

const DATA = JSON.parse(document.getElementById("data").textContent);
const RESULT = DATA.result || {};
const SVG = "http://www.w3.org/2000/svg";

// Children that are text become text: no name can become an element.
function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "text") node.textContent = value;
    else node.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children.flat(3)) {
    if (child !== undefined && child !== null && child !== false) node.append(child);
  }
  return node;
}
const el = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
const svg = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);

// A name that somebody gave: in its own direction of writing, and cut where it would break the layout.
function cut(text, most = 28) {
  const letters = Array.from(String(text));
  return letters.length > most ? letters.slice(0, most - 1).join("") + "…" : letters.join("");
}
const named = (text, most) => el("bdi", { class: "name", title: String(text) }, cut(text, most || 60));

// Numbers look the same in every locale.
function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}
function short(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) {
    const [mantissa, exponent] = value.toExponential(Math.max(0, digits - 1)).split("e");
    const raised = exponent.replace("+", "").replace("-", "−");
    return mantissa.replace("-", "−") + "·10" + Array.from(raised, (c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"["0123456789".indexOf(c)] || "⁻").join("");
  }
  return fixed(value, Math.max(0, digits - 1 - Math.floor(Math.log10(size))));
}
const DEGREE = Math.PI / 180;
// Millimetres with a micrometre, or as many digits as something smaller needs.
function mm(metres) {
  if (metres === null || metres === undefined || !Number.isFinite(metres)) return "–";
  const size = Math.abs(metres) * 1e3;
  return size === 0 || size >= 5e-4 ? fixed(metres * 1e3, size >= 100 ? 1 : size >= 10 ? 2 : 3) : short(metres * 1e3, 2);
}
const plural = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
const isLinear = (joint) => joint && joint.type === "prismatic";
const jointUnit = (joint) => (isLinear(joint) ? "mm" : "°");
const jointValue = (joint, value) => (isLinear(joint) ? value * 1e3 : value / DEGREE);

const norm = (v) => Math.hypot(v[0], v[1], v[2]);
const sum = (values) => values.reduce((a, b) => a + b, 0);
const rms = (values) => (values.length ? Math.sqrt(sum(values.map((v) => v * v)) / values.length) : NaN);
function quantile(sorted, p) {
  const at = p * (sorted.length - 1);
  const low = Math.floor(at);
  return sorted[low] + (at - low) * ((sorted[low + 1] === undefined ? sorted[low] : sorted[low + 1]) - sorted[low]);
}

// Points as they are looked at: one for each target of a configuration, the mean of its repeats.
const MEASURED = DATA.measured || null;
const CONFIGURATIONS = MEASURED ? MEASURED.configurations : DATA.configurations || [];
const JOINTS = DATA.robot ? DATA.robot.joints : [];
// As people know them: the controller's with a joint convention, else those of the URDF.
const SHOWN_JOINTS = (MEASURED || DATA).joints || JOINTS;
// The controller's joint that is this one of the URDF alone: {joint, factor, constant}, value = factor * urdf + constant.
function shownAs(joint) {
  const own = joint && SHOWN_JOINTS.find((shown) => shown.urdf && Object.keys(shown.urdf).length === 1 && joint.name in shown.urdf);
  return own ? { joint: own, factor: own.urdf[joint.name], constant: own.constant || 0 } : { joint, factor: 1, constant: 0 };
}
const shownValues = (configuration) => configuration.controller || configuration.joint_values;
// The robot as it is: of a validation it is not known whether it was calibrated.
const NOW = DATA.kind === "validation" ? "error" : "calibrated";
const POINTS = (() => {
  if (!MEASURED) return [];
  const groups = new Map();
  for (const point of MEASURED.points) {
    const key = point.configuration + "/" + point.target + "/" + point.test;
    if (!groups.has(key)) groups.set(key, []);
    groups.get(key).push(point);
  }
  const heldOut = new Map();
  for (const point of RESULT.held_out_points || []) heldOut.set(JSON.stringify([point.configuration, point.target]), point);
  const mean = (rows, field) => (rows[0][field] ? [0, 1, 2].map((i) => sum(rows.map((r) => r[field][i])) / rows.length) : null);
  return Array.from(groups.values(), (rows) => {
    const first = rows[0];
    const configuration = CONFIGURATIONS[first.configuration].name;
    const target = MEASURED.targets[first.target];
    const left = first.test ? undefined : heldOut.get(JSON.stringify([configuration, target]));
    return {
      c: first.configuration, t: first.target, configuration, target, test: first.test, row: first.row, order: first.order, rows: rows.length,
      measured: mean(rows, "measured"), residual: mean(rows, "residual"), before: mean(rows, "before"),
      heldOut: left === undefined ? null : left.distance, heldOutResidual: (left && left.residual) || null,
    };
  });
})();
POINTS.forEach((point, index) => { point.index = index; });

function findingsOf(point) {
  return (RESULT.findings || []).filter((finding) => finding.configuration === point.configuration &&
    (!finding.targets || finding.targets.length === 0 || finding.targets.includes(point.target)));
}
// What a finding names, and what lies beyond five times the usual residual.
const USUAL = (() => {
  const sizes = POINTS.map((p) => norm(p.residual)).sort((a, b) => a - b);
  return sizes.length ? quantile(sizes, 0.5) : 0;
})();
for (const point of POINTS) point.marked = findingsOf(point).length > 0 || norm(point.residual) > 5 * USUAL;

function hintOf(point) {
  const parts = [`Configuration ${cut(point.configuration, 60)}, target ${cut(point.target, 60)}`];
  const sizes = [];
  if (point.before) sizes.push(`nominal ${mm(norm(point.before))} mm`);
  sizes.push(`${NOW} ${mm(norm(point.residual))} mm`);
  if (point.heldOut !== null) sizes.push(`left out ${mm(point.heldOut)} mm`);
  parts.push(sizes.join(", ") + (point.test ? " (test row)" : ""));
  for (const finding of findingsOf(point)) parts.push(finding.message);
  return parts;
}

const TIP = document.getElementById("tip");
function showTip(event, lines) {
  TIP.replaceChildren(...lines.map((line) => el("div", { dir: "auto" }, line)));
  TIP.hidden = false;
  const box = TIP.getBoundingClientRect();
  TIP.style.left = Math.max(8, Math.min(event.clientX + 14, innerWidth - box.width - 8)) + "px";
  TIP.style.top = (event.clientY + 18 + box.height > innerHeight ? event.clientY - box.height - 12 : event.clientY + 18) + "px";
}
const hideTip = () => { TIP.hidden = true; };
addEventListener("scroll", hideTip, { passive: true });

// The configuration that tables, charts and the 3D view show together.
const SELECTED = { c: -1, point: null };
const FOLLOWERS = [];
function select(c, point) {
  SELECTED.c = c;
  SELECTED.point = point || null;
  document.body.dataset.configuration = CONFIGURATIONS[c] ? CONFIGURATIONS[c].name : "";
  for (const row of document.querySelectorAll("tr.selected")) row.classList.remove("selected");
  for (const row of document.querySelectorAll("tr[data-c]")) {
    if (Number(row.dataset.c) === c) row.classList.add("selected");
  }
  for (const follow of FOLLOWERS) follow();
}

// A table; a heading that starts with a space is of numbers. Rows: cells, or {cells, attributes}.
function table(headings, rows, attributes) {
  const numeric = headings.map((heading) => heading.startsWith(" "));
  const cell = (tag, value, column) => {
    const own = el(tag, { class: numeric[column] ? "number" : null, scope: tag === "th" ? "col" : null });
    own.append(value === null || value === undefined ? "–" : value);
    return own;
  };
  const body = rows.map((row) => {
    const cells = Array.isArray(row) ? row : row.cells;
    return el("tr", Array.isArray(row) ? {} : row.attributes, cells.map((value, column) => cell("td", value, column)));
  });
  return el("div", { class: rows.length <= 14 ? "scroll whole" : "scroll", tabindex: "0", role: "group", "aria-label": (attributes && attributes.label) || "Table" },
    el("table", attributes && attributes.class ? { class: attributes.class } : {},
      el("thead", {}, el("tr", {}, headings.map((heading, column) => cell("th", heading.trim(), column)))), el("tbody", {}, body)));
}
const note = (...text) => el("p", { class: "note" }, ...text);
const missing = (why) => el("p", { class: "missing" }, why);
const whyMissing = (what) => (DATA.missing && DATA.missing[what]) || "There are no data for this.";
