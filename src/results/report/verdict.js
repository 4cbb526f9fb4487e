// Verdict, provenance, accuracy: what a calibration is worth and where it comes from.

const ERRORS = RESULT.position_error || {};
const HELD_OUT = ERRORS.leave_one_out || ERRORS.k_fold || null;
const folds = () => `${(ERRORS.k_fold || {}).folds}-fold`;

// A figure [m] beside others: [name, value]. The first of them is drawn as a bar above its own.
function tile(title, value, others, why) {
  const known = others.filter(([, other]) => Number.isFinite(other));
  const most = Math.max(value || 0, ...known.slice(0, 1).map(([, other]) => other)) || 1;
  const bar = (size, kind) => svg("svg", { class: "bar", viewBox: "0 0 100 6", preserveAspectRatio: "none", "aria-hidden": "true" },
    svg("rect", { class: kind, x: 0, y: 0, height: 6, width: Math.max(0.8, (100 * size) / most) }));
  return el("div", { class: "tile" }, el("h3", {}, title),
    el("p", { class: "figure" }, el("span", { class: "value" }, mm(value)), el("span", { class: "unit" }, " mm")),
    known.length ? [bar(known[0][1], "before"), bar(value, "after"), el("p", { class: "was" }, known.map(([name, other]) => el("span", {}, `${name} ${mm(other)} mm `)))] : null,
    el("p", { class: "why" }, why));
}
// Every repeat by itself, and their means.
const pointsAndMeans = (count, means) => plural(count, "point") + (means ? `; ${mm(means.rms)} mm for the ${plural(means.count, "mean")} of repeats` : "");

// "good", "bad", or "plain" where nothing was asked that could be answered so.
function verdictBanner(kind, title, text, more) {
  const sign = kind === "plain" ? null : svg("svg", { viewBox: "0 0 24 24", class: "sign", "aria-hidden": "true" },
    svg("path", { d: kind === "good" ? "M5 12.5l4.6 4.6L19 7.4" : "M12 6v8M12 17.6v.4" }));
  return el("div", { class: "verdict " + kind }, sign, el("div", {}, el("p", { class: "headline" }, title), more || null, text ? el("p", {}, text) : null));
}

// Where it holds: each joint's measured range within its limits.
function jointRanges() {
  if (!MEASURED || !JOINTS.length) return missing(whyMissing(DATA.robot ? "measurements" : "robot"));
  const rows = SHOWN_JOINTS.map((joint, j) => {
    const range = MEASURED.ranges[j];
    const limits = [joint.lower, joint.upper].every((v) => v !== null) ? [joint.lower, joint.upper] : isLinear(joint) ? range : [-Math.PI, Math.PI];
    const low = Math.min(limits ? limits[0] : 0, range ? range[0] : 0);
    const high = Math.max(limits ? limits[1] : 1, range ? range[1] : 1);
    const at = (value) => (100 * (value - low)) / (high - low || 1);
    const bar = svg("svg", { class: "range", viewBox: "0 0 100 8", preserveAspectRatio: "none", "aria-hidden": "true" },
      svg("rect", { class: "track", x: at(limits ? limits[0] : low), y: 2, height: 4, width: limits ? at(limits[1]) - at(limits[0]) : 100 }),
      range ? svg("rect", { class: "measured", x: at(range[0]), y: 1, height: 6, width: Math.max(0.8, at(range[1]) - at(range[0])) }) : null);
    const text = (pair) => (pair ? `${fixed(jointValue(joint, pair[0]), 1)} to ${fixed(jointValue(joint, pair[1]), 1)} ${jointUnit(joint)}` : "–");
    const limit = joint.lower !== null ? text([joint.lower, joint.upper]) : Object.keys(joint.urdf || {}).length > 1 ? "with other joints" : "none stated";
    return [named(joint.name, 28), joint.urdf ? inUrdfJoints(joint) : null, text(range), bar, limit];
  });
  const headings = ["joint", "in the URDF", " measured", "within the limits", " limits"];
  if (SHOWN_JOINTS.every((joint) => !joint.urdf)) for (const row of [headings, ...rows]) row.splice(1, 1);
  return table(headings, rows, { label: "Measured joint ranges", class: "ranges" });
}
// A controller's joint value in those of the URDF.
function inUrdfJoints(joint) {
  const constant = joint.constant ? [[`${fixed(Math.abs(jointValue(joint, joint.constant)), 1)} ${jointUnit(joint)}`, Math.sign(joint.constant)]] : [];
  return [...Object.entries(joint.urdf), ...constant].map(([name, factor], i) =>
    (factor < 0 ? (i ? " − " : "−") : i ? " + " : "") + (Math.abs(factor) === 1 ? "" : short(Math.abs(factor)) + " ") + cut(name, 20)).join("");
}
function regionText() {
  const region = MEASURED && MEASURED.region;
  if (!region) return null;
  const span = (i) => `${"xyz"[i]} ${fixed(region.lower[i], 2)} to ${fixed(region.upper[i], 2)} m`;
  return `${[0, 1, 2].map(span).join(", ")} in ${PLACES}`;
}
function noteOf(...keys) {
  const notes = (RESULT.provenance && RESULT.provenance.notes) || {};
  const found = Object.keys(notes).find((key) => keys.some((wanted) => key.toLowerCase().includes(wanted)));
  return found ? notes[found] : null;
}

