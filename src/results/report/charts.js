// Charts as inline SVG. Each is drawn for the width that it has, and drawn anew where that changes.

function niceTicks(low, high, wanted) {
  const span = high - low || 1;
  const raw = span / Math.max(1, wanted);
  const power = Math.pow(10, Math.floor(Math.log10(raw)));
  const step = [1, 2, 2.5, 5, 10].map((f) => f * power).find((s) => s >= raw * 0.999) || 10 * power;
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * span; ++i) ticks.push(i * step);
  if (ticks.length < 2 && wanted < 20) return niceTicks(low, high, 2 * wanted);
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) + (Math.abs(step / power - 2.5) < 1e-9 && step < 10 ? 1 : 0);
  return ticks.map((value) => ({ value, label: decimals > 6 ? short(value, 2) : fixed(value, decimals) }));
}
function logTicks(low, high, wanted) {
  const ticks = [];
  const first = Math.floor(Math.log10(low));
  const last = Math.ceil(Math.log10(high));
  const factors = last - first <= 2 ? [1, 2, 5] : [1];
  const skip = Math.max(1, Math.ceil((last - first) / Math.max(2, wanted)));
  for (let power = first; power <= last; ++power) {
    for (const factor of factors) {
      const value = factor * Math.pow(10, power);
      if (value < low * 0.999 || value > high * 1.001) continue;
      if (factor === 1 && (power - first) % skip !== 0) continue;
      const label = power >= -3 && power <= 4 ? fixed(value, Math.max(0, -power)) : short(value, 1);
      ticks.push({ value, label });
    }
  }
  return ticks;
}
function scale(axis, from, to) {
  const of = axis.log ? Math.log10 : (v) => v;
  const low = of(axis.low);
  const span = of(axis.high) - low || 1;
  return (value) => from + ((of(value) - low) / span) * (to - from);
}
function spread(values, margin = 0.05) {
  let low = Infinity, high = -Infinity;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (!(low <= high)) return { low: 0, high: 1 };
  const pad = (high - low || Math.abs(high) || 1) * margin;
  return { low: low - pad, high: high + pad };
}
function logSpread(values) {
  const positive = values.filter((v) => v > 0);
  if (!positive.length) return { low: 1e-3, high: 1, log: true };
  let low = Infinity, high = 0;
  for (const value of positive) {
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return { low: low / 1.3, high: Math.max(high * 1.3, low * 2), log: true };
}

// A figure with a title, a legend and a picture that `draw(width)` returns.
function figure(options, draw) {
  const holder = el("div", { class: "plot" });
  const entries = (options.legend || []).map(([kind, text]) => el("li", {}, el("span", { class: "key " + kind, "aria-hidden": "true" }), text));
  const node = el("figure", { class: options.class || null },
    options.title ? el("figcaption", {}, el("strong", {}, options.title), options.caption ? el("span", {}, " " + options.caption) : null) : null,
    entries.length ? el("ul", { class: "legend" }, entries) : null, holder);
  let width = 0;
  const redraw = () => {
    const now = Math.max(200, Math.round(holder.clientWidth || 480));
    if (now === width) return;
    width = now;
    const focused = holder.contains(document.activeElement);
    holder.replaceChildren(draw(width));
    if (focused) holder.firstElementChild.focus({ preventScroll: true });
  };
  node.redraw = () => { width = 0; redraw(); };
  new ResizeObserver(redraw).observe(holder);
  return node;
}

// Axes with units; `content(g, sx, sy, box)` draws inside. Returns the SVG.
function axes(width, options, content) {
  const height = options.height || 240;
  const ticksOf = (axis, wanted) => axis.ticks || (axis.log ? logTicks(axis.low, axis.high, wanted) : niceTicks(axis.low, axis.high, wanted));
  const box = { right: width - 12, top: 10, bottom: height - (options.x.label ? 40 : 24) };
  const yTicks = ticksOf(options.y, Math.max(2, (box.bottom - box.top) / 42));
  box.left = Math.max(52, 26 + 6.5 * Math.max(0, ...yTicks.map((tick) => tick.label.length)));
  const sx = scale(options.x, box.left, box.right);
  const sy = scale(options.y, box.bottom, box.top);
  const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", "aria-label": options.label || "" });
  const grid = svg("g", { class: "grid" });
  for (const tick of yTicks) {
    const y = sy(tick.value);
    grid.append(svg("line", { x1: box.left, x2: box.right, y1: y, y2: y }),
      svg("text", { x: box.left - 7, y: y + 4, "text-anchor": "end" }, tick.label));
  }
  let free = -Infinity;
  for (const tick of ticksOf(options.x, (box.right - box.left) / 52)) {
    const x = sx(tick.value);
    const half = tick.label.length * 3.4;
    grid.append(svg("line", { class: "tick", x1: x, x2: x, y1: box.bottom, y2: box.bottom + 4 }));
    if (x - half < free) continue;
    free = x + half + 8;
    grid.append(svg("text", { x: Math.min(x, width - half), y: box.bottom + 17, "text-anchor": "middle" }, tick.label));
  }
  grid.append(svg("line", { class: "axis", x1: box.left, x2: box.right, y1: box.bottom, y2: box.bottom }));
  const titles = svg("g", { class: "titles" });
  if (options.x.label) titles.append(svg("text", { x: (box.left + box.right) / 2, y: height - 5, "text-anchor": "middle" }, options.x.label));
  if (options.y.label) {
    const middle = (box.top + box.bottom) / 2;
    titles.append(svg("text", { x: 12, y: middle, "text-anchor": "middle", transform: `rotate(-90 12 ${middle})` }, options.y.label));
  }
  const inside = svg("g", {});
  root.append(grid, inside, titles);
  content(inside, sx, sy, box, root);
  return root;
}

const dots = (points, kind) => svg("path", { class: "dots " + kind, d: points.map(([x, y]) => `M${x.toFixed(1)} ${y.toFixed(1)}h.01`).join("") });
const crosses = (points) => svg("path", {
  class: "crosses",
  d: points.map(([x, y]) => `M${(x - 4).toFixed(1)} ${(y - 4).toFixed(1)}l8 8m0-8l-8 8`).join(""),
});
const line = (points, kind) => svg("path", { class: "line " + kind, d: points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("") });
const area = (points, kind) => svg("path", { class: "area " + kind, d: points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("") + "Z" });

// The same by keys: arrows go from place to place, from left to right, Enter chooses. The holder remembers where, since
// a choice draws the chart anew.
function walkable(root, places) {
  const order = places.map((_, i) => i).sort((a, b) => places[a][0] - places[b][0] || places[a][1] - places[b][1]);
  const here = svg("circle", { class: "ring here", r: 9 });
  const show = () => {
    const place = places[order[Math.max(0, Math.min(order.length - 1, Number(root.parentNode.dataset.at)))]];
    here.setAttribute("cx", place[0]);
    here.setAttribute("cy", place[1]);
    root.append(here);
    const at = here.getBoundingClientRect();
    showTip({ clientX: (at.left + at.right) / 2, clientY: (at.top + at.bottom) / 2 }, place[2]());
    return place;
  };
  root.setAttribute("tabindex", "0");
  root.addEventListener("keydown", (event) => {
    const at = root.parentNode.dataset.at;
    const next = { ArrowRight: Number(at) + 1, ArrowLeft: Number(at) - 1, Home: 0, End: order.length - 1, Enter: Number(at), " ": Number(at) }[event.key];
    if (next === undefined || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    root.parentNode.dataset.at = Number.isNaN(next) ? 0 : Math.max(0, Math.min(order.length - 1, next));
    const place = show();
    if (at !== undefined && (event.key === "Enter" || event.key === " ") && place[3]) place[3]();
  });
  root.addEventListener("focus", () => { if (root.parentNode.dataset.at !== undefined && root.matches(":focus-visible")) show(); });
  root.addEventListener("blur", () => {
    here.remove();
    hideTip();
  });
}

// Whatever lies next to the pointer is named, and chosen by a click. `places`: [x, y, lines of the hint, on click].
function pickable(root, places) {
  if (places.length) walkable(root, places);
  const nearest = (event) => {
    const frame = root.getBoundingClientRect();
    const factor = frame.width / root.viewBox.baseVal.width || 1;
    let best = null;
    let least = 14 * 14;
    for (const place of places) {
      const dx = place[0] * factor + frame.left - event.clientX;
      const dy = place[1] * factor + frame.top - event.clientY;
      if (dx * dx + dy * dy < least) {
        least = dx * dx + dy * dy;
        best = place;
      }
    }
    return best;
  };
  root.addEventListener("pointermove", (event) => {
    const best = nearest(event);
    root.style.cursor = best && best[3] ? "pointer" : "";
    if (best) showTip(event, best[2]());
    else hideTip();
  });
  root.addEventListener("pointerleave", hideTip);
  root.addEventListener("click", (event) => {
    const best = nearest(event);
    if (best && best[3]) best[3]();
  });
}

// Stretches of neighbours that are all wanted.
function runs(points, wanted) {
  const found = [[]];
  for (const point of points) {
    if (wanted(point)) found[found.length - 1].push(point);
    else if (found[found.length - 1].length) found.push([]);
  }
  return found.filter((run) => run.length);
}

// Points of the measurements at (x, y): hover names them, a click chooses their configuration, which stays ringed.
function scatter(options, items) {
  const node = figure(options, (width) => axes(width, {
    height: options.height, label: options.title,
    x: options.x || spread(items.map((i) => i.x)), y: options.y || spread(items.map((i) => i.y)),
  }, (g, sx, sy, box, root) => {
    if (options.under) options.under(g, sx, sy, box);
    const at = items.map((item) => [sx(item.x), sy(item.y)]);
    const where = (keep) => at.filter((_, i) => keep(items[i]));
    g.append(dots(where((i) => !i.point.marked && !i.point.test), options.kind || "after"),
      dots(where((i) => !i.point.marked && i.point.test), "test"), crosses(where((i) => i.point.marked)));
    const chosen = where((i) => i.point.c === SELECTED.c && SELECTED.c >= 0);
    for (const [x, y] of chosen) g.append(svg("circle", { class: "ring", cx: x, cy: y, r: 6 }));
    pickable(root, items.map((item, i) => [at[i][0], at[i][1], () => hintOf(item.point), () => select(item.point.c, item.point)]));
  }));
  FOLLOWERS.push(node.redraw);
  return node;
}

// Distributions over a logarithmic axis. `series`: {kind, text, values (ascending), count}.
function logAxisOf(series, label) {
  const positive = (s) => s.values.filter((v) => v > 0).map((v) => v * 1e3);
  const axis = logSpread(series.flatMap((s) => { const values = positive(s); return values.length ? [quantile(values, 0.01), values[values.length - 1]] : []; }));
  axis.low = Math.max(axis.low, axis.high / 1e7);  // a few points at rounding should not squeeze the others
  return Object.assign(axis, { label });
}
function histogram(title, series, label) {
  const x = logAxisOf(series, label);
  const bins = 26;
  const low = Math.log10(x.low);
  const step = (Math.log10(x.high) - low) / bins;
  const counted = series.map((s) => {
    const shares = new Array(bins).fill(0);
    for (const value of s.values) {
      const bin = Math.floor((Math.log10(Math.max(value * 1e3, x.low)) - low) / step);
      shares[Math.max(0, Math.min(bins - 1, bin))] += 100 / s.values.length;
    }
    return shares;
  });
  const high = Math.max(...counted.flat()) * 1.06;
  return figure({ title, legend: series.map((s) => [s.kind + " fill", s.text]) }, (width) => axes(width,
    { x, y: { low: 0, high, label: "points [%]" }, label: title }, (g, sx, sy, box) => {
      series.forEach((s, index) => {
        const outline = [[box.left, box.bottom]];
        counted[index].forEach((share, bin) => {
          outline.push([sx(Math.pow(10, low + bin * step)), sy(share)], [sx(Math.pow(10, low + (bin + 1) * step)), sy(share)]);
        });
        outline.push([box.right, box.bottom]);
        g.append(area(outline, s.kind), line(outline, s.kind));
      });
    }));
}
function cumulative(title, series, label) {
  const x = logAxisOf(series, label);
  return figure({ title, legend: series.map((s) => [s.kind, s.text]) }, (width) => axes(width,
    { x, y: { low: 0, high: 100, label: "points not above [%]", ticks: [0, 25, 50, 75, 100].map((value) => ({ value, label: String(value) })) }, label: title }, (g, sx, sy, box, root) => {
      const places = [];
      for (const s of series) {
        const path = [[box.left, box.bottom]];
        s.values.forEach((value, i) => {
          const share = (100 * (i + 1)) / s.values.length;
          const at = sx(Math.max(value * 1e3, x.low));
          path.push([at, path[path.length - 1][1]], [at, sy(share)]);
          places.push([at, sy(share), () => [`${s.text}: ${fixed(share, 1)} % within ${mm(value)} mm`], null]);
        });
        path.push([box.right, box.top]);
        g.append(line(path, s.kind));
      }
      const y95 = sy(95);
      g.append(svg("line", { class: "limit", x1: box.left, x2: box.right, y1: y95, y2: y95 }),
        svg("text", { class: "limit", x: box.left + 4, y: y95 + 13 }, "95 %"));
      pickable(root, places);
    }));
}

// Lines over a common axis. `series`: {kind, text, points: [[x, y, half of a band]…], smooth: no dots}. A y that is not
// finite leaves a gap.
function lines(options, series) {
  const xs = series.flatMap((s) => s.points.map((p) => p[0]));
  const ys = series.flatMap((s) => s.points.flatMap((p) => [p[1] - (p[2] || 0), p[1] + (p[2] || 0)])).filter(Number.isFinite);
  const x = Object.assign(options.xLog ? logSpread(xs) : spread(xs, 0.03), { label: options.xLabel, ticks: options.xTicks });
  const y = Object.assign(options.yLog ? logSpread(ys) : spread(options.fromZero ? ys.concat([0]) : ys), { label: options.yLabel });
  return figure({ title: options.title, caption: options.caption, legend: series.map((s) => [s.kind, s.text]) }, (width) => axes(width,
    { x, y, label: options.title, height: options.height }, (g, sx, sy, box, root) => {
      const places = [];
      for (const s of series) {
        for (const run of runs(s.points, (p) => Number.isFinite(p[1]) && (!options.yLog || p[1] > 0))) {
          const at = run.map((p) => [sx(p[0]), sy(p[1])]);
          const edge = (sign) => run.map((p) => [sx(p[0]), sy(p[1] + sign * p[2])]);
          if (run.every((p) => Number.isFinite(p[2]))) g.append(area([...edge(1), ...edge(-1).reverse()], s.kind));
          g.append(line(at, s.kind));
          if (s.smooth) continue;
          g.append(dots(at, s.kind));
          run.forEach((p, i) => places.push([at[i][0], at[i][1], () => [`${s.text}: ${options.hint ? options.hint(p) : short(p[1])}`], null]));
        }
      }
      if (places.length) pickable(root, places);
    }));
}
