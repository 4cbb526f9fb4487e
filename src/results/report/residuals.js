// Residuals: whether anything is left in them that a model could explain.

// Least squares of y over the columns of `rows`, by the normal equations; null where they are singular.
function leastSquares(rows, y) {
  const n = rows[0].length;
  const a = Array.from({ length: n }, (_, i) => [...Array.from({ length: n }, (_, j) => sum(rows.map((r) => r[i] * r[j]))), sum(rows.map((r, k) => r[i] * y[k]))]);
  for (let i = 0; i < n; ++i) {
    const pivot = a.slice(i).reduce((best, row, k) => (Math.abs(row[i]) > Math.abs(a[best][i]) ? i + k : best), i);
    [a[i], a[pivot]] = [a[pivot], a[i]];
    if (Math.abs(a[i][i]) < 1e-12 * rows.length) return null;
    for (let k = 0; k < n; ++k) {
      if (k === i) continue;
      const factor = a[k][i] / a[i][i];
      for (let j = i; j <= n; ++j) a[k][j] -= factor * a[i][j];
    }
  }
  return a.map((row, i) => row[n] / row[i]);
}

// Quantile of the normal distribution (Acklam's rational approximation, 1e-9).
function normalQuantile(p) {
  const a = [-39.69683028665376, 220.9460984245205, -275.9285104469687, 138.357751867269, -30.66479806614716, 2.506628277459239];
  const b = [-54.47609879822406, 161.5858368580409, -155.6989798598866, 66.80131188771972, -13.28068155288572];
  const c = [-0.007784894002430293, -0.3223964580411365, -2.400758277161838, -2.549732539343734, 4.374664141464968, 2.938163982698783];
  const d = [0.007784695709041462, 0.3224671290700398, 2.445134137142996, 3.754408661907416];
  const along = (k, x) => k.reduce((value, next) => value * x + next, 0);
  if (p < 0.02425) {
    const q = Math.sqrt(-2 * Math.log(p));
    return along(c, q) / (along(d, q) * q + 1);
  }
  if (p > 1 - 0.02425) return -normalQuantile(1 - p);
  const q = p - 0.5, r = q * q;
  return (along(a, r) * q) / (along(b, r) * r + 1);
}

const COMPONENTS = ["x", "y", "z"].map((axis) => [axis, `along ${axis} of ${PLACES}`]);
const IN_PLACES = () => {
  const X_KW = times(TO_WORLD, inverse(DATA.robot.base));
  return POINTS.map((point) => turned(X_KW, point.residual).map((v) => v * 1e3));
};

// Component `axis` of the residuals against one joint, with the first harmonic fitted to it, or a line.
function againstJoint(joint, j, axis, residuals, y) {
  const at = (value) => jointValue(joint, value);
  const raw = POINTS.map((point) => shownValues(CONFIGURATIONS[point.c])[j]);
  const items = POINTS.map((point, i) => ({ x: at(raw[i]), y: residuals[i][axis], point }));
  const low = Math.min(...raw), high = Math.max(...raw);
  const straight = isLinear(joint) || high - low < 45 * DEGREE;  // over less a harmonic says what no data say
  const basis = (value) => (straight ? [1, value] : [1, Math.cos(value), Math.sin(value)]);
  const fit = high - low > (isLinear(joint) ? 1e-3 : 2 * DEGREE) ? leastSquares(raw.map(basis), items.map((i) => i.y)) : null;
  const curve = fit ? Array.from({ length: 61 }, (_, i) => low + ((high - low) * i) / 60).map((v) => [at(v), sum(basis(v).map((b, k) => b * fit[k]))]) : [];
  const reach = Math.abs(at(high) - at(low)) / 10;
  const x = Object.assign(spread(items.map((i) => i.x), 0.04), { label: `${cut(joint.name, 20)} [${jointUnit(joint)}]` });
  return scatter({ title: cut(joint.name, 24), height: 190, x, y,
    under: (g, sx, sy, box) => {
      g.append(svg("line", { class: "zero", x1: box.left, x2: box.right, y1: sy(0), y2: sy(0) }));
      for (const run of runs(curve, ([cx]) => items.some((i) => Math.abs(i.x - cx) <= reach))) g.append(line(run.map(([cx, cy]) => [sx(cx), sy(cy)]), "fitted"));
    } }, items);
}

function jointResiduals() {
  const residuals = IN_PLACES();
  const holder = el("div", { class: "plots small" });
  const show = (axis) => {
    const y = Object.assign(spread(residuals.map((r) => r[axis]).concat([0])), { label: `${COMPONENTS[axis][0]} [mm]` });
    holder.replaceChildren(...SHOWN_JOINTS.map((joint, j) => againstJoint(joint, j, axis, residuals, y)));
  };
  const choice = el("select", { "aria-label": "Component of the residuals", onchange: (event) => show(Number(event.target.value)) },
    COMPONENTS.map(([, text], i) => el("option", { value: i }, text)));
  choice.value = "2";
  show(2);
  return [el("div", { class: "heading" }, el("h3", {}, "Against each joint"), el("label", { class: "choice" }, "residual ", choice)), holder];
}

