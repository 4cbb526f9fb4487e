// What has changed: of a robot between two calibrations, and of a program that was compensated.

// The notes of both results side by side; those that differ are marked.
function notesTable() {
  const { before = {}, after = {} } = RESULT.notes || {};
  const keys = [...new Set([...Object.keys(before), ...Object.keys(after)])].sort();
  return keys.length ? table(["note", "before", "after", ""], keys.map((key) => {
    const differs = key in before && key in after && before[key] !== after[key];
    return { cells: [named(key, 40), key in before ? named(before[key], 60) : null, key in after ? named(after[key], 60) : null, differs ? "differs" : ""], attributes: { class: differs ? "missed" : null } };
  }), { label: "Notes", class: "notes" }) : note("Neither result has notes, such as a serial number.");
}

function comparisonVerdict() {
  const likely = RESULT.changed || RESULT.p_value < 0.05;
  return [
    verdictBanner(likely ? "bad" : "good",
      RESULT.changed ? "The robot has changed" : likely ? "The robot may have changed" : "No change found",
      `An unchanged robot gives a difference as large as this with probability ${RESULT.p_value ? short(RESULT.p_value, 2) : "0 (rounded)"} (χ² ${fixed(RESULT.chi_square, 1)} of ${fixed(RESULT.degrees_of_freedom, 0)} directions).`),
    RESULT.advice ? el("p", {}, el("strong", {}, "What to do: "), RESULT.advice + ".") : null,
    notesTable(),
    requirementsTable(DATA.requirements),
    el("div", { class: "tiles" },
      tile("Change of the flange, RMS", RESULT.flange.rms, [["of an unchanged robot", RESULT.flange.sigma]], `at ${plural(RESULT.flange.count, "pose")} that both measured, base and tool aligned`),
      tile("Change of the flange, maximum", RESULT.flange.max, [], "")),
    RESULT.same_measurements ? note("Both results are of the same measurements, which cannot show whether the robot has changed.") : null,
    RESULT.unseen_zeros.length ? note("A changed zero does not show in: " + RESULT.unseen_zeros.join(", ") + ". A moved base or tool would look the same.") : null,
    RESULT.not_compared.length ? note("Not compared, as only one of the results determines them: " + RESULT.not_compared.join(", ") + ".") : null,
  ];
}

function changedParameters() {
  const excess = (p) => Math.abs(p.change) / p.std;
  const rows = [...RESULT.parameters].sort((a, b) => excess(b) - excess(a)).map((p) => {
    const { unit, factor, decimals } = p.unit === "m" ? { unit: "mm", factor: 1e3, decimals: 4 } : { unit: "°", factor: 1 / DEGREE, decimals: 5 };
    const shown = (value) => (p.unit ? fixed(value * factor, decimals) : short(value));
    return [el("span", {}, named(p.name, 24), p.joint ? [", ", named(p.joint, 24)] : null), shown(p.before), shown(p.change), shown(p.std), p.unit ? unit : "SI", fixed(excess(p), 1), fixed(100 * p.explained, 0) + " %"];
  });
  return [
    note("In the gauge of the earlier result. Several parameters can explain one change; what each of them explains alone is stated last."),
    table(["parameter", " before", " change", " 1 σ", "unit", " change / σ", " explains alone"], rows, { label: "Changes of the parameters" }),
  ];
}

const NOT_EXACT = () => RESULT.points - RESULT.status.exact;

function compensationVerdict() {
  const missed = NOT_EXACT();
  return [
    verdictBanner(missed ? "bad" : "good", missed ? `${missed} of ${plural(RESULT.points, "point")} ${missed === 1 ? "is" : "are"} not exact` : "Every point is exact",
      `Remaining error of the flange: at most ${fixed(RESULT.largest_position_error * 1e3, 4)} mm and ${short(RESULT.largest_orientation_error * 1e3)} mrad, as far as the calibrated model holds.`),
    messages("Warnings", DATA.warnings, "warn"),
    table(["status", " points"], Object.entries(RESULT.status).map(([status, count]) => [status.replace(/_/g, " "), String(count)]), { label: "Status of the points" }),
  ];
}

// The points of the page: evenly spaced ones of a long program.
function corrections() {
  const points = DATA.points;
  const held = points.filter((p) => p.status !== "exact");
  const size = (p) => [p.ordinal, p.correction * 1e3];
  return [
    points.length < RESULT.points ? note(`${points.length} of ${RESULT.points} points, evenly spaced.`) : null,
    lines({ title: "Correction of each point", caption: "How far the commanded flange is from the asked one.", xLabel: "point", yLabel: "correction [mm]", fromZero: true, hint: (p) => `point ${p[0]}, ${fixed(p[1], 3)} mm` },
      [{ kind: "after", text: "correction", points: points.map(size) }, ...(held.length ? [{ kind: "mark", text: "not exact", points: held.flatMap((p) => [size(p), [p.ordinal, NaN]]) }] : [])]),
    el("h3", {}, "Largest change of each joint"),
    table(["joint", " change", "unit"], RESULT.largest_change.map((joint) => [named(joint.joint, 28), fixed(joint.unit === "m" ? joint.change * 1e3 : joint.change / DEGREE, 4), joint.unit === "m" ? "mm" : "°"]), { label: "Largest changes" }),
  ];
}

function boundedPoints() {
  const listed = RESULT.not_exact.slice(0, 200);
  if (!listed.length) return note("None: no joint was held at a bound.");
  return [
    table(["configuration", "status", " position error [mm]", " orientation error [mrad]"],
      listed.map((p) => [named(p.configuration, 40), p.status.replace(/_/g, " "), fixed(p.position_error * 1e3, 4), fixed(p.orientation_error * 1e3, 3)]), { label: "Points that are not exact" }),
    listed.length < NOT_EXACT() ? note(`The first ${listed.length} of ${NOT_EXACT()}.`) : null,
  ];
}
