// Pages of a plan, of Monte Carlo runs and of the two-step procedure against a virtual robot.

// Share of points within r [m] that a normal error with this 3D sigma [m], alike in all directions, would have.
function erf(x) {  // Abramowitz and Stegun 7.1.26, 1.5e-7
  const t = 1 / (1 + 0.3275911 * Math.abs(x));
  const y = 1 - ((((1.061405429 * t - 1.453152027) * t + 1.421413741) * t - 0.284496736) * t + 0.254829592) * t * Math.exp(-x * x);
  return x < 0 ? -y : y;
}
function within(r, sigma3d) {
  const x = (r * Math.sqrt(3)) / sigma3d;
  return Math.max(0, erf(x / Math.SQRT2) - Math.sqrt(2 / Math.PI) * x * Math.exp((-x * x) / 2));
}

function monteCarloVerdict() {
  const errors = RESULT.held_out_error;
  const wrong = RESULT.not_trusted;
  return [
    verdictBanner(wrong === 0 ? "good" : "bad", wrong === 0 ? "Every run can be trusted" : `${wrong} of ${plural(RESULT.runs, "run")} not to be trusted`,
      `${plural(RESULT.runs, "virtual robot")} drawn, measured and calibrated; each was then compared with its true self where it was not measured.`),
    el("div", { class: "tiles" }, tile("RMS, held out", errors.all.rms, [], `over ${errors.all.count} points of all runs`),
      tile("95 % of the points within", errors.all.p95, [], "over all runs"), tile("Largest", errors.all.max, [], "of all runs and points")),
    facts((DATA.setup || []).map(([key, value]) => [key, value])),
  ];
}
function monteCarloErrors() {
  const { distributions: of, predicted } = DATA;
  const series = [{ kind: "after", text: `all points (${of.all.count})`, values: of.all.values }, { kind: "held", text: "mean of a run", values: of.means.values },
    { kind: "before", text: "largest of a run", values: of.maxima.values }];
  const label = "held-out error [mm]";
  const errors = RESULT.held_out_error;
  const figures = [histogram("Distribution", series, label), cumulative("Cumulative", series, label)];
  if (predicted && predicted.values.length) {
    const grid = of.all.values.filter((_, i) => i % Math.max(1, Math.floor(of.all.values.length / 200)) === 0 && of.all.values[i] > 0);
    const expected = grid.map((r) => [r * 1e3, (100 * sum(predicted.values.map((s) => within(r, s)))) / predicted.values.length]);
    const found = of.all.values.map((r, i) => [r * 1e3, (100 * (i + 1)) / of.all.values.length]).filter(([r]) => r > 0);
    figures.push(lines({ title: "Against the prediction", caption: "which the noise alone would give, to first order", xLog: true, xLabel: label, yLabel: "points not above [%]" },
      [{ kind: "after", text: "all runs", points: found, smooth: true }, { kind: "held", text: "predicted", points: expected, smooth: true }]));
  }
  return [accuracyTable([["all points", errors.all], ["mean of a run", errors.mean_of_run], ["largest of a run", errors.max_of_run]]),
    el("div", { class: "plots small" }, figures),
    predicted && predicted.values.length ? note(`Predicted RMS ${mm(rms(predicted.values))} mm from the information of the measurements at the nominal geometry, found ${mm(errors.all.rms)} mm.`)
      : missing("Without noise nothing is predicted: what is left is how exactly the fit converges.")];
}

