// Parameters, effects beyond geometry, influence, convergence, and what to measure next.

const isAngle = (p) => p.kind === "rotation" || p.kind === "joint_offset" && !jointIsLinear(p.joint) || /\.R[xyz]$/.test(p.name);
const jointIsLinear = (name) => JOINTS.some((joint) => joint.name === name && isLinear(joint));
const WEAK = new Set((RESULT.weak || []).flat());
function unitOf(p) {
  return isAngle(p) ? { unit: "°", factor: 1 / DEGREE, decimals: 5 } : { unit: "mm", factor: 1e3, decimals: 4 };
}
// "x shift of link 1": what the letters of a name stand for.
function meaning(p) {
  if (p.kind === "joint_offset") return "zero offset";
  const axis = p.axis || (p.name.match(/[xyz]$/) || [""])[0];
  return `${axis} ${p.kind === "rotation" ? "turn" : "shift"}`;
}

function intervalBar(p, most) {
  const { factor } = unitOf(p);
  const at = (value) => 50 + (46 * value * factor) / (most || 1);
  const half = p.interval_95 ? (p.interval_95[1] - p.interval_95[0]) / 2 : null;
  const clamp = (x) => Math.max(1, Math.min(99, x));
  return svg("svg", { class: "interval", viewBox: "0 0 100 14", preserveAspectRatio: "none", "aria-hidden": "true" },
    svg("line", { class: "nominal", x1: 50, x2: 50, y1: 0, y2: 14 }),
    half === null ? null : svg("rect", { class: "span", x: clamp(at(p.error - half)), y: 4, height: 6, width: Math.max(0.6, clamp(at(p.error + half)) - clamp(at(p.error - half))) }),
    svg("rect", { class: "value", x: clamp(at(p.error)) - 0.5, y: 1, height: 12, width: 1 }));
}
function parameterRows(list) {
  const most = {};
  for (const p of list) {
    const { unit, factor } = unitOf(p);
    const reach = p.interval_95 ? Math.max(Math.abs(p.interval_95[0] - p.nominal), Math.abs(p.interval_95[1] - p.nominal)) : Math.abs(p.error);
    most[unit] = Math.max(most[unit] || 0, reach * factor);
  }
  return list.map((p) => {
    const { unit, factor, decimals } = unitOf(p);
    const half = p.interval_95 ? ((p.interval_95[1] - p.interval_95[0]) / 2) * factor : null;
    const marks = [p.gauge ? "held, gauge" : null, !p.identifiable && !p.gauge ? "not determined" : null, WEAK.has(p.name) ? "weak" : null].filter(Boolean);
    return { cells: [el("strong", { class: "parameter" }, named(p.name, 24)), meaning(p), p.gauge ? null : fixed(p.error * factor, decimals),
      half === null ? (p.gauge ? null : "–") : "± " + fixed(half, decimals), unit, p.gauge ? "" : intervalBar(p, most[unit]), marks.join(", ")],
      attributes: { class: p.gauge ? "gauge" : WEAK.has(p.name) ? "weak" : null } };
  });
}
// A joint of the URDF, with the controller's name of it.
function groupName(name) {
  const shown = shownAs(JOINTS.find((joint) => joint.name === name));
  return shown.joint && shown.joint.urdf ? el("span", {}, named(shown.joint.name, 30), " (", named(name, 60), ")") : named(name, 60);
}
function parameterTables() {
  const groups = new Map();
  const add = (key, p) => groups.set(key, [...(groups.get(key) || []), p]);
  for (const p of RESULT.parameters || []) {
    if (p.name.startsWith("base.") || p.name.startsWith("base[")) continue;
    const point = p.name.lastIndexOf(".");
    if (point > 0 && p.joint === null) continue;
    add(p.joint || "behind the last joint", p);
  }
  if (!groups.size) return missing("No geometric error was estimated.");
  const headings = ["parameter", "what it is", " error", " 95 %", "unit", "about nominal", "remark"];
  const rows = Array.from(groups, ([joint, list]) => [{ cells: [groupName(joint)], attributes: { class: "grouphead" } }, ...parameterRows(list)]).flat();
  const whole = table(headings, rows, { label: "Parameters", class: "parameters" });
  for (const head of whole.querySelectorAll("tr.grouphead td")) head.colSpan = headings.length;
  return whole;
}
function frameRows() {
  const rows = [];
  const digits = (v) => fixed(v * 1e3, 3);
  const bases = RESULT.stations || (RESULT.base ? [RESULT.base] : []);
  for (const base of bases) rows.push([base.name === undefined ? "base, in the measuring device's frame" : el("span", {}, "base, from station ", named(base.name, 24)), ...base.position.map(digits), base.std ? base.std.slice(0, 3).map((v) => (v === null ? "–" : fixed(v * 1e3, 3))).join(", ") : null]);
  for (const target of RESULT.targets || []) {
    rows.push([el("span", {}, "target ", named(target.name, 30), ", on the flange"), ...target.position.map(digits),
      target.std ? target.std.slice(0, 3).map((v) => (v === null ? "–" : fixed(v * 1e3, 3))).join(", ") : null]);
  }
  return rows.length ? table(["frame", " x [mm]", " y [mm]", " z [mm]", " 1 σ [mm]"], rows.slice(0, MOST_ROWS), { label: "Base and targets" }) : null;
}

