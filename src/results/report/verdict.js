// Verdict, provenance, accuracy: what a calibration is worth and where it comes from.

const ERRORS = RESULT.position_error || {};
const HELD_OUT = ERRORS.leave_one_out || ERRORS.k_fold || null;
const heldOutName = () => (ERRORS.leave_one_out ? "each configuration predicted from the others" :
  ERRORS.k_fold ? `${ERRORS.k_fold.folds} folds of configurations, each predicted from the others` : "");

// A figure with what it was before: a number for the eye, two bars for the hand that holds the page away.
function tile(title, before, after, why, compared = "before") {
  const most = Math.max(before || 0, after || 0) || 1;
  const bar = (value, kind) => svg("svg", { class: "bar", viewBox: "0 0 100 6", preserveAspectRatio: "none", "aria-hidden": "true" },
    svg("rect", { class: kind, x: 0, y: 0, height: 6, width: Math.max(0.8, (100 * value) / most) }));
  return el("div", { class: "tile" }, el("h3", {}, title),
    el("p", { class: "figure" }, el("span", { class: "value" }, mm(after)), el("span", { class: "unit" }, " mm")),
    Number.isFinite(before) ? [bar(before, "before"), bar(after, "after"), el("p", { class: "was" }, `${compared} ${mm(before)} mm`)] : null,
    el("p", { class: "why" }, why));
}

// "good", "bad", or "plain" where nothing was asked that could be answered so.
function verdictBanner(kind, title, text) {
  const sign = kind === "plain" ? null : svg("svg", { viewBox: "0 0 24 24", class: "sign", "aria-hidden": "true" },
    svg("path", { d: kind === "good" ? "M5 12.5l4.6 4.6L19 7.4" : "M12 6v8M12 17.6v.4" }));
  return el("div", { class: "verdict " + kind }, sign, el("div", {}, el("p", { class: "headline" }, title), el("p", {}, text)));
}

// Where it holds: each joint's measured range within its limits.
function jointRanges() {
  if (!MEASURED || !JOINTS.length) return missing(whyMissing(DATA.robot ? "measurements" : "robot"));
  const rows = JOINTS.map((joint, j) => {
    const range = MEASURED.ranges[j];
    const limits = [joint.lower, joint.upper].every((v) => v !== null) ? [joint.lower, joint.upper] : isLinear(joint) ? range : [-Math.PI, Math.PI];
    const low = Math.min(limits ? limits[0] : 0, range ? range[0] : 0);
    const high = Math.max(limits ? limits[1] : 1, range ? range[1] : 1);
    const at = (value) => (100 * (value - low)) / (high - low || 1);
    const bar = svg("svg", { class: "range", viewBox: "0 0 100 8", preserveAspectRatio: "none", "aria-hidden": "true" },
      svg("rect", { class: "track", x: at(limits ? limits[0] : low), y: 2, height: 4, width: limits ? at(limits[1]) - at(limits[0]) : 100 }),
      range ? svg("rect", { class: "measured", x: at(range[0]), y: 1, height: 6, width: Math.max(0.8, at(range[1]) - at(range[0])) }) : null);
    const text = (pair) => (pair ? `${fixed(jointValue(joint, pair[0]), 1)} to ${fixed(jointValue(joint, pair[1]), 1)} ${jointUnit(joint)}` : "–");
    return [named(joint.name, 28), text(range), bar, joint.lower === null ? "none stated" : text([joint.lower, joint.upper])];
  });
  return table(["joint", " measured", "within the limits", " limits"], rows, { label: "Measured joint ranges", class: "ranges" });
}
function regionText() {
  const region = MEASURED && MEASURED.region;
  if (!region) return null;
  const span = (i) => `${"xyz"[i]} ${fixed(region.lower[i], 2)} to ${fixed(region.upper[i], 2)} m`;
  return `${[0, 1, 2].map(span).join(", ")} in the base frame`;
}
function noteOf(...keys) {
  const notes = (RESULT.provenance && RESULT.provenance.notes) || {};
  const found = Object.keys(notes).find((key) => keys.some((wanted) => key.toLowerCase().includes(wanted)));
  return found ? notes[found] : null;
}

function messages(title, list, kind) {
  if (!list.length) return null;
  const most = 200;
  return el("div", { class: "messages " + kind }, el("h3", {}, title),
    el("ul", {}, list.slice(0, most).map((text) => el("li", { dir: "auto" }, text))),
    list.length > most ? note(`The first ${most} of ${list.length}.`) : null);
}

