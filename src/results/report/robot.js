// The section with the robot in 3D, and the table of points that belongs to it.

function toggle(view, layer, text, kind) {
  const show = (event) => {
    view.layers[layer] = event.target.checked;
    for (const legend of document.querySelectorAll(`[data-of-layer=${layer}]`)) legend.hidden = !event.target.checked;
    view.draw();
  };
  const box = el("input", { type: "checkbox", "data-layer": layer, onchange: show });
  box.checked = view.layers[layer];
  return el("label", { class: "toggle" }, box, kind ? el("span", { class: "key " + kind, "aria-hidden": "true" }) : null, text);
}

// The slider counts decades: from true size to a hundred thousand times.
function slider(view) {
  const output = el("output", {});
  const range = el("input", { type: "range", min: 0, max: 5, step: 0.05, id: "exaggeration", "aria-label": "Exaggeration of the errors" });
  const show = () => {
    view.exaggeration = Math.pow(10, Number(range.value));
    output.textContent = `errors × ${short(view.exaggeration, 2)}`;
    view.draw();
  };
  range.addEventListener("input", show);
  range.value = Math.log10(view.exaggeration).toFixed(2);
  output.textContent = `errors × ${short(view.exaggeration, 2)}`;
  return el("label", { class: "slider" }, range, output);
}

// So that both errors show, in steps of 1, 2 and 5: the larger is drawn as a twentieth of the scene, or so large that the
// smaller can be seen, as long as the larger stays within the scene.
function usualExaggeration(view, large, small) {
  const wanted = Math.max((0.07 * view.radius) / large, small > 0 ? Math.min((0.012 * view.radius) / small, view.radius / large) : 0);
  const power = Math.pow(10, Math.floor(Math.log10(wanted)));
  return Math.max(1, Math.min(1e5, [5, 2, 1].map((f) => f * power).find((v) => v <= wanted) || power));
}

function viewer(scene, layers, extra) {
  const canvas = el("canvas", { id: "view", tabindex: "0", role: "img",
    "aria-label": "Robot and measured points in 3D. Arrow keys turn, shift and arrow keys move, plus and minus zoom, 0 resets, n and p choose a configuration." });
  const view = new View(canvas, scene);
  const sizes = (kind) => scene.points.flatMap((p) => (p.arrows || []).filter((a) => a.kind === kind).map((a) => norm(a.vector)));
  const [before, after] = [rms(sizes("before")) || 0, rms(sizes("after")) || 0];
  view.exaggeration = usualExaggeration(view, Math.max(before, after) || 1e-3, Math.min(before || after, after || before));
  for (const [layer, , , shown] of layers) view.layers[layer] = shown !== false;
  const chosen = el("p", { class: "chosen", "aria-live": "polite" });
  FOLLOWERS.push(() => {
    const configuration = scene.configurations[SELECTED.c];
    if (configuration) {
      const joints = shownValues(configuration).map((value, j) => `${cut(SHOWN_JOINTS[j].name, 12)} ${fixed(jointValue(SHOWN_JOINTS[j], value), 2)} ${jointUnit(SHOWN_JOINTS[j])}`);
      const target = SELECTED.point ? [", target ", named(SELECTED.point.target, 40)] : [];
      chosen.replaceChildren("Configuration ", named(configuration.name, 40), ...target, ": ", el("span", { class: "joints" }, joints.join(", ")));
    }
    view.draw();
  });
  const button = (text, label, act) => el("button", { type: "button", "aria-label": label, title: label, onclick: act }, text);
  const controls = el("div", { class: "controls" }, before + after > 0 ? slider(view) : null,
    el("span", { class: "toggles" }, layers.map(([layer, text, kind]) => toggle(view, layer, text, kind))));
  const buttons = el("span", { class: "buttons" }, button("+", "Nearer", () => view.nearer(1.2)), button("−", "Farther", () => view.nearer(1 / 1.2)),
      button("↺", "Turn to the left", () => view.turn(-0.3, 0)), button("↻", "Turn to the right", () => view.turn(0.3, 0)),
      ...(scene.axes ? [["3D", 0.7, 0.35], ["side", 0, 0], ["front", Math.PI / 2, 0], ["top", 0, 1.55]].map(([text, yaw, pitch]) =>
        button(text, `The view from ${text === "3D" ? "an edge" : "the " + text}`, () => view.turn(view.yaw - yaw, pitch - view.pitch))) : []),
      button("reset", "The view as it was", () => { view.reset(); view.draw(); }));
  window.kdlcalView = view;
  return el("div", { class: "view" }, el("div", { class: "stage" }, canvas, buttons), controls, extra || null, chosen);
}