function heatMap(block) {
  const n = block.names.length;
  return figure({ title: "Strongest correlations", caption: "a dark field: the measurements hardly tell the two apart", class: "heat" }, (width) => {
    const left = 70;
    const size = Math.min(30, (width - left - 8) / n);
    const root = svg("svg", { viewBox: `0 0 ${width} ${size * n + 78}`, width, height: size * n + 78, role: "img", "aria-label": "Correlations of parameters" });
    const places = [];
    block.matrix.forEach((row, r) => {
      root.append(svg("text", { x: left - 6, y: size * (r + 0.5) + 4, "text-anchor": "end" }, cut(block.names[r], 10)),
        svg("text", { x: 0, y: 0, "text-anchor": "end", transform: `translate(${left + size * (r + 0.6)} ${size * n + 8}) rotate(-60)` }, cut(block.names[r], 10)));
      row.forEach((value, c) => {
        const strength = Math.abs(value);
        root.append(svg("rect", { class: value < 0 ? "cell negative" : "cell positive", x: left + size * c + 0.5, y: size * r + 0.5, width: size - 1, height: size - 1, "fill-opacity": (0.06 + 0.94 * strength * strength).toFixed(3) }));
        if (r !== c && strength > 0.3 && size > 17) root.append(svg("text", { class: strength > 0.72 ? "on" : "off", x: left + size * (c + 0.5), y: size * (r + 0.5) + 4, "text-anchor": "middle" }, value < 0 ? "−" : "+"));
        places.push([left + size * (c + 0.5), size * (r + 0.5), () => [`${block.names[r]} and ${block.names[c]}: ${fixed(value, 3)}`], null]);
      });
    });
    pickable(root, places);
    return root;
  });
}