function messages(title, list, kind) {
  if (!list.length) return null;
  const most = 200;
  return el("div", { class: "messages " + kind }, title ? el("h3", {}, title) : null,
    el("ul", {}, list.slice(0, most).map((text) => el("li", { dir: "auto" }, text))),
    list.length > most ? note(`The first ${most} of ${list.length}.`) : null);
}

function requirementsTable(requirements) {
  const signs = { "<=": "≤", ">=": "≥", "==": "=" };
  const spaced = (text) => text.replace(/\s*([<>=]+)\s*([^a-z]*)/, (_, sign, number) => ` ${signs[sign] || sign} ${number.trim()} `).trim();
  return requirements.length ? table(["required", " value", ""], requirements.map((requirement) => ({
    cells: [spaced(requirement.text), requirement.value, requirement.fulfilled ? "met" : "not met"], attributes: { class: requirement.fulfilled ? null : "missed" } })),
  { label: "Requirements", class: "requirements" }) : null;
}

// The accuracy in one sentence, and where its numbers come from.
const NEW_POINT = RESULT.new_point || null;
const millimetres = (value) => `${fixed(value * 1e3, value < 1e-4 ? 3 : 2)} mm`;
function robotsOf(stated) {
  const same = stated.urdf_alone === stated.compensated;
  return [[RESULT.mastering_entered ? "as the robot was" : "as the robot is", stated.nominal, "before"], same ? null : ["with the URDF alone", stated.urdf_alone, "held"],
    [same ? "in compensated programs or with the URDF" : "in compensated programs", stated.compensated, "after"]].filter(Boolean);
}
function statement() {
  if (!NEW_POINT || !RESULT.trusted) return null;
  const [first, ...others] = robotsOf(NEW_POINT).reverse();
  return el("p", { class: "statement" }, `A new ${NEW_POINT.of_coordinates ? "coordinate or distance" : "point"} lies within `,
    el("strong", {}, millimetres(first[1])), ` (k = ${short(NEW_POINT.coverage_factor, 2)}) ${first[0]}`,
    others.map(([name, value]) => ["; ", el("strong", {}, millimetres(value)), ` ${name}`]), ".");
}
function beforeAndAfter() {
  if (!NEW_POINT) return null;
  const robots = robotsOf(NEW_POINT);
  const most = Math.max(...robots.map(([, value]) => value)) || 1;
  const rms = 100 / NEW_POINT.coverage_factor;
  const bar = (value, kind) => svg("svg", { class: "bar", viewBox: "0 0 100 10", preserveAspectRatio: "none", "aria-hidden": "true" },
    svg("rect", { class: kind + " expanded", x: 0, y: 0, height: 10, width: Math.max(0.4, (100 * value) / most) }),
    svg("rect", { class: kind, x: 0, y: 0, height: 10, width: Math.max(0.2, (rms * value) / most) }));
  const rows = { left_out: "configurations, each predicted by a fit to the others", test: "configurations of test rows", fitted: "fitted configurations, which is too good: nothing was left out" }[NEW_POINT.rows];
  return el("figure", { class: "arms" },
    el("dl", {}, robots.map(([name, value, kind]) => [el("dt", {}, name), el("dd", {}, bar(value, kind), el("span", { class: "value" }, millimetres(value)))])),
    el("figcaption", {}, `Dark: RMS error. Light: ${short(NEW_POINT.coverage_factor, 2)} times as much (95 %). ${NEW_POINT.configurations} ${rows}; base and tool registered to the same rows for each robot${shareWithin()}.`));
}
// How many left-out points the sentence is true of.
function shareWithin() {
  const left = (RESULT.held_out_points || []).map((point) => point.distance).filter(Number.isFinite);
  if (!left.length || NEW_POINT.rows !== "left_out") return "";
  return `. ${left.filter((distance) => distance <= NEW_POINT.compensated).length} of ${plural(left.length, "left-out point")} are within ${millimetres(NEW_POINT.compensated)} of the compensated robot`;
}