function roundsSeries(rounds, kind, text, field) {
  return { kind, text, points: rounds.map((r) => [r.round, 1e3 * (field === "held_out" ? (r.held_out ? r.held_out.rms : NaN) : r[field])]) };
}
function twoStepVerdict() {
  const rounds = RESULT.rounds;
  const last = rounds[rounds.length - 1];
  const difference = RESULT.largest_difference || {};
  return [
    verdictBanner(RESULT.settled && RESULT.comparable ? "good" : "bad", RESULT.settled ? "The procedure settled" : "The procedure did not settle",
      RESULT.settled && RESULT.termination !== "converged" ? "What still moves in a round is what the noise of fresh measurements causes." : RESULT.message),
    el("div", { class: "tiles" }, tile("RMS at held-out configurations", last.held_out && last.held_out.rms, [["after the first", rounds[0].held_out && rounds[0].held_out.rms]], `after ${plural(rounds.length, "round")}`),
      tile("Largest difference of a length", difference.length, [], "from the truth, up to the gauge"),
      el("div", { class: "tile" }, el("h3", {}, "Left by each round"), el("p", { class: "figure" }, el("span", { class: "value" }, RESULT.convergence_factor ? fixed(RESULT.convergence_factor, 3) : "–")), el("p", { class: "why" }, "of the change of the round before"))),
    facts(DATA.setup || []),
  ];
}
function convergence() {
  const runs = [[RESULT, RESULT.recorded], ...(DATA.other ? [[DATA.other, !RESULT.recorded]] : [])];
  const of = (field) => runs.filter(([run]) => run.rounds).map(([run, recorded]) => roundsSeries(run.rounds, recorded ? "before" : "after", recorded ? "recorded configurations" : "fresh configurations", field));
  const options = (title, yLabel) => ({ title, xLabel: "round", yLabel, yLog: true, hint: (p) => `round ${p[0]}, ${short(p[1], 4)} mm` });
  return [el("div", { class: "plots small" }, lines(options("Change of the points", "change [mm]"), of("change")), lines(options("Misfit before the step", "misfit [mm]"), of("misfit")),
    lines(options("Distance from the truth, held out", "RMS [mm]"), of("held_out"))),
    note("Fresh: every round measures new configurations. Recorded: the same measurements in every round.")];
}
function againstTruth() {
  const list = RESULT.parameters || [];
  const rows = list.map((p) => {
    const { unit, factor, decimals } = unitOf(p);
    const value = (v) => fixed(v * factor, decimals);
    return { cells: [el("strong", {}, named(p.name, 24)), p.joint ? named(p.joint, 24) : "", value(p.estimated), value(p.true), value(p.true_in_gauge),
      p.gauge ? "gauge" : short(p.difference * factor, 2), unit], attributes: { class: p.gauge ? "gauge" : null } };
  });
  const figures = [["mm", false], ["°", true]].map(([unit, angle]) => {
    const items = list.filter((p) => !p.gauge && isAngle(p) === angle).map((p) => [p.true_in_gauge * unitOf(p).factor, p.estimated * unitOf(p).factor, p.name]);
    if (!items.length) return null;
    const both = spread(items.flatMap((i) => [i[0], i[1]]));
    return figure({ title: angle ? "Angles" : "Lengths", caption: "on the line the estimate is the truth" }, (width) => axes(width, { x: Object.assign({}, both, { label: `true, in gauge [${unit}]` }), y: Object.assign({}, both, { label: `estimated [${unit}]` }), label: "Estimated against true" },
      (g, sx, sy, box, root) => {
        g.append(line([[sx(both.low), sy(both.low)], [sx(both.high), sy(both.high)]], "fitted"), dots(items.map((i) => [sx(i[0]), sy(i[1])]), "after"));
        pickable(root, items.map((i) => [sx(i[0]), sy(i[1]), () => [`${i[2]}: true ${short(i[0], 5)} ${unit}, estimated ${short(i[1], 5)} ${unit}`], null]));
      }));
  }).filter(Boolean);
  return [el("div", { class: "plots" }, figures),
    table(["parameter", "joint", " estimated", " true", " true in gauge", " difference", "unit"], rows, { label: "Estimated and true parameters" })];
}