// For mastering: what a controller's display is to grow by, in the steps of a pendant.
const STEP = { "°": 3, mm: 3 };
function offsetOf(offset) {
  const { unit, factor, decimals } = offset.unit === "m" ? { unit: "mm", factor: 1e3, decimals: 4 } : { unit: "°", factor: 1 / DEGREE, decimals: 5 };
  const half = offset.interval_95 && offset.std !== 0 ? ((offset.interval_95[1] - offset.interval_95[0]) / 2) * factor : null;
  const is_shown = half === null || Math.abs(offset.add * factor) > half; // that it is not zero
  return { unit, decimals, half, of: (value) => value * factor, entry: is_shown ? fixed(offset.add * factor, STEP[unit]) : null };
}
const HOW_TO_ENTER = [
  ["FANUC", "SYSTEM, Master/Cal, Single axis master: jog the joint to 0.000 and enter the number as its mastering position (MSTR POS). By counts: the display grows if the mastering count falls, by the number times the counts per degree of the axis."],
  ["ABB", "Jog the joint until its display reads minus the number, then Fine calibration of this joint alone, if its calibration position is 0."],
  ["KUKA", "Add the number to $MAMES of the axis, then master it as before, at the same mark and with the same load."],
  ["Universal Robots", "Leave the zeros alone: kdlcal export --format ur-yaml writes the geometry with the offsets in it."],
];
function enterThis() {
  const offsets = RESULT.joint_offsets;
  if (!offsets) return missing("This needs the controller's joints: calibrate with --joint-convention.");
  if (!RESULT.trusted) return missing("Enter nothing: the calibration is not to be trusted.");
  const entered = RESULT.mastering_entered;
  const alone = offsets.joints.some((offset) => offset.add_if_only_these !== undefined);
  const rows = offsets.joints.map((offset) => {
    const { unit, decimals, of, entry, half } = offsetOf(offset);
    const remark = offset.std === 0 ? "held" : entry === null ? "may be zero: enter nothing" : "";
    const whole = [named(offset.joint, 24), entry === null ? null : el("strong", {}, entry), unit, of(offset.add), half, of(offset.add_if_only_these), remark];
    const shown = offset.measurable ? whole.map((cell) => (typeof cell === "number" ? fixed(cell, decimals) : cell)) : [named(offset.joint, 24), null, "", null, null, null, "leave it: base or targets take it up"];
    if (half !== null && offset.measurable) shown[4] = "± " + shown[4];
    if (!alone) shown.splice(5, 1);
    return shown;
  });
  const file = entered ? "entered_again.csv" : "entered.csv";
  const headings = ["controller's joint", " enter first", "", " exactly", " 95 %", " if nothing else is corrected", ""];
  if (!alone) headings.splice(5, 1);
  const lines = offsets.joints.filter((offset) => offset.measurable && offset.std !== 0 && offsetOf(offset).entry !== null).map((offset) => `${offset.joint},${offsetOf(offset).entry.replace("−", "-")},${offsetOf(offset).unit === "mm" ? "mm" : "deg"}`);
  const csv = ["joint,added,unit", ...lines].join("\n");
  return [
    note("You need not enter anything: compensated programs and the calibrated URDF correct these offsets. If you enter them, go on with the result of kdlcal apply, or they are corrected twice."),
    entered ? note(`Already entered: ${entered.joints.map((joint) => joint.joint).join(", ")}. The table shows the rest, which the result still corrects.`) : null,
    table(headings, rows, { label: "Joint zero offsets", class: "enter" }),
    note("The display of a joint that stands still grows by the number of the column “enter first”. Check this on the display, and move with care: targets that were taught shift as well."),
    lines.length === 0 ? note("Nothing needs to be entered.") : el("ol", { class: "steps" }, el("li", {}, `Enter the column “enter first”. Keep what you really entered as a file, such as ${file}:`, el("div", { class: "command" }, el("code", {}, csv), copyButton(csv))),
      el("li", {}, "Make result and URDF those of the robot after the entry:", DATA.apply_command ? el("div", { class: "command" }, el("code", {}, DATA.apply_command), copyButton(DATA.apply_command)) : " kdlcal apply"),
      el("li", {}, "Measure a few points and check them with kdlcal validate and the new result.")),
    el("h3", {}, "How to enter it"), facts(HOW_TO_ENTER),
    note(offsets.if_only_these ? `If neither compensated programs nor the URDF are used, enter the column “if nothing else is corrected” instead: ${mm(offsets.if_only_these.rms)} mm RMS would be left at the fitted points. ` : null,
      ((RESULT.effects || {}).terms || []).length ? "“Enter first” includes the mean of the effects of each joint." : null)];
}

function parameters() {
  const weak = (RESULT.weak || []).map((names) => names.join(", "));
  const fixedByGauge = RESULT.fixed_by_gauge || [];
  return [
    el("h3", {}, "Geometric errors"),
    note("Bars show the 95 % interval about the nominal value, on one scale for all lengths and one for all angles of a group. “Weak” belongs to a combination that the measurements hardly determine; “gauge” was held because no measurement can tell it."),
    parameterTables(),
    el("h3", {}, "Base and targets"), frameRows(),
    facts([["weak together", weak.length ? weak.slice(0, 20).join("; ") : null], ["fixed by gauge", fixedByGauge.length ? fixedByGauge.slice(0, 60).join(", ") : null]]),
    el("div", { class: "plots" }, DATA.correlations && DATA.correlations.names.length ? heatMap(DATA.correlations) : missing("The result has no covariance.")),
  ];
}

