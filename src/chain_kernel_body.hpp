// Included by chain_kernel.cpp inside a namespace, once per instruction set.

// Sine and cosine after reduction to [-pi/4, pi/4] (Cody and Waite) by polynomials of degree 13 and 14, within 1 ulp.
// The lowest bits of x / (pi/2) + 1.5 * 2^52 hold the quadrant.
static inline void sine_and_cosine(const Lanes& x, Lanes& sine, Lanes& cosine) {
  const Lanes shifted = x * 0.63661977236758134308 + 6755399441055744.0;
  const Lanes n = shifted - 6755399441055744.0;
  const IntegerLanes quadrant = (IntegerLanes)shifted & 3;
  const Lanes r = ((x - n * 1.57079632673412561417) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21;
  const Lanes z = r * r;
  const Lanes s = r + r * z *
                          (-1.66666666666666324348e-01 +
                           z * (8.33333333332248946124e-03 +
                                z * (-1.98412698298579493134e-04 +
                                     z * (2.75573137070700676789e-06 +
                                          z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))));
  const Lanes c =
      1.0 - (0.5 * z - z * z *
                           (4.16666666666666019037e-02 +
                            z * (-1.38888888888741095749e-03 +
                                 z * (2.48015872894767294178e-05 +
                                      z * (-2.75573143513906633035e-07 +
                                           z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))))));
  const IntegerLanes odd = (quadrant & 1) != 0;
  const IntegerLanes sine_sign = (quadrant & 2) << 62;
  const IntegerLanes cosine_sign = ((quadrant + 1) & 2) << 62;
  sine = (Lanes)((IntegerLanes)(odd ? c : s) ^ sine_sign);
  cosine = (Lanes)((IntegerLanes)(odd ? s : c) ^ cosine_sign);
}