function planVerdict() {
  const sigma = RESULT.sigma;
  const count = RESULT.configurations.length;
  return [
    verdictBanner("plain", `${plural(count, "configuration")} to measure`, `Chosen from ${RESULT.candidates.count} candidates for ${plural(RESULT.targets, "target")} and ${RESULT.parameters} parameters, ${RESULT.criterion}-optimal.`),
    el("div", { class: "tiles" }, tile("Mean predicted 1 σ", sigma.plan.mean, [["a random choice", sigma.random.mean]], "of a point over the tasks"),
      tile("Largest predicted 1 σ", sigma.plan.max, [["a random choice", sigma.random.max]], "of a point over the tasks")),
    note("A plan is a prediction. It rests on the noise that was stated and on the nominal geometry; the way between configurations is not checked for collisions."),
    facts([["travel at full speed", `${fixed(RESULT.travel_seconds, 0)} s, without the stops`], ["D-efficiency", `at least ${fixed(RESULT.d_efficiency, 3)}`],
      ["drawn", `${RESULT.candidates.samples} samples${RESULT.candidates.refused.length ? ", refused: " + RESULT.candidates.refused.map((r) => `${r.samples} by ${r.constraint}`).join(", ") : ""}`],
      ...(DATA.setup || [])]),
  ];
}
function planInSpace() {
  const points = (DATA.rejected || []).map((place) => ({ place, kind: "quiet", size: 1.1, layer: "rejected" }));
  DATA.chosen.forEach((place, c) => points.push({ place, c, kind: "after", size: 3.6, layer: "chosen",
    lines: () => [`Configuration ${cut(CONFIGURATIONS[c].name, 40)}`], choose: () => select(c) }));
  const zones = DATA.zones || [];
  const corners = zones.flatMap((zone) => (zone.lower ? [zone.lower, zone.upper] : [zone.centre]));
  const scene = { robot: DATA.robot, configurations: CONFIGURATIONS, points, tracker: DATA.tracker || null, zones, beams: DATA.tracker ? DATA.beams : null,
    axes: DATA.axes, bounds: corners.concat(DATA.tracker ? [DATA.tracker] : []) };
  const layers = [["robot", "robot", null], ["chosen", "chosen", "dot after"], ["rejected", "rejected candidates", null]];
  if (zones.length) layers.push(["zones", "boxes and spheres", "mark"]);
  return [viewer(scene, layers),
    note("The flange in each chosen configuration, and in candidates that were not taken. Choose a point to see the arm there.",
      DATA.tracker ? " Dashed lines are the beams of the chosen configuration." : "", zones.length ? " Check on which side of the robot each box lies." : ""), planTable()];
}
function planTable() {
  const rows = CONFIGURATIONS.slice(0, MOST_ROWS).map((configuration, c) => ({
    cells: [el("button", { type: "button", class: "link", onclick: () => select(c) }, named(configuration.name, 24)), ...shownValues(configuration).map((v, j) => fixed(jointValue(SHOWN_JOINTS[j], v), 2))],
    attributes: { "data-c": c } }));
  return el("details", { open: rows.length <= 40 }, el("summary", {}, `Configurations in their order (${rows.length} of ${CONFIGURATIONS.length})`),
    table(["configuration", ...SHOWN_JOINTS.map((joint) => ` ${cut(joint.name, 16)} [${jointUnit(joint)}]`)], rows, { label: "Plan", class: "points" }));
}
function planAccuracy() {
  const { plan, random, floor } = RESULT.sigma;
  const row = (name, s) => [name, mm(s.mean), mm(s.p95), mm(s.max), mm(s.worst_configuration_rms)];
  const by = DATA.by_count || [];
  const points = (field) => by.filter((entry) => entry[field] !== null).map((entry) => [entry.count, entry[field] * 1e3]);
  const series = [{ kind: "after", text: "this plan, its most useful first", points: points("plan") }, { kind: "before", text: "random choice", points: points("random") }];
  return [
    table(["predicted 1 σ [mm]", " mean", " 95 %", " largest", " worst RMS of a configuration"], [row("this plan", plan), row("random choice", random),
      ...(floor === null ? [] : [["floor: no design is better", null, null, null, mm(floor)]])], { label: "Predicted accuracy" }),
    by.length > 1 ? el("div", { class: "plots" }, lines({ title: "Over the number of configurations", caption: "mean predicted 1 σ over the tasks", xLabel: "configurations", yLabel: "1 σ [mm]", yLog: true, hint: (p) => `${p[0]}: ${fixed(p[1], 4)} mm` }, series)) : null,
    RESULT.monte_carlo ? facts([["Monte Carlo", `${RESULT.monte_carlo.runs} runs, ${RESULT.monte_carlo.not_trusted} not to be trusted; RMS of a point ${mm(RESULT.monte_carlo.rms_of_point_mean)} mm in the mean`]]) : null,
  ];
}

function validationVerdict() {
  const { all, test } = ERRORS;
  const met = DATA.requirements.every((requirement) => requirement.fulfilled);
  return [
    verdictBanner(DATA.doubts.length || !met ? "bad" : DATA.requirements.length ? "good" : "plain",
      DATA.doubts.length ? "Not as it should be" : !met ? "Not as required" : DATA.requirements.length ? "As required" : `${mm(all.rms)} mm RMS, at most ${mm(all.max)} mm`,
      `Base and targets were registered to the ${RESULT.registered_to} rows, unless they were given. The geometry is as given: nothing of it was fitted.`),
    messages("Doubts", DATA.doubts, "bad"), requirementsTable(DATA.requirements),
    el("div", { class: "tiles" }, tile("All, RMS", all.rms, [], pointsAndMeans(all.count, all.means)), tile("All, 95 % within", all.p95, [], `of ${plural(all.count, "point")}`),
      tile("All, maximum", all.max, [], `of ${plural(all.count, "point")}`), test ? tile("Test, RMS", test.rms, [], pointsAndMeans(test.count, test.means)) : null),
    el("h3", {}, "Where it was measured"), jointRanges(), facts([["region", regionText()]]), messages("Warnings", DATA.warnings || [], "warn"),
  ];
}
function validationAccuracy() {
  const rows = (name, of, kind) => (of && of.means ? [[`${name} points`, of, kind], [`${name} means`, of.means, kind]] : [[name, of, kind]]);
  return [accuracyTable([...rows("All", ERRORS.all, "is"), ...rows("Train", ERRORS.train), ...rows("Test", ERRORS.test), ["RP repeatability", (RESULT.iso_9283 || {}).repeatability]]),
    accuracyNote(ERRORS.all.means), distributions("train", "test")];
}