function calibrationVerdict() {
  const doubts = (RESULT.doubts || []).map((doubt) => doubt.message);
  const tiles = [];
  if (HELD_OUT && HELD_OUT.after) {
    tiles.push(tile("RMS, held out", HELD_OUT.before && HELD_OUT.before.rms, HELD_OUT.after.rms, heldOutName()),
      tile("Maximum, held out", HELD_OUT.before && HELD_OUT.before.max, HELD_OUT.after.max, `of ${HELD_OUT.after.count} points`));
  }
  if (ERRORS.test && ERRORS.test.after) {
    tiles.push(tile("RMS, test rows", ERRORS.test.before.rms, ERRORS.test.after.rms, `${ERRORS.test.after.count} points that were never fitted`));
  }
  if (ERRORS.train && ERRORS.train.after) {
    tiles.push(tile("RMS, fitted", ERRORS.train.before.rms, ERRORS.train.after.rms, `${ERRORS.train.after.count} points the fit has seen`));
  }
  const payload = noteOf("payload", "load");
  const requirements = RESULT.requirements || [];
  const missed = requirements.filter((requirement) => !requirement.fulfilled).map((requirement) => requirement.message);
  return [
    verdictBanner(RESULT.trusted && !missed.length ? "good" : "bad",
      !RESULT.trusted ? "Not to be trusted" : missed.length ? "Not as required" : RESULT.reservation ? "To be trusted where it was measured" : "To be trusted",
      RESULT.reservation ? RESULT.reservation.message : RESULT.trusted ? "The fit converged, everything in it is determined, and it predicts configurations that it has not seen better than the nominal robot does."
        : `${plural(doubts.length, "reason")} against using this calibration as it stands:`),
    messages("Doubts", doubts, "bad"), messages("Required and not fulfilled", missed, "bad"),
    el("div", { class: "tiles" }, tiles),
    requirements.length ? facts([["required", requirements.map((requirement) => requirement.text).join(", ")]]) : null,
    HELD_OUT ? null : missing("Nothing was held out, so nothing is known of configurations that were not measured."),
    el("h3", {}, "Where it holds"), jointRanges(),
    el("dl", { class: "facts" }, ...[["region", regionText()], ["payload", payload || "not stated: it holds for the one that was on the arm"]]
      .filter(([, value]) => value).map(([key, value]) => [el("dt", {}, key), el("dd", { dir: "auto" }, value)])),
    messages("Warnings", RESULT.warnings || [], "warn"),
    messages("What moves the arm besides its links", (RESULT.effects || {}).findings || [], "plain"),
    messages("Findings in the measurements", (RESULT.findings || []).map((finding) => finding.message), "warn"),
  ];
}

function facts(list) {
  return el("dl", { class: "facts" }, list.filter(([, value]) => value !== undefined && value !== null && value !== "")
    .map(([key, value]) => [el("dt", { dir: "auto" }, cut(key, 60)), el("dd", { dir: "auto" }, value)]));
}
function filesTable(files) {
  if (!files.length) return null;
  return table(["file", "name", "SHA-256"], files.map((file) => [file.role, named(file.path, 400), el("code", { class: "hash" }, file.sha256)]),
    { label: "Files", class: "files" });
}
function notesFacts() {
  const notes = Object.entries((RESULT.provenance && RESULT.provenance.notes) || {});
  return notes.length ? facts(notes.map(([key, value]) => [key, String(value)])) : note("No serial number, operator, device, temperature or payload was stated.");
}
function provenance() {
  const input = RESULT.input || {};
  const software = RESULT.software || DATA.software || {};
  const priors = RESULT.priors || {};
  const held = [priors.length > 0 ? `lengths ${mm(priors.length)} mm` : null, priors.angle > 0 ? `angles ${short(priors.angle * 1e3)} mrad` : null].filter(Boolean);
  const files = RESULT.provenance ? [...(RESULT.provenance.files_read || []), ...(RESULT.provenance.files_written || [])] : [];
  return [
    el("div", { class: "columns" },
      el("div", {}, el("h3", {}, "Robot and measurement"),
        facts([["robot", DATA.robot ? named(DATA.robot.name, 80) : null], ["from", input.base ? el("span", {}, named(input.base, 40), " to ", named(input.tip, 40)) : null],
          ["configurations", input.configurations], ["measured points", input.observations]]), RESULT.termination ? notesFacts() : null),
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
  return [[`${name}, before`, pair.before, "was"], [`${name}, after`, pair.after, "is"], [`${name}, exported URDF alone`, pair.exported_urdf]];
}
function distributionSeries(distributions, train, test) {
  const series = [];
  const add = (of, kind, text) => { if (of) series.push({ kind, text: `${text} (${of.count})`, values: of.values }); };
  if (distributions.train) {
    add(distributions.train.before, "before", `${train}, before`);
    add(distributions.train.after, "after", distributions.train.before ? `${train}, after` : train);
  }
  const heldOut = (RESULT.held_out_points || []).map((p) => p.distance).filter(Number.isFinite).sort((a, b) => a - b);
  if (heldOut.length) add({ count: heldOut.length, values: heldOut }, "held", "held out");
  if (distributions.test) {
    add(distributions.test.before, "testbefore", `${test}, before`);
    add(distributions.test.after, "test", distributions.test.before ? `${test}, after` : test);
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
function accuracy() {
  const iso = RESULT.iso_9283 || {};
  const isoRows = [];
  for (const [name, pair] of [["fitted rows", iso], ["test rows", iso.test]]) {
    if (!pair || !pair.before || !pair.after) continue;
    isoRows.push([`AP accuracy, ${name}, before`, pair.before.accuracy, "was"], [`AP accuracy, ${name}, after`, pair.after.accuracy, "is"],
      [`RP repeatability, ${name}`, pair.after.repeatability]);
  }
  const predicted = RESULT.predicted_accuracy || {};
  return [
    accuracyTable([...pairRows("Fitted", ERRORS.train), ...pairRows("Test rows", ERRORS.test), ...pairRows("Leave-one-out", ERRORS.leave_one_out),
      ...pairRows(`${(ERRORS.k_fold || {}).folds || ""} folds`, ERRORS.k_fold), ["Nested leave-one-out, choices made anew", ERRORS.nested_leave_one_out, "is"],
      ...isoRows, ["Predicted 1 σ, measured configurations", predicted.measured], ["Predicted 1 σ, whole workspace", predicted.workspace]]),
    note("Distances in space between a measured and a predicted point. “Before” is the nominal robot with base and targets fitted to the same points. ",
      "AP and RP follow the formulas of ISO 9283, not its test cycle. Predicted values are of the parameters alone."),
    distributions("fitted", "test rows"),
  ];
}