// At most three doubts, findings and warnings, with what to do; the others are folded.
function remarksOfResult() {
  const cures = DATA.cures || {};
  const remarks = RESULT.remarks || [];
  const withCure = (doubt) => doubt.message + (cures[doubt.cause] ? ` (${cures[doubt.cause]})` : "");
  const warnings = (RESULT.warnings || []).map((text, i) => ({ text, information: (remarks[i] || {}).information === true }));
  const grave = [...(RESULT.doubts || []).map(withCure), ...(RESULT.findings || []).map((finding) => finding.message),
    ...warnings.filter((warning) => !warning.information).map((warning) => warning.text)];
  const notes = warnings.filter((warning) => warning.information).map((warning) => warning.text);
  const most = 3;
  const folded = (title, list, kind) => (list.length ? el("details", { class: "remarks" }, el("summary", {}, title), messages(null, list, kind)) : null);
  return [messages(RESULT.trusted ? "Look at" : "Doubts", grave.slice(0, most), RESULT.trusted ? "warn" : "bad"),
    folded(`${plural(grave.length - most, "more remark")}`, grave.slice(most), "warn"), folded("How the measurements were read", notes, "plain")];
}

function calibrationVerdict() {
  const payload = noteOf("payload", "load");
  const requirements = RESULT.requirements || [];
  const missed = requirements.filter((requirement) => !requirement.fulfilled);
  const doubts = RESULT.doubts || [];
  const cure = RESULT.reservation ? (DATA.cures || {})[RESULT.reservation.cause] : null;
  return [
    verdictBanner(RESULT.trusted && !missed.length ? "good" : "bad",
      !RESULT.trusted ? "Not to be trusted" : missed.length ? "Not as required" : RESULT.reservation ? "To be trusted where it was measured" : "To be trusted",
      RESULT.reservation ? RESULT.reservation.message + (cure ? ` (${cure})` : "") : RESULT.trusted ? null
        : `${plural(doubts.length, "reason")} against using this calibration as it stands:`, statement()),
    requirementsTable(requirements),
    RESULT.trusted ? [beforeAndAfter(), remarksOfResult()] : [remarksOfResult(), beforeAndAfter()],
    HELD_OUT ? null : missing("Nothing was left out, so nothing is known of configurations that were not measured."),
    el("h3", {}, "Where it holds"), jointRanges(),
    el("dl", { class: "facts" }, ...[["region", regionText()], ["payload", payload || "not stated: it holds for the one that was on the arm"]]
      .filter(([, value]) => value).map(([key, value]) => [el("dt", {}, key), el("dd", { dir: "auto" }, value)])),
  ];
}