// out = frame * in, with `in` and `out` the rows of a pose.
static inline void behind(const FrameNumbers& frame, const Lanes* in, Lanes* out) {
  for (int r = 0; r < 3; ++r) {
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
static inline void turned_back(const Lanes* R, const Lanes* v, Lanes* out) {
  for (int c = 0; c < 3; ++c) {
    out[c] = R[c] * v[0] + R[3 + c] * v[1] + R[6 + c] * v[2];
  }
}

static inline void constant_pose(const FrameNumbers& frame, Lanes* pose) {
  for (std::size_t i = 0; i < 12; ++i) {
    pose[i] = frame[i] - Lanes{};
  }
}

// Turns a pose about z by q.
static inline void turn_about_z(const Lanes& q, Lanes* pose) {
  Lanes s;
  Lanes c;
  sine_and_cosine(q, s, c);
  const auto turn = [&](Lanes & first, Lanes & second) __attribute__((always_inline)) {
    const Lanes x = first;
    first = c * x - s * second;
    second = s * x + c * second;
  };
  turn(pose[0], pose[3]);
  turn(pose[1], pose[4]);
  turn(pose[2], pose[5]);
  turn(pose[9], pose[10]);
}

// The poses of P in the flange, in every joint frame and in the base: poses[15 f] for frame f.
static inline void chain_poses(const ChainKernelInput& input, const Lanes* joints, Lanes* poses) {
  const std::size_t count = input.prismatic.size();
  constant_pose(input.flange, poses + 15 * (count + 1));
  turned_back(poses + 15 * (count + 1), poses + 15 * (count + 1) + 9, poses + 15 * (count + 1) + 12);
  for (std::size_t i = count + 1; i-- > 0;) {
    Lanes* pose = poses + 15 * i;
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
static inline void residuals(const ChainKernelInput& input, const Lanes& mask, const Lanes* measured,
                             const Lanes* pose_in_base, bool cost_only, ChainKernelSums& sums, Lanes* wrench) {
  Lanes pose[12];
  behind(input.base, pose_in_base, pose);
  Lanes cost = sums.cost.lanes;
  for (int i = 0; i < 6; ++i) {
    wrench[i] = Lanes{};
  }
  for (std::size_t k = 0; k < input.points.size(); ++k) {
    const double* t = input.points[k].data();
    const Lanes d[3] = {measured[3 * k] - pose[9], measured[3 * k + 1] - pose[10], measured[3 * k + 2] - pose[11]};
    Lanes f[3];
    for (int c = 0; c < 3; ++c) {
      const Lanes e = ((pose[c] * d[0] + pose[3 + c] * d[1] + pose[6 + c] * d[2]) - t[c]) * mask;
      f[c] = input.weights[k] * e;
      cost += f[c] * e;
    }
    if (cost_only) {
      continue;
    }
    for (std::size_t c = 0; c < 3; ++c) {
      sums.force[3 * k + c].lanes += f[c];
      wrench[c] += f[c];
    }
    wrench[3] += t[1] * f[2] - t[2] * f[1];
    wrench[4] += t[2] * f[0] - t[0] * f[2];
    wrench[5] += t[0] * f[1] - t[1] * f[0];
  }
  sums.cost.lanes = cost;
}

// The columns [v; L^T a] of one block, six rows each, and what they add to gradient and twist.
static inline void columns_of(const ChainKernelInput& input, const Lanes& mask, const Lanes* poses, const Lanes* wrench,
                              ChainKernelSums& sums, Lanes* jacobian) {
  const double* L = input.root.data();
  for (std::size_t i = 0; i < input.columns.size(); ++i) {
    const ChainColumn& column = input.columns[i];
    const Lanes* R = poses + 15 * column.frame;
    Lanes* out = jacobian + 6 * i;
    LaneRow* twist = sums.twist.data() + 6 * i;
    Lanes v[3] = {};
    Lanes gradient = sums.gradient[i].lanes;
    if (column.moves) {
      const double* l = column.linear.data();
      for (int c = 0; c < 3; ++c) {
        v[c] = R[c] * l[0] + R[3 + c] * l[1] + R[6 + c] * l[2];
      }
    }
    if (column.turns) {
      const double* w = column.angular.data();
      Lanes a[3];
      for (int c = 0; c < 3; ++c) {
        a[c] = (R[c] * w[0] + R[3 + c] * w[1] + R[6 + c] * w[2]) * mask;
        twist[3 + c].lanes += a[c];
        gradient += a[c] * wrench[3 + c];
      }
      const Lanes* p = R + 12;
      v[0] += a[1] * p[2] - a[2] * p[1];
      v[1] += a[2] * p[0] - a[0] * p[2];
      v[2] += a[0] * p[1] - a[1] * p[0];
      out[3] = L[0] * a[0] + L[1] * a[1] + L[3] * a[2];
      out[4] = L[2] * a[1] + L[4] * a[2];
      out[5] = L[5] * a[2];
    }
    for (int c = 0; c < 3; ++c) {
      v[c] *= mask;
      out[c] = v[c];
      twist[c].lanes += v[c];
      gradient += v[c] * wrench[c];
    }
    sums.gradient[i].lanes = gradient;
  }
}

static inline void add_gram(std::size_t columns, std::size_t turning, const Lanes* J, LaneRow* gram) {
  for (std::size_t i = 0; i < columns; ++i) {
    const Lanes* const a = J + 6 * i;
    const Lanes a0 = a[0];
    const Lanes a1 = a[1];
    const Lanes a2 = a[2];
    std::size_t j = i;
    if (i < turning) {
      const Lanes a3 = a[3];
      const Lanes a4 = a[4];
      const Lanes a5 = a[5];
      for (; j < turning; ++j) {
        const Lanes* const b = J + 6 * j;
        (gram++)->lanes += ((a0 * b[0] + a1 * b[1]) + (a2 * b[2] + a3 * b[3])) + (a4 * b[4] + a5 * b[5]);
      }
    }
    for (; j < columns; ++j) {
      const Lanes* const b = J + 6 * j;
      (gram++)->lanes += (a0 * b[0] + a1 * b[1]) + a2 * b[2];
    }
  }
}

static void sum(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums) {
  const std::size_t joints = input.prismatic.size();
  const std::size_t rows = joints + 3 * input.points.size();
  Lanes* const poses = &sums.poses[0].lanes;
  Lanes* const jacobian = &sums.jacobian[0].lanes;
  for (std::size_t first = 0; first < input.configurations; first += kLanes) {
    Lanes mask;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      mask[lane] = first + lane < input.configurations ? 1.0 : 0.0;
    }
    const Lanes* const block = &input.data[first / kLanes * rows].lanes;
    for (std::size_t row = 0; row < rows; ++row) {  // needed in two rounds
      __builtin_prefetch(block + 2 * rows + row);
    }
    Lanes wrench[6];
    chain_poses(input, block, poses);
    residuals(input, mask, block + joints, poses, cost_only, sums, wrench);
    if (!cost_only) {
      columns_of(input, mask, poses, wrench, sums, jacobian);
      add_gram(input.columns.size(), input.turning, jacobian, &sums.gram[0]);
    }
  }
}