function cellsLegend(cells) {
  const values = cells.map((c) => c.mean);
  const ramp = svg("svg", { class: "ramp", "shape-rendering": "crispEdges", viewBox: "0 0 50 1", preserveAspectRatio: "none", "aria-hidden": "true" },
    Array.from({ length: 50 }, (_, i) => svg("rect", { x: i, y: 0, width: 1.1, height: 1, fill: tone(i / 49) })));
  return el("p", { class: "ramplegend", "data-of-layer": "cells", hidden: true }, "Predicted 1 σ of a point in each cell: ", `${mm(Math.min(...values))} mm `, ramp, ` ${mm(Math.max(...values))} mm`);
}

function measuredScene(cells) {
  const X_BW = inverse(DATA.robot.base);
  const points = POINTS.map((point) => ({
    place: moved(X_BW, point.measured), c: point.c, marked: point.marked,
    arrows: [["before", point.before], ["after", point.residual], ["held", point.heldOutResidual]]
      .filter(([, error]) => error).map(([kind, error]) => ({ kind, vector: turned(X_BW, error) })),
    lines: () => hintOf(point), choose: () => select(point.c, point),
  }));
  const tracker = [X_BW[3], X_BW[7], X_BW[11]];
  return { robot: DATA.robot, configurations: CONFIGURATIONS, points, cells, cell: (RESULT.predicted_accuracy || {}).cell, tracker };
}

function robotInSpace() {
  if (!DATA.robot) return missing(whyMissing("robot"));
  const cells = (RESULT.predicted_accuracy || {}).cells || [];
  const scene = MEASURED ? measuredScene(cells) : { robot: DATA.robot, configurations: [], points: [], cells, cell: (RESULT.predicted_accuracy || {}).cell };
  const layers = [["robot", "robot", null], ["points", "points", null]];
  if (POINTS.some((p) => p.before)) layers.push(["before", "nominal, base and tool registered to all points", "before"]);
  if (POINTS.length) layers.push(["after", NOW, "after"]);
  if (POINTS.some((p) => p.heldOutResidual)) layers.push(["held", "left out", "held"]);
  if (cells.length) layers.push(["cells", "predicted accuracy", "cells", false]);
  return [
    viewer(scene, layers, cells.length ? cellsLegend(cells) : null),
    note(DATA.robot.shapes.length ? null : "The URDF has meshes only, or no shapes: the arm is drawn as its skeleton. ",
      POINTS.length ? "An arrow points from where a target was expected to where it was measured, the mean of its repeats. Choose a point to see the arm there; drag to turn, Shift and drag to move, and once the picture has the focus use wheel and keys." :
        whyMissing("measurements")),
    POINTS.length ? pointsTable() : null,
  ];
}

const MOST_ROWS = 200;
function pointsTable() {
  const sorted = POINTS.slice().sort((a, b) => norm(b.residual) - norm(a.residual));
  const shown = sorted.slice(0, MOST_ROWS);
  const before = POINTS.some((p) => p.before);
  const held = POINTS.some((p) => p.heldOut !== null);
  const headings = ["configuration", "target", "rows", before ? " nominal [mm]" : null, ` ${NOW} [mm]`, held ? " left out [mm]" : null, "remark"].filter((h) => h !== null);
  const rows = shown.map((point) => {
    const choose = el("button", { type: "button", class: "link", onclick: () => select(point.c, point) }, named(point.configuration, 24));
    const remark = [...findingsOf(point).map((f) => f.kind.replace(/_/g, " ")), point.marked && !findingsOf(point).length ? "large" : null].filter(Boolean).join(", ");
    const cells = [choose, named(point.target, 24), (point.test ? "test" : "fitted") + (point.rows > 1 ? ` × ${point.rows}` : "")];
    if (before) cells.push(point.before ? mm(norm(point.before)) : null);
    cells.push(mm(norm(point.residual)));
    if (held) cells.push(point.heldOut === null ? null : mm(point.heldOut));
    cells.push(remark);
    return { cells, attributes: { "data-c": point.c, class: point.marked ? "marked" : null } };
  });
  return el("details", { open: shown.length <= 12 }, el("summary", {}, `Points, largest first (${shown.length} of ${POINTS.length})`),
    table(headings, rows, { label: "Points", class: "points" }),
    MEASURED.complete ? null : note(`${MEASURED.points.length} of ${MEASURED.rows} measured rows are on this page: evenly spaced ones and the 200 largest.`));
}
