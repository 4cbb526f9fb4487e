// The arm's kinematics. A frame is the first three rows of its matrix, row by row: twelve numbers.

const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
function times(a, b) {
  const c = new Array(12);
  for (let row = 0; row < 12; row += 4) {
    for (let column = 0; column < 4; ++column) {
      c[row + column] = a[row] * b[column] + a[row + 1] * b[4 + column] + a[row + 2] * b[8 + column] + (column === 3 ? a[row + 3] : 0);
    }
  }
  return c;
}
const moved = (a, p) => [0, 4, 8].map((r) => a[r] * p[0] + a[r + 1] * p[1] + a[r + 2] * p[2] + a[r + 3]);
const turned = (a, v) => [0, 4, 8].map((r) => a[r] * v[0] + a[r + 1] * v[1] + a[r + 2] * v[2]);
function inverse(a) {
  const t = [a[3], a[7], a[11]];
  const r = [a[0], a[4], a[8], 0, a[1], a[5], a[9], 0, a[2], a[6], a[10], 0];
  const back = turned(r, t);
  r[3] = -back[0];
  r[7] = -back[1];
  r[11] = -back[2];
  return r;
}
// A rotation by q about the unit axis (Rodrigues), or a translation by q along it.
function motion(axis, q, prismatic) {
  const [x, y, z] = axis;
  if (prismatic) return [1, 0, 0, q * x, 0, 1, 0, q * y, 0, 0, 1, q * z];
  const c = Math.cos(q), s = Math.sin(q), v = 1 - c;
  return [c + v * x * x, v * x * y - s * z, v * x * z + s * y, 0,
    v * x * y + s * z, c + v * y * y, v * y * z - s * x, 0,
    v * x * z - s * y, v * y * z + s * x, c + v * z * z, 0];
}
// Frames in the base frame: the base, each link, and the flange with the errors behind it last.
function framesAt(robot, q) {
  const frames = [IDENTITY];
  for (const segment of robot.segments) {
    let frame = times(frames[frames.length - 1], segment.origin);
    if (segment.joint !== undefined) {
      const joint = robot.joints[segment.joint];
      const tilts = q.slice(robot.joints.length + 2 * segment.joint, robot.joints.length + 2 * segment.joint + 2);
      tilts.forEach((tilt, k) => { frame = times(frame, motion(segment.across[k], tilt, false)); });
      frame = times(frame, motion(segment.axis, q[segment.joint], joint.type === "prismatic"));
    }
    frames.push(frame);
  }
  frames.push(times(frames[frames.length - 1], robot.tip_correction));
  return frames;
}
// Places are shown in the controller's world with a joint convention, else in the base frame.
const WORLD = (MEASURED && MEASURED.world) || IDENTITY;
const PLACES = MEASURED && MEASURED.world ? "the controller's world frame" : "the base frame";
const TO_WORLD = inverse(WORLD);
// What the arm is driven by: the commanded values, and what effects make of them.
const drivenBy = (configuration) => configuration.effective || configuration.joint_values;
// Where a target is expected, in the frame of the measuring device [m].
function predictedPoint(robot, configuration, target) {
  const frames = framesAt(robot, drivenBy(configuration));
  return moved(robot.base, moved(frames[frames.length - 1], robot.targets[target].position));
}

// Faces of the links' shapes, each in its link's frame.
function facesOf(shape) {
  const [x, y, z] = shape.size;
  const faces = [];
  if (shape.kind === "box") {
    const corner = (i) => [(i & 1 ? 0.5 : -0.5) * x, (i & 2 ? 0.5 : -0.5) * y, (i & 4 ? 0.5 : -0.5) * z];
    for (const side of [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]) faces.push(side.map(corner));
  } else if (shape.kind === "cylinder") {
    const n = 24;
    const rim = (i, h) => [x * Math.cos((2 * Math.PI * i) / n), x * Math.sin((2 * Math.PI * i) / n), h * z];
    for (let i = 0; i < n; ++i) faces.push([rim(i, -0.5), rim(i + 1, -0.5), rim(i + 1, 0.5), rim(i, 0.5)]);
    faces.push(Array.from({ length: n }, (_, i) => rim(i, 0.5)), Array.from({ length: n }, (_, i) => rim(n - i, -0.5)));
  } else {
    const n = 16, m = 8;
    const at = (i, j) => {
      const a = (2 * Math.PI * i) / n, b = Math.PI * (j / m - 0.5);
      return [x * Math.cos(b) * Math.cos(a), x * Math.cos(b) * Math.sin(a), x * Math.sin(b)];
    };
    for (let i = 0; i < n; ++i) for (let j = 0; j < m; ++j) faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
  }
  return faces.map((face) => face.map((p) => moved(shape.frame, p)));
}