function facts(list) {
  return el("dl", { class: "facts" }, list.filter(([, value]) => value !== undefined && value !== null && value !== "")
    .map(([key, value]) => [el("dt", { dir: "auto" }, cut(key, 60)), el("dd", { dir: "auto" }, value)]));
}
function filesTable(files) {
  if (!files.length) return null;
  return table(["file", "name and SHA-256"], files.map((file) => [file.role, el("span", {}, file.path ? named(file.path, 400) : null, el("code", { class: "hash" }, file.sha256.match(/.{1,16}/g).map((part) => [part, el("wbr")])))]),
    { label: "Files", class: "files" });
}
function notesFacts() {
  const notes = Object.entries((RESULT.provenance && RESULT.provenance.notes) || {});
  return notes.length ? facts(notes.map(([key, value]) => [key, String(value)])) : note("No serial number, operator, device, temperature or payload was stated.");
}
// A date that was stated, or a line to write it on.
const dateOf = (...keys) => noteOf(...keys) || el("span", { class: "blank" }, "not stated");
function provenance() {
  const input = RESULT.input || {};
  const software = RESULT.software || DATA.software || {};
  const priors = RESULT.priors || {};
  const held = [priors.length > 0 ? `lengths ${mm(priors.length)} mm` : null, priors.angle > 0 ? `angles ${short(priors.angle * 1e3)} mrad` : null].filter(Boolean);
  const written = DATA.sha256 ? [{ role: "this result", path: "", sha256: DATA.sha256 }] : [];
  const files = RESULT.provenance ? [...written, ...(RESULT.provenance.files_read || []), ...(RESULT.provenance.files_written || [])] : [];
  return [
    el("div", { class: "columns" },
      el("div", {}, el("h3", {}, "Robot and measurement"),
        facts([["robot", DATA.robot ? named(DATA.robot.name, 80) : null], ["from", input.base ? el("span", {}, named(input.base, 40), " to ", named(input.tip, 40)) : null],
          ["configurations", input.configurations], ["measured points", input.observations],
          ...(RESULT.termination ? [["measured on", dateOf("measured", "date")], ["calibrated on", dateOf("calibrated")]] : [])]), RESULT.termination ? notesFacts() : null),
      el("div", {}, el("h3", {}, "How it was calculated"),
        facts([["software", software.name ? `${software.name} ${software.version}` : null],
          ["estimator", input.method], ["parameters", input.model], ["priors", !RESULT.priors ? null : held.length ? held.join(", ") : "none"],
          ["weights", RESULT.noise ? { parts: "by the parts of the noise", stated: "as stated", residuals: "all alike" }[RESULT.noise.model] : null],
          ["ended", RESULT.termination ? `${RESULT.termination}, ${plural(RESULT.iterations, "iteration")}` : null],
          ["rank", RESULT.rank !== undefined ? `${RESULT.rank}, condition number ${short(RESULT.condition)}` : null]]))),
    filesTable(files),
  ];
}