// Along the line of sight, and across it: level, and in the plane of the line and the device's z axis.
function sightParts(point) {
  const u = point.measured.map((v) => v / (norm(point.measured) || 1));
  let level = cross([0, 0, 1], u);
  level = norm(level) > 1e-6 ? level.map((v) => v / norm(level)) : [1, 0, 0];
  const upright = cross(u, level);
  const along = (a) => 1e3 * sum(a.map((v, i) => v * point.residual[i]));
  return [along(u), along(level), along(upright)];
}
function otherResiduals() {
  const stated = POINTS.every((point) => point.order !== undefined);
  const order = POINTS.map((point) => ({ x: stated ? point.order : point.row + 1, y: norm(point.residual) * 1e3, point }));
  const parts = POINTS.map(sightParts);
  const sight = POINTS.map((point, i) => ({ x: parts[i][1], y: parts[i][0], point }));
  const most = Math.max(...sight.flatMap((s) => [Math.abs(s.x), Math.abs(s.y)])) * 1.06 || 1;
  const sizes = [0, 1, 2].map((k) => rms(parts.map((p) => p[k])));
  const components = POINTS.flatMap((point) => point.residual.map((v) => ({ y: v * 1e3, point }))).sort((a, b) => a.y - b.y);
  const normal = components.map((item, i) => ({ x: normalQuantile((i + 0.5) / components.length), y: item.y, point: item.point }));
  const values = components.map((c) => c.y);
  const slope = (quantile(values, 0.75) - quantile(values, 0.25)) / 1.349;
  const zero = (g, sx, sy, box) => g.append(svg("line", { class: "zero", x1: box.left, x2: box.right, y1: sy(0), y2: sy(0) }));
  return [
    el("div", { class: "plots small" },
      scatter({ title: "In the order of measurement", x: Object.assign(spread(order.map((i) => i.x), 0.02), { label: stated ? "place in the order" : "row of the file" }),
        y: Object.assign(spread(order.map((i) => i.y).concat([0]), 0.04), { label: "residual [mm]" }) }, order),
      scatter({ title: "Along and across the line of sight", x: { low: -most, high: most, label: "across, level [mm]" }, y: { low: -most, high: most, label: "along [mm]" },
        under: (g, sx, sy, box) => {
          zero(g, sx, sy, box);
          g.append(svg("line", { class: "zero", x1: sx(0), x2: sx(0), y1: box.top, y2: box.bottom }));
        } }, sight),
      scatter({ title: "Against a normal distribution", x: Object.assign(spread(normal.map((i) => i.x), 0.02), { label: "normal quantile [σ]" }),
        y: Object.assign(spread(values), { label: "component [mm]" }),
        under: (g, sx, sy) => g.append(line([normal[0].x, normal[normal.length - 1].x].map((q) => [sx(q), sy(quantile(values, 0.5) + slope * q)]), "fitted")) }, normal)),
    note(`RMS along the line of sight ${fixed(sizes[0], 3)} mm, across it ${fixed(sizes[1], 3)} mm level and ${fixed(sizes[2], 3)} mm upright. `,
      "On the straight line residuals are normally distributed; points that leave it at the ends are outliers."),
  ];
}

// What the result alone says: rows without joints and places.
function rowsOfResult() {
  const residuals = RESULT.residuals || {};
  const rows = (residuals.rows || residuals.largest || []).slice().sort((a, b) => b.distance - a.distance);
  return [missing(whyMissing(DATA.robot ? "measurements" : "robot")),
    rows.length ? el("details", { open: true }, el("summary", {}, `Rows of the result, largest first (${Math.min(MOST_ROWS, rows.length)} of ${residuals.statistics ? residuals.statistics.count : rows.length})`),
      table(["configuration", "repeat", "target", "rows", " calibrated [mm]"],
        rows.slice(0, MOST_ROWS).map((r) => [named(r.configuration, 24), String(r.repeat), named(r.target, 24), r.split, mm(r.distance)]), { label: "Residuals" })) : null];
}
function residuals() {
  if (!DATA.robot || !POINTS.length) return rowsOfResult();
  const marked = POINTS.filter((p) => p.marked).length;
  return [
    el("ul", { class: "legend" }, el("li", {}, el("span", { class: "key dot after" }), "fitted, mean of the repeats"),
      POINTS.some((p) => p.test) ? el("li", {}, el("span", { class: "key dot test" }), "test rows") : null,
      marked ? el("li", {}, el("span", { class: "key cross" }, "×"), "a finding, or beyond five times the median") : null,
      el("li", {}, el("span", { class: "key fitted" }), "fitted first harmonic, near measured values; a line where a joint moved less than 45°")),
    jointResiduals(), otherResiduals(),
    MEASURED.complete ? null : note(`${MEASURED.points.length} of ${MEASURED.rows} rows are drawn: evenly spaced ones and the 200 largest.`),
  ];
}
