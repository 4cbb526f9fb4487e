// Included by chain_kernel.cpp inside a namespace, once per instruction set, with the doubles that one of its registers
// holds in KDL_CALIBRATION_AT_ONCE.

constexpr std::size_t kAtOnce = KDL_CALIBRATION_AT_ONCE;
constexpr std::size_t kParts = kLanes / kAtOnce;

using Vector = double __attribute__((vector_size(kAtOnce * sizeof(double)), may_alias));
using Integers = long long __attribute__((vector_size(kAtOnce * sizeof(double))));

// The same part of the lanes of every LaneRow.
struct Rows {
  Vector* first;
  Vector& operator[](std::size_t row) const { return first[row * kParts]; }
};

struct Sums {
  Rows gram;
  Rows gradient;
  Rows twist;
  Rows force;
  Rows cost;
};

// Sine and cosine after reduction to [-pi/4, pi/4] (Cody and Waite) by polynomials of degree 13 and 14, within 1 ulp.
// The lowest bits of x / (pi/2) + 1.5 * 2^52 hold the quadrant.
static inline void sine_and_cosine(const Vector& x, Vector& sine, Vector& cosine) {
  const Vector shifted = x * 0.63661977236758134308 + 6755399441055744.0;
  const Vector n = shifted - 6755399441055744.0;
  const Integers quadrant = (Integers)shifted & 3;
  const Vector r = ((x - n * 1.57079632673412561417) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21;
  const Vector z = r * r;
  const Vector s = r + r * z *
                           (-1.66666666666666324348e-01 +
                            z * (8.33333333332248946124e-03 +
                                 z * (-1.98412698298579493134e-04 +
                                      z * (2.75573137070700676789e-06 +
                                           z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))));
  const Vector c =
      1.0 - (0.5 * z - z * z *
                           (4.16666666666666019037e-02 +
                            z * (-1.38888888888741095749e-03 +
                                 z * (2.48015872894767294178e-05 +
                                      z * (-2.75573143513906633035e-07 +
                                           z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))))));
  const Integers odd = (quadrant & 1) != 0;
  const Integers sine_sign = (quadrant & 2) << 62;
  const Integers cosine_sign = ((quadrant + 1) & 2) << 62;
  sine = (Vector)((Integers)(odd ? c : s) ^ sine_sign);
  cosine = (Vector)((Integers)(odd ? s : c) ^ cosine_sign);
}

// out = frame * in, with `in` and `out` the rows of a pose.
static inline void behind(const FrameNumbers& frame, const Vector* in, Vector* out) {
  for (std::size_t r = 0; r < 3; ++r) {
    const double a = frame[3 * r];
    const double b = frame[3 * r + 1];
    const double c = frame[3 * r + 2];
    out[3 * r] = a * in[0] + b * in[3] + c * in[6];
    out[3 * r + 1] = a * in[1] + b * in[4] + c * in[7];
    out[3 * r + 2] = a * in[2] + b * in[5] + c * in[8];
    out[9 + r] = a * in[9] + b * in[10] + c * in[11] + frame[9 + r];
  }
}

// R^T v for a vector of lanes and the rotation at the head of a pose.
static inline void turned_back(const Vector* R, const Vector* v, Vector* out) {
  for (int c = 0; c < 3; ++c) {
    out[c] = R[c] * v[0] + R[3 + c] * v[1] + R[6 + c] * v[2];
  }
}

static inline void constant_pose(const FrameNumbers& frame, Vector* pose) {
  for (std::size_t i = 0; i < 12; ++i) {
    pose[i] = frame[i] - Vector{};
  }
}

// Turns a pose about z by q.
static inline void turn_about_z(const Vector& q, Vector* pose) {
  Vector s;
  Vector c;
  sine_and_cosine(q, s, c);
  const auto turn = [&](Vector & first, Vector & second) __attribute__((always_inline)) {
    const Vector x = first;
    first = c * x - s * second;
    second = s * x + c * second;
  };
  turn(pose[0], pose[3]);
  turn(pose[1], pose[4]);
  turn(pose[2], pose[5]);
  turn(pose[9], pose[10]);
}

// The poses of P in the flange, in every joint frame and in the base: poses[15 f] for frame f.
static inline void chain_poses(const ChainKernelInput& input, const Rows& joints, Vector* poses) {
  const std::size_t count = input.prismatic.size();
  constant_pose(input.flange, poses + 15 * (count + 1));
  turned_back(poses + 15 * (count + 1), poses + 15 * (count + 1) + 9, poses + 15 * (count + 1) + 12);
  for (std::size_t i = count + 1; i-- > 0;) {
    Vector* pose = poses + 15 * i;
    if (i == count) {
      constant_pose(input.links[i], pose);
    } else {
      behind(input.links[i], poses + 15 * (i + 1), pose);
    }
    if (i > 0 && input.prismatic[i - 1] != 0) {
      pose[11] += joints[i - 1];
    } else if (i > 0) {
      turn_about_z(joints[i - 1], pose);
    }
    turned_back(pose, pose + 9, pose + 12);
  }
}