function accuracyTable(rows) {
  const known = rows.filter(([, statistics]) => statistics);
  return table(["position error [mm]", " RMS", " mean", " 95 %", " maximum", " points"],
    known.map(([name, s, kind]) => ({ attributes: { class: kind || null }, cells: [name, mm(s.rms), mm(s.mean), mm(s.p95), mm(s.max), String(s.count)] })),
    { label: "Position errors", class: "accuracy" });
}
function pairRows(name, pair) {
  if (!pair) return [];
  const rows = (label, of) => [[`${label}, nominal`, of.before, "was"], [`${label}, calibrated`, of.after, "is"], [`${label}, URDF alone`, of.exported_urdf]];
  return pair.means ? [...rows(`${name} points`, pair), ...rows(`${name} means`, pair.means)] : rows(name, pair);
}
function distributionSeries(distributions, train, test) {
  const series = [];
  const add = (of, kind, text) => { if (of) series.push({ kind, text: `${text} (${of.count})`, values: of.values }); };
  if (distributions.train) {
    add(distributions.train.before, "before", `${train}, nominal`);
    add(distributions.train.after, "after", distributions.train.before ? `${train}, calibrated` : train);
  }
  const heldOut = (RESULT.held_out_points || []).map((p) => p.distance).filter(Number.isFinite).sort((a, b) => a - b);
  if (heldOut.length) add({ count: heldOut.length, values: heldOut }, "held", "left out");
  if (distributions.test) {
    add(distributions.test.before, "testbefore", `${test}, nominal`);
    add(distributions.test.after, "test", distributions.test.before ? `${test}, calibrated` : test);
  }
  return series;
}
function distributions(train, test) {
  if (!MEASURED) return missing(whyMissing("measurements"));
  const series = distributionSeries(MEASURED.distributions, train, test);
  const label = "position error [mm]";
  return el("div", { class: "plots" }, histogram("Distribution", series.filter((s) => s.kind !== "testbefore" && s.kind !== "test" || series.length < 3), label),
    cumulative("Cumulative", series, label));
}
// 1 sigma in space of a new measured point about its prediction, and what it is made of.
function budgetTable() {
  const budget = (RESULT.predicted_accuracy || {}).budget;
  if (!budget) return null;
  const k = budget.coverage_factor || 2;
  const stated = RESULT.noise && RESULT.noise.model === "stated";
  const share = (value) => (budget.total ? fixed((100 * value * value) / (budget.total * budget.total), 1) : null);
  const parts = [["single point", stated ? "B" : "A", budget.of_point], ["repeat: shared by its points", stated ? "B" : "A", budget.of_repeat],
    ["misfit of the model", "A", budget.of_misfit], ["parameters, at left-out configurations", "A", budget.of_parameters],
    [`taken as true: scale of the device ${scaleOfDevice()}, stated lengths`, "B", budget.of_assumptions]];
  const temperature = noteOf("temperature");
  return [el("h3", {}, "Uncertainty budget of a new measured point"),
    table(["source", "type", " 1 σ [mm]", " share [%]"], [...parts.map(([name, type, value]) => [name, type, mm(value), share(value)]),
      { cells: ["total", "", mm(budget.total), share(budget.total)], attributes: { class: "is" } },
      { cells: [`expanded, k = ${short(k, 3)} (95 %)`, "", mm(budget.expanded), ""], attributes: { class: "is" } }],
    { label: "Uncertainty budget", class: "budget" }),
    stationsNote(), assumptionsNote(budget), note("Type A: from the scatter of these measurements. Type B: stated. Of the distance in space, not of one coordinate. ",
      Number.isFinite(budget.degrees_of_freedom) ? `k is Student's t for ${fixed(budget.degrees_of_freedom, 0)} degrees of freedom. ` : null,
      parts.some(([, , value]) => value === 0) ? "A part of 0 is not seen, or contained in another one: to separate them takes repeats and several targets. " : null,
      (RESULT.predicted_accuracy.workspace || {}).count ? `Over the whole workspace the parameters' part is ${mm(RESULT.predicted_accuracy.workspace.rms)} mm. ` : null,
      temperature ? `Measured at ${temperature}; ` : "The temperature was not stated; ", "an arm that is warmer or colder is longer or shorter, which no part of this table contains.")];
}
const scaleOfDevice = () => (RESULT.assumed ? `(${Number((RESULT.assumed.scale_sigma * 1e6).toPrecision(3))} µm/m)` : "");
function stationsNote() {
  const stations = (RESULT.noise || {}).stations || [];
  return stations.length === 0 ? null
    : note(`Noise of a coordinate by station: ${stations.map((each) => `${each.name} ${mm(each.sigma)} mm`).join(", ")}. The budget is that of the best one.`);
}