function effectFigure(entry) {
  const joint = JOINTS[entry.joint_index];
  const shown = shownAs(joint);
  const across = entry.about === "own" ? "" : `, ${entry.about} across its axis`;
  const length = isLinear(joint) && !across;
  const unit = (length ? 1e3 : 1 / DEGREE) * (across ? 1 : shown.factor);
  const points = entry.curve.map(([q, value, half]) => [jointValue(joint, shown.factor * q + shown.constant), value === null ? NaN : value * unit, half === null ? null : half * Math.abs(unit)]);
  const name = cut(shown.joint.name, 20) + (SHOWN_JOINTS !== JOINTS && SHOWN_JOINTS.some((other) => other.urdf) && shown.joint === joint ? ", in the URDF" : "");
  return lines({ title: `${entry.group} of ${cut(shown.joint.name, 20)}${across}`, caption: `${entry.terms} ${entry.terms === 1 ? "term" : "terms"}, the other joints at their middle`, height: 180,
    xLabel: `${name} [${jointUnit(joint)}]`, yLabel: `[${length ? "mm" : "°"}]` },
  [{ kind: "after", text: points.some((p) => p[2] !== null) ? "with its 95 % band" : "estimate", points, smooth: true }]);
}
// The models that were compared, the chosen one first.
function triedTable() {
  const tried = (RESULT.tried || []).filter((o, i, all) => all.findIndex((other) => JSON.stringify(other) === JSON.stringify(o)) === i);
  const rows = tried.map((o, i) => ({ cells: [(o.effects || []).join(" + ") || "geometry alone", o.sized ? `${mm(o.priors.length)} mm, ${short(o.priors.angle * 1e3)} mrad` : "as stated",
    fixed(o.evidence, 1), o.held_out_rms === null ? null : mm(o.held_out_rms), i === 0 ? "chosen" : ""], attributes: { class: i === 0 ? "is" : null } }));
  return tried.length < 2 && !RESULT.not_tried ? null : [el("h3", {}, "What was tried"),
    tried.length < 2 ? null : table(["beyond geometry", "priors", " log evidence", " RMS in the search [mm]", ""], rows, { label: "Tried" }),
    note(tried.length < 2 ? null : "A group of effects is taken if the log evidence rises by 7 and the RMS of predicted configurations falls by 2 %. Each fold of this search estimates sizes and noise anew, so its RMS is not the left-out error of the result. ",
      tried.some((o) => (o.effects || []).includes("tables")) ? "Tables were tried with several lengths. " : null,
      RESULT.not_tried ? `Not tried: ${RESULT.not_tried}.` : null)];
}
function effects() {
  const terms = (RESULT.effects || {}).terms || [];
  const explained = (RESULT.lack_of_fit || {}).explained_by_joint || [];
  const curves = DATA.effects || [];
  return [
    messages("In words", (RESULT.effects || {}).findings || [], "plain"),
    terms.length ? null : note("No effect beyond geometry is part of this calibration."),
    terms.length && !curves.length ? missing(whyMissing("measurements")) : null,
    curves.length ? el("div", { class: "plots small" }, curves.slice(0, 36).map(effectFigure)) : null,
    triedTable(),
    explained.length ? [el("h3", {}, "What a function of each joint would still explain"), table(["joint", " share of the residuals [%]"],
      explained.map((share, j) => [JOINTS[j] ? named(shownAs(JOINTS[j]).joint.name, 30) : `joint ${j + 1}`, fixed(share * 100, 1)]), { label: "Explained by joints" })] : null,
  ];
}