// Residuals of one block; force F and moment M into `wrench`.
static inline void residuals(const ChainKernelInput& input, const Vector& mask, const Rows& measured,
                             const Vector* pose_in_base, bool cost_only, const Sums& sums, Vector* wrench) {
  Vector pose[12];
  behind(input.base, pose_in_base, pose);
  Vector cost = sums.cost[0];
  for (int i = 0; i < 6; ++i) {
    wrench[i] = Vector{};
  }
  for (std::size_t k = 0; k < input.points.size(); ++k) {
    const double* t = input.points[k].data();
    const Vector d[3] = {measured[3 * k] - pose[9], measured[3 * k + 1] - pose[10], measured[3 * k + 2] - pose[11]};
    Vector f[3];
    for (int c = 0; c < 3; ++c) {
      const Vector e = ((pose[c] * d[0] + pose[3 + c] * d[1] + pose[6 + c] * d[2]) - t[c]) * mask;
      f[c] = input.weights[k] * e;
      cost += f[c] * e;
    }
    if (cost_only) {
      continue;
    }
    for (std::size_t c = 0; c < 3; ++c) {
      sums.force[3 * k + c] += f[c];
      wrench[c] += f[c];
    }
    wrench[3] += t[1] * f[2] - t[2] * f[1];
    wrench[4] += t[2] * f[0] - t[0] * f[2];
    wrench[5] += t[0] * f[1] - t[1] * f[0];
  }
  sums.cost[0] = cost;
}

// The columns [v; L^T a] of one block, six rows each, and what they add to gradient and twist.
static inline void columns_of(const ChainKernelInput& input, const Vector& mask, const Vector* poses,
                              const Vector* wrench, const Sums& sums, Vector* jacobian) {
  const double* L = input.root.data();
  for (std::size_t i = 0; i < input.columns.size(); ++i) {
    const ChainColumn& column = input.columns[i];
    const Vector* R = poses + 15 * static_cast<std::size_t>(column.frame);
    Vector* out = jacobian + 6 * i;
    Vector v[3] = {};
    Vector gradient = sums.gradient[i];
    if (column.moves) {
      const double* l = column.linear.data();
      for (int c = 0; c < 3; ++c) {
        v[c] = R[c] * l[0] + R[3 + c] * l[1] + R[6 + c] * l[2];
      }
    }
    if (column.turns) {
      const double* w = column.angular.data();
      Vector a[3];
      for (std::size_t c = 0; c < 3; ++c) {
        a[c] = (R[c] * w[0] + R[3 + c] * w[1] + R[6 + c] * w[2]) * mask;
        sums.twist[6 * i + 3 + c] += a[c];
        gradient += a[c] * wrench[3 + c];
      }
      const Vector* p = R + 12;
      v[0] += a[1] * p[2] - a[2] * p[1];
      v[1] += a[2] * p[0] - a[0] * p[2];
      v[2] += a[0] * p[1] - a[1] * p[0];
      out[3] = L[0] * a[0] + L[1] * a[1] + L[3] * a[2];
      out[4] = L[2] * a[1] + L[4] * a[2];
      out[5] = L[5] * a[2];
    }
    for (std::size_t c = 0; c < 3; ++c) {
      v[c] *= mask;
      out[c] = v[c];
      sums.twist[6 * i + c] += v[c];
      gradient += v[c] * wrench[c];
    }
    sums.gradient[i] = gradient;
  }
}

static inline void add_gram(std::size_t columns, std::size_t turning, const Vector* J, const Rows& gram) {
  std::size_t row = 0;
  for (std::size_t i = 0; i < columns; ++i) {
    const Vector* const a = J + 6 * i;
    const Vector a0 = a[0];
    const Vector a1 = a[1];
    const Vector a2 = a[2];
    std::size_t j = i;
    if (i < turning) {
      const Vector a3 = a[3];
      const Vector a4 = a[4];
      const Vector a5 = a[5];
      for (; j < turning; ++j) {
        const Vector* const b = J + 6 * j;
        gram[row++] += ((a0 * b[0] + a1 * b[1]) + (a2 * b[2] + a3 * b[3])) + (a4 * b[4] + a5 * b[5]);
      }
    }
    for (; j < columns; ++j) {
      const Vector* const b = J + 6 * j;
      gram[row++] += (a0 * b[0] + a1 * b[1]) + a2 * b[2];
    }
  }
}

static Rows part_of(std::vector<LaneRow>& rows, std::size_t part) {
  return {reinterpret_cast<Vector*>(rows.data()) + part};
}

static void sum(const ChainKernelInput& input, bool cost_only, ChainKernelSums& all) {
  const std::size_t joints = input.prismatic.size();
  const std::size_t rows = joints + 3 * input.points.size();
  auto* const poses = reinterpret_cast<Vector*>(all.poses.data());
  auto* const jacobian = reinterpret_cast<Vector*>(all.jacobian.data());
  for (std::size_t first = 0; first < input.configurations; first += kLanes) {
    const LaneRow* const block = input.data + first / kLanes * rows;
    for (std::size_t row = 0; row < rows; ++row) {  // needed in two rounds
      __builtin_prefetch(block + 2 * rows + row);
    }
    for (std::size_t part = 0; part < kParts; ++part) {
      const Sums sums{.gram = part_of(all.gram, part),
                      .gradient = part_of(all.gradient, part),
                      .twist = part_of(all.twist, part),
                      .force = part_of(all.force, part),
                      .cost = {reinterpret_cast<Vector*>(&all.cost) + part}};
      Vector mask;
      for (std::size_t lane = 0; lane < kAtOnce; ++lane) {
        mask[lane] = first + part * kAtOnce + lane < input.configurations ? 1.0 : 0.0;
      }
      const Rows data{const_cast<Vector*>(reinterpret_cast<const Vector*>(block)) + part};
      Vector wrench[6];
      chain_poses(input, data, poses);
      residuals(input, mask, {&data[joints]}, poses, cost_only, sums, wrench);
      if (!cost_only) {
        columns_of(input, mask, poses, wrench, sums, jacobian);
        add_gram(input.columns.size(), input.turning, jacobian, sums.gram);
      }
    }
  }
}