function assumptionsNote(budget) {
  const assumed = RESULT.assumed;
  if (!assumed) return null;
  const tenfold = Math.sqrt(budget.total * budget.total + 99 * budget.of_assumptions * budget.of_assumptions);
  return note(`Taken as true within 1 σ: all measured lengths to ${Number((assumed.scale_sigma * 1e6).toPrecision(3))} µm/m, stated distances to ${mm(assumed.length_sigma)} mm. If they are ten times as wrong, the total is ${mm(tenfold)} mm.`);
}
function detectableTable() {
  const mistakes = RESULT.detectable || [];
  if (!mistakes.length) return null;
  const size = (m) => (m.unit ? `${(m.estimate * (m.unit === "%" ? 1e2 : 1e3)).toPrecision(2)} ${m.unit}` : "");
  return [el("h3", {}, "Mistakes that would have shown"),
    table(["mistake", " smallest", " at the points [mm]", " predictions off by [mm]"],
      mistakes.map((m) => [m.subject, size(m), mm(m.size), mm(m.moves)]), { label: "Detectable mistakes", class: "detectable" }),
    note("The smallest mistake of each kind that these measurements would have shown in about 80 of 100 cases, along its least visible direction, and what a hidden one of that size does to predictions (minimal detectable bias and external reliability).")];
}
function askedTable() {
  const asked = (RESULT.predicted_accuracy || {}).asked || [];
  if (!asked.length || !RESULT.trusted) return null;
  const row = (name, p, more, kind) => ({ cells: [name, ...p.map((v) => fixed(v * 1e3, 3)), ...more], attributes: { class: kind } });
  const rows = asked.slice(0, MOST_ROWS).flatMap((point) => {
    const [nominal, calibrated] = [point.position_nominal, point.position].map((place) => moved(TO_WORLD, place));
    return [row(el("span", {}, named(point.configuration, 24), ", target ", named(point.target, 24), ", nominal"), nominal, ["", "", ""]),
      row("calibrated", calibrated, [mm(point.sigma), mm(point.radius_95), point.outside ? "outside" : ""], "is"),
      row("difference", minus(calibrated, nominal), ["", "", ""], "last")];
  });
  return [el("h3", {}, "Predicted points"), table([`in ${PLACES} [mm]`, " x", " y", " z", " 1 σ", " 95 %", ""], rows, { label: "Predicted points", class: "asked" }),
    note("1 σ is of the parameters alone. A new measured point lies within the 95 % radius, misfit and noise included, unless it is outside: beyond the measured region this radius does not hold.",
      asked.length > MOST_ROWS ? ` The first ${MOST_ROWS} of ${asked.length} points.` : null)];
}
function accuracyNote(means, more) {
  return note("Distances in space between a measured and a predicted point", means ? ": of every repeat (points), or of their mean (means). " : ". ", more,
    `The error of ${means ? "means" : "points"} is the accuracy AP of ISO 9283, and RP its repeatability, by its formulas and not by its test cycle.`);
}
function accuracy() {
  const iso = RESULT.iso_9283 || {};
  return [
    accuracyTable([...pairRows("Fitted", ERRORS.train), ...pairRows("Test", ERRORS.test), ["Test at fitted poses", ERRORS.test_at_fitted_poses], ["Test at new poses", ERRORS.test_at_new_poses],
      ...pairRows("Left out", ERRORS.leave_one_out), ["Left out, choices made anew", ERRORS.nested_leave_one_out, "is"], ...pairRows(folds(), ERRORS.k_fold),
      ["RP repeatability, fitted", (iso.after || {}).repeatability], ["RP repeatability, test", ((iso.test || {}).after || {}).repeatability]]),
    accuracyNote(ERRORS.train && ERRORS.train.means, "Of the nominal robot base and targets are registered: to these same points where they were fitted, to the other configurations where they were left out. That error is the larger and honest one. "),
    distributions("fitted", "test"), budgetTable(), detectableTable(), askedTable(),
  ];
}