function influenceFigure(block) {
  const items = block.configurations.filter((entry) => entry.cook !== null);
  const x = Object.assign(spread(items.map((i) => i.leverage).concat([0]), 0.05), { label: "leverage" });
  const y = Object.assign(logSpread(items.map((i) => i.cook).concat([block.cook_limit])), { label: "Cook's distance" });
  const numbers = new Map(CONFIGURATIONS.map((configuration, c) => [configuration.name, c]));
  const node = figure({ title: "Influence of each configuration", caption: "above the line: leaving it out changes the answer" }, (width) => axes(width, { x, y, label: "Influence" }, (g, sx, sy, box, root) => {
    const limit = sy(block.cook_limit);
    g.append(svg("line", { class: "limit", x1: box.left, x2: box.right, y1: limit, y2: limit }), svg("text", { class: "limit", x: box.right, y: limit - 5, "text-anchor": "end" }, `limit ${short(block.cook_limit, 2)}`));
    const at = items.map((item) => [sx(item.leverage), sy(Math.max(item.cook, y.low))]);
    g.append(dots(at.filter((_, i) => !items[i].influential && !items[i].high_leverage), "after"), crosses(at.filter((_, i) => items[i].influential)),
      dots(at.filter((_, i) => items[i].high_leverage), "before"));
    items.forEach((item, i) => {
      if (numbers.get(item.configuration) === SELECTED.c && SELECTED.c >= 0) g.append(svg("circle", { class: "ring", cx: at[i][0], cy: at[i][1], r: 6 }));
    });
    pickable(root, items.map((item, i) => [at[i][0], at[i][1], () => [`Configuration ${cut(item.configuration, 60)}`, `leverage ${short(item.leverage)}${item.high_leverage ? ", high" : ""}`, `Cook's distance ${short(item.cook)}${item.influential ? ", influential" : ""}`],
      numbers.has(item.configuration) ? () => select(numbers.get(item.configuration)) : null]));
  }));
  FOLLOWERS.push(node.redraw);
  return node;
}
function influence() {
  const block = RESULT.influence;
  const history = RESULT.history || [];
  const figures = [];
  if (block) figures.push(influenceFigure(block));
  if (history.length > 1) {
    figures.push(lines({ title: "Misfit before each iteration", caption: "RMS of the fitted points, as they are weighted", xLabel: (RESULT.input || {}).method === "two-step" ? "round" : "iteration", yLabel: "misfit [mm]", yLog: true,
      hint: (p) => `${p[0]}: ${short(p[1], 4)} mm`, xTicks: history.length <= 12 ? history.map((_, i) => ({ value: i + 1, label: String(i + 1) })) : undefined },
    [{ kind: "after", text: "misfit", points: history.map((value, i) => [i + 1, value * 1e3]) }]));
  }
  return [block ? null : missing("Leverage and influence are calculated for up to 5,000 configurations."),
    figures.length ? el("div", { class: "plots" }, figures) : null,
    RESULT.convergence_factor ? note(`Each round left ${fixed(RESULT.convergence_factor, 3)} of the change of the round before.`) : null];
}

function copyButton(text) {
  const button = el("button", { type: "button", onclick: async () => {
    try {
      await navigator.clipboard.writeText(text);
    } catch (error) {
      const range = document.createRange();
      range.selectNodeContents(button.previousSibling);
      getSelection().removeAllRanges();
      getSelection().addRange(range);
      document.execCommand("copy");
    }
    button.textContent = "copied";
    setTimeout(() => { button.textContent = "copy"; }, 1500);
  } }, "copy");
  return button;
}
function next() {
  const predicted = RESULT.predicted_accuracy || {};
  const cells = (predicted.cells || []).filter((cell) => Number.isFinite(cell.mean)).sort((a, b) => b.mean - a.mean);
  return [
    cells.length ? [note(`Where a point is predicted least certainly, in ${PLACES}.${DATA.plan_command ? " Configurations chosen by the command below help there." : ""}`),
      table([" x [m]", " y [m]", " z [m]", " mean 1 σ [mm]", " largest [mm]", " configurations"],
        cells.slice(0, 10).map((cell) => [...moved(TO_WORLD, cell.centre).map((v) => fixed(v, 2)), mm(cell.mean), mm(cell.max), String(cell.count)]), { label: "Least certain cells" })]
      : missing("The result has no predicted accuracy over the workspace."),
    DATA.plan_command ? el("div", { class: "command" }, el("code", {}, DATA.plan_command), copyButton(DATA.plan_command)) : missing(RESULT.stations ? "kdlcal plan adds to the measurements of one station. For several, or a plate, plan anew: kdlcal plan --stations, --sockets." : "The command needs the names of the files, which this page does not have."),
  ];
}
