// The robot in 3D on a canvas, without a library: faces and lines sorted by their distance from the eye.

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const plus = (a, b, k) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const middleOf = (points) => [0, 1, 2].map((i) => sum(points.map((p) => p[i])) / points.length);

// Dark to light violet, green, yellow, which grow lighter steadily for every eye and in print.
const STEPS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function tone(share) {
  const at = Math.max(0, Math.min(0.9999, share)) * (STEPS.length - 1);
  const i = Math.floor(at);
  return `rgb(${[0, 1, 2].map((k) => Math.round(STEPS[i][k] + (at - i) * (STEPS[i + 1][k] - STEPS[i][k]))).join(",")})`;
}

// As in the charts, so that arrows differ without their colour.
const DASHES = { before: [4, 3], held: [1.5, 3] };

// `scene`: robot, configurations, points [{place, c, arrows: [{kind, vector}], lines, choose}], cells, tracker, zones
// [{name, lower, upper} or {name, centre, radius}], beams [[target] of a configuration], axes {name, pose}.
class View {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.layers = { robot: true, points: true, before: true, after: true, held: true, cells: false };
    this.exaggeration = 100;
    this.faces = (scene.robot ? scene.robot.shapes : []).map((shape) => ({ link: shape.link, faces: facesOf(shape) }));
    this.reset();
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    for (const [event, printing] of [["beforeprint", true], ["afterprint", false]]) {
      addEventListener(event, () => {
        document.documentElement.classList.toggle("printing", printing);  // paper is white, whatever the screen is
        this.draw();
      });
    }
    this.listen();
  }

  reset() {
    const all = this.scene.points.map((point) => point.place);
    if (this.scene.robot) {
      for (const frame of framesAt(this.scene.robot, this.joints())) all.push([frame[3], frame[7], frame[11]]);
    }
    for (const place of this.scene.bounds || []) all.push(place);
    if (!all.length) all.push([0, 0, 0]);
    const low = [0, 1, 2].map((i) => Math.min(...all.map((p) => p[i])));
    const high = [0, 1, 2].map((i) => Math.max(...all.map((p) => p[i])));
    this.centre = middleOf([low, high]);
    this.radius = Math.max(0.2, 0.5 * norm(minus(high, low)));
    this.yaw = this.scene.yaw === undefined ? 0.7 : this.scene.yaw;
    this.pitch = 0.35;
    this.zoom = 1;
    this.pan = [0, 0];
  }

  joints() {
    const { configurations, robot } = this.scene;
    const chosen = configurations[SELECTED.c] || configurations[0];
    return chosen ? drivenBy(chosen) : robot ? robot.joints.map(() => 0) : [];
  }

  // Screen place and depth of a point in the base frame.
  project(p) {
    const [x, y, z] = minus(p, this.centre);
    const cy = Math.cos(this.yaw), sy = Math.sin(this.yaw), cp = Math.cos(this.pitch), sp = Math.sin(this.pitch);
    const right = -sy * x + cy * y;
    const towards = cy * x + sy * y;
    const up = cp * z - sp * towards;
    const near = cp * towards + sp * z;
    const eye = 4.5 * this.radius;
    const factor = (this.unit * this.zoom * eye) / Math.max(0.05 * eye, eye - near);
    return [this.width / 2 + this.pan[0] + factor * right, this.height / 2 + this.pan[1] - factor * up, near];
  }

  draw() {
    const ratio = Math.min(3, Math.max(2, devicePixelRatio || 1));
    this.width = this.canvas.clientWidth || 600;
    this.height = this.canvas.clientHeight || 400;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.unit = (0.44 * Math.min(this.width, this.height * 1.1)) / this.radius;
    const style = getComputedStyle(document.documentElement);
    this.colour = (name) => style.getPropertyValue("--" + name).trim();
    const g = this.canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.fillStyle = this.colour("canvas");
    g.fillRect(0, 0, this.width, this.height);
    g.lineCap = g.lineJoin = "round";
    this.floor(g);
    this.items = [];
    if (this.scene.robot && this.layers.robot) this.arm();
    if (this.layers.cells) this.cells();
    this.pointsAndArrows();
    if (this.layers.zones !== false) for (const zone of this.scene.zones || []) this.zone(zone);
    this.trackerAndAxes();
    this.items.sort((a, b) => a.depth - b.depth);
    for (const item of this.items) item.paint(g);
  }

  floor(g) {
    const reach = Math.ceil(this.radius * 1.3);
    const step = reach > 4 ? 1 : 0.5;
    g.strokeStyle = this.colour("floor");
    g.lineWidth = 1;
    g.beginPath();
    for (let at = -reach; at <= reach + 1e-9; at += step) {
      for (const ends of [[[at, -reach, 0], [at, reach, 0]], [[-reach, at, 0], [reach, at, 0]]]) {
        const [a, b] = ends.map((p) => this.project(p));
        g.moveTo(a[0], a[1]);
        g.lineTo(b[0], b[1]);
      }
    }
    g.stroke();
  }

  add(depth, paint) { this.items.push({ depth, paint }); }

  arm() {
    const frames = framesAt(this.scene.robot, this.joints());
    const places = frames.map((f) => [f[3], f[7], f[11]]);
    const shaped = new Set(this.faces.map((f) => f.link));
    const [r, gr, b] = this.colour("arm").split(/[\s,]+/).map(Number);
    for (const { link, faces } of this.faces) {
      for (const face of faces) {
        const corners = face.map((p) => moved(frames[link], p));
        const at = corners.map((p) => this.project(p));
        const ahead = cross(minus([...at[1].slice(0, 2), 0], [...at[0].slice(0, 2), 0]), minus([...at[2].slice(0, 2), 0], [...at[1].slice(0, 2), 0]))[2];
        if (ahead > 0) continue;
        const normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[1]));
        const light = 0.72 + 0.28 * (normal[2] * 0.8 + normal[0] * 0.35 - normal[1] * 0.3) / (norm(normal) || 1);
        const fillColour = `rgb(${Math.round(r * light)},${Math.round(gr * light)},${Math.round(b * light)})`;
        this.add(sum(at.map((p) => p[2])) / at.length, (g) => {
          g.beginPath();
          at.forEach((p, i) => (i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
          g.closePath();
          g.fillStyle = g.strokeStyle = fillColour;
          g.lineWidth = 0.7;
          g.fill();
          g.stroke();
        });
      }
    }
    for (let i = 1; i < places.length; ++i) {
      if (norm(minus(places[i], places[i - 1])) < 1e-6 || shaped.has(i - 1)) continue;
      this.stroke([places[i - 1], places[i]], "skeleton", Math.max(3, Math.min(16, 0.04 * this.unit * this.zoom)));
    }
    this.scene.robot.segments.forEach((segment, i) => {
      if (segment.joint === undefined || shaped.size > 0) return;
      const axis = turned(frames[i + 1], segment.axis);
      const half = 0.07 * this.radius;
      this.stroke([plus(places[i + 1], axis, -half), plus(places[i + 1], axis, half)], "axis3d", 3, 0.02);
    });
  }

  stroke(points, name, width, towards = 0, dash = []) {
    const at = points.map((p) => this.project(p));
    const colour = this.colour(name);
    this.add(sum(at.map((p) => p[2])) / at.length + towards * this.radius, (g) => {
      g.strokeStyle = colour;
      g.lineWidth = width;
      g.setLineDash(dash);
      g.beginPath();
      at.forEach((p, i) => (i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
      g.stroke();
      g.setLineDash([]);
    });
  }

  cells() {
    const cells = this.scene.cells || [];
    const low = Math.min(...cells.map((c) => c.mean));
    const high = Math.max(...cells.map((c) => c.mean));
    for (const cell of cells) {
      const at = this.project(cell.centre);
      const size = 0.12 * (this.scene.cell || 0.5) * this.unit * this.zoom;
      this.add(at[2], (g) => {
        g.globalAlpha = 0.75;
        g.fillStyle = tone((cell.mean - low) / (high - low || 1));
        g.fillRect(at[0] - size, at[1] - size, 2 * size, 2 * size);
        g.globalAlpha = 1;
      });
    }
  }

  // The edges of a box, or three circles of a sphere.
  zone({ name, lower, upper, centre, radius, kind }) {
    const colour = kind || "mark";
    if (lower) {
      const corner = (i) => [0, 1, 2].map((k) => (i >> k & 1 ? upper[k] : lower[k]));
      for (let i = 0; i < 8; ++i) for (let k = 0; k < 3; ++k) if (!(i >> k & 1)) this.stroke([corner(i), corner(i | 1 << k)], colour, 1.5);
      this.label(upper, name, colour);
      return;
    }
    for (let axis = 0; axis < 3; ++axis) {
      const circle = Array.from({ length: 33 }, (_, i) => {
        const [u, v] = [radius * Math.cos(i * Math.PI / 16), radius * Math.sin(i * Math.PI / 16)];
        const away = [0, 0, 0];
        away[(axis + 1) % 3] = u;
        away[(axis + 2) % 3] = v;
        return plus(centre, away, 1);
      });
      this.stroke(circle, colour, 1.5);
    }
    this.label(plus(centre, [0, 0, radius], 1), name, colour);
  }

  pointsAndArrows() {
    this.at = [];
    for (const point of this.scene.points) {
      if (point.layer && this.layers[point.layer] === false) continue;
      const at = this.project(point.place);
      const chosen = point.c === SELECTED.c && SELECTED.c >= 0;
      this.at.push([at[0], at[1], point]);
      for (const arrow of point.arrows || []) if (this.layers[arrow.kind]) this.arrow(point.place, arrow, chosen);
      if (!this.layers.points) continue;
      const colour = this.colour(point.kind || (point.marked ? "mark" : "ink"));
      this.add(at[2] + 0.01, (g) => {
        g.fillStyle = colour;
        g.beginPath();
        g.arc(at[0], at[1], chosen ? 4 : point.size || 2.2, 0, 7);
        g.fill();
        if (chosen) {
          g.strokeStyle = colour;
          g.lineWidth = 1.5;
          g.beginPath();
          g.arc(at[0], at[1], 8, 0, 7);
          g.stroke();
        }
      });
    }
  }

  arrow(place, arrow, chosen) {
    const from = this.project(place);
    const to = this.project(plus(place, arrow.vector, this.exaggeration));
    const colour = this.colour(arrow.kind);
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    this.add(0.5 * (from[2] + to[2]), (g) => {
      g.strokeStyle = g.fillStyle = colour;
      g.lineWidth = chosen ? 3 : 1.7;
      g.setLineDash(DASHES[arrow.kind] || []);
      g.beginPath();
      g.moveTo(from[0], from[1]);
      g.lineTo(to[0], to[1]);
      g.stroke();
      g.setLineDash([]);
      if (length < 5) return;
      const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
      const size = Math.min(8, 0.5 * length);
      g.beginPath();
      g.moveTo(to[0], to[1]);
      for (const side of [-0.42, 0.42]) g.lineTo(to[0] - size * Math.cos(angle + side), to[1] - size * Math.sin(angle + side));
      g.fill();
    });
  }

  label(place, text, name) {
    const at = this.project(place);
    const colour = this.colour(name);
    this.add(at[2] + 10, (g) => {
      g.fillStyle = colour;
      g.font = "12px " + this.colour("font");
      g.fillText(cut(text, 24), at[0] + 8, at[1] - 6);
    });
  }

  trackerAndAxes() {
    const { pose, name: frame } = this.scene.axes || { pose: WORLD, name: "" };
    const size = (frame ? 0.4 : 0.13) * this.radius;
    [["x", [size, 0, 0]], ["y", [0, size, 0]], ["z", [0, 0, size]]].forEach(([name, end]) => {
      this.stroke([moved(pose, [0, 0, 0]), moved(pose, end)], "axis3d", 2);
      if (frame || !this.layers.robot || !this.scene.robot) this.label(moved(pose, end), (frame + " " + name).trim(), "quiet");
    });
    const tracker = this.scene.tracker;
    if (!tracker) return;
    const foot = [tracker[0], tracker[1], Math.min(0, tracker[2])];
    this.stroke([tracker, foot], "quiet", 1, 0, [2, 4]);
    const at = this.project(tracker);
    const colour = this.colour("ink");
    this.add(at[2], (g) => {
      g.fillStyle = colour;
      g.beginPath();
      g.moveTo(at[0], at[1] - 9);
      g.lineTo(at[0] + 8, at[1] + 6);
      g.lineTo(at[0] - 8, at[1] + 6);
      g.fill();
    });
    this.label(tracker, "tracker", "ink");
    const chosen = this.scene.points.find((p) => p.c === SELECTED.c && SELECTED.c >= 0);
    const beams = (this.scene.beams || [])[SELECTED.c] || (chosen ? [chosen.place] : []);
    for (const target of beams) this.stroke([tracker, target], "quiet", 1, 0, [6, 5]);
  }

  turn(dx, dy) {
    this.yaw -= dx;
    this.pitch = Math.max(-1.55, Math.min(1.55, this.pitch + dy));
    this.draw();
  }
  nearer(factor) {
    this.zoom = Math.max(0.2, Math.min(40, this.zoom * factor));
    this.draw();
  }
  shift(dx, dy) {
    this.pan = [this.pan[0] + dx, this.pan[1] + dy];
    this.draw();
  }

  listen() {
    const canvas = this.canvas;
    const held = new Map();
    let still = true;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
      still = true;
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return this.hint(event);
      const now = [event.clientX, event.clientY];
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      if (Math.hypot(dx, dy) > 2) still = false;
      if (held.size === 2) {
        const other = Array.from(held).find(([id]) => id !== event.pointerId)[1];
        const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
        this.nearer(apart(now) / (apart(before) || 1));
        this.shift(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons & 6) this.shift(dx, dy);
      else this.turn(dx * 0.008, dy * 0.008);
      held.set(event.pointerId, now);
    });
    const release = (event) => {
      held.delete(event.pointerId);
      if (still && event.type === "pointerup") {
        const point = this.pick(event);
        if (point && point.choose) point.choose();
      }
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("pointerleave", hideTip);
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas && !event.ctrlKey) return;
      event.preventDefault();
      this.nearer(Math.exp(-event.deltaY * 0.0012));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (step && event.shiftKey) this.shift(24 * step[0], 24 * step[1]);
    else if (step) this.turn(0.09 * step[0], 0.09 * step[1]);
    else if (event.key === "+" || event.key === "=") this.nearer(1.2);
    else if (event.key === "-") this.nearer(1 / 1.2);
    else if (event.key === "0" || event.key === "Home") {
      this.reset();
      this.draw();
    } else if ((event.key === "n" || event.key === "p") && this.scene.configurations.length) {
      const count = this.scene.configurations.length;
      select((SELECTED.c + (event.key === "n" ? 1 : -1) + count) % count);
    } else return;
    event.preventDefault();
  }

  pick(event) {
    const frame = this.canvas.getBoundingClientRect();
    let best = null;
    let least = 12;
    for (const [x, y, point] of this.at || []) {
      const distance = Math.hypot(x + frame.left - event.clientX, y + frame.top - event.clientY);
      if (distance < least) {
        least = distance;
        best = point;
      }
    }
    return best;
  }

  hint(event) {
    const point = this.pick(event);
    this.canvas.style.cursor = point && point.choose ? "pointer" : "";
    if (point && point.lines) showTip(event, point.lines());
    else hideTip();
  }
}
