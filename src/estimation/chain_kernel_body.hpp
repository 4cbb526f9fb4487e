// Included by chain_kernel.cpp inside a namespace, once per instruction set, with the doubles that one of its registers
// holds in KDL_CALIBRATION_AT_ONCE.

constexpr std::size_t kAtOnce = KDL_CALIBRATION_AT_ONCE;
constexpr std::size_t kParts = kLanes / kAtOnce;

using Vector = double __attribute__((vector_size(kAtOnce * sizeof(double)), may_alias));
using Integers = long long __attribute__((vector_size(kAtOnce * sizeof(double))));

// The same part of the lanes of every row of data.
struct Rows {
  const Vector* first;
  const Vector& operator[](std::size_t row) const { return first[row * kParts]; }
};

// What one part of the lanes adds up.
struct Sums {
  Vector* gram;
  Vector* gradient;
  Vector* twist;
  Vector* force;
  Vector* cost;
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

// R^T v for the rotation at the head of a pose; v holds lanes or numbers.
template <class Coordinates>
static inline void turned_back(const Vector* R, const Coordinates& v, Vector* out) {
  for (std::size_t c = 0; c < 3; ++c) {
    out[c] = R[c] * v[0] + R[3 + c] * v[1] + R[6 + c] * v[2];
  }
}

// Where `mask` is 0 a lane has no rotation, and with that no columns.
static inline void constant_pose(const FrameNumbers& frame, const Vector& mask, Vector* pose) {
  for (std::size_t i = 0; i < 12; ++i) {
    pose[i] = i < 9 ? frame[i] * mask : frame[i] - Vector{};
  }
}

// Turns a pose about z.
static inline void turn_about_z(const Vector& sine, const Vector& cosine, Vector* pose) {
  const Vector s = sine;
  const Vector c = cosine;
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
static inline void chain_poses(const ChainKernelInput& input, const Vector& mask, const Rows& joints, Vector* turns,
                               Vector* poses) {
  const std::size_t count = input.prismatic.size();
  for (std::size_t i = 0; i < count; ++i) {  // independent of each other, unlike the poses
    if (input.prismatic[i] == 0) {
      sine_and_cosine(joints[i], turns[2 * i], turns[2 * i + 1]);
    }
  }
  constant_pose(input.flange, mask, poses + 15 * (count + 1));
  turned_back(poses + 15 * (count + 1), poses + 15 * (count + 1) + 9, poses + 15 * (count + 1) + 12);
  for (std::size_t i = count + 1; i-- > 0;) {
    Vector* pose = poses + 15 * i;
    if (i == count) {
      constant_pose(input.links[i], mask, pose);
    } else {
      behind(input.links[i], poses + 15 * (i + 1), pose);
    }
    if (i > 0 && input.prismatic[i - 1] != 0) {
      pose[11] += joints[i - 1];
    } else if (i > 0) {
      turn_about_z(turns[2 * i - 2], turns[2 * i - 1], pose);
    }
    turned_back(pose, pose + 9, pose + 12);
  }
}

struct MeasuredBlock {
  Vector mask;  // which lanes hold a configuration
  Rows points;
  const Vector* pose_in_base;
};

// Residuals of one block; force F and moment M into `wrench`.
static inline void residuals(const ChainKernelInput& input, const MeasuredBlock& block, bool cost_only,
                             const Sums& sums, Vector* wrench) {
  const Rows& measured = block.points;
  Vector pose[12];
  behind(input.base, block.pose_in_base, pose);
  Vector cost = sums.cost[0];
  for (int i = 0; i < 6; ++i) {
    wrench[i] = Vector{};
  }
  for (std::size_t k = 0; k < input.points.size(); ++k) {
    const double* t = input.points[k].data();
    const Vector d[3] = {measured[3 * k] - pose[9], measured[3 * k + 1] - pose[10], measured[3 * k + 2] - pose[11]};
    Vector f[3];
    for (int c = 0; c < 3; ++c) {
      const Vector e = ((pose[c] * d[0] + pose[3 + c] * d[1] + pose[6 + c] * d[2]) - t[c]) * block.mask;
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
static inline void columns_of(const ChainKernelInput& input, const Vector* poses, const Vector* wrench,
                              const Sums& sums, Vector* jacobian) {
  const double* L = input.root.data();
  for (std::size_t i = 0; i < input.columns.size(); ++i) {
    const ChainColumn& column = input.columns[i];
    const Vector* R = poses + 15 * static_cast<std::size_t>(column.frame);
    Vector* out = jacobian + 6 * i;
    Vector v[3] = {};
    Vector gradient = sums.gradient[i];
    if (column.moves) {
      turned_back(R, column.linear, v);
    }
    if (column.turns) {
      Vector a[3];
      turned_back(R, column.angular, a);
      for (std::size_t c = 0; c < 3; ++c) {
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
      out[c] = v[c];
      sums.twist[6 * i + c] += v[c];
      gradient += v[c] * wrench[c];
    }
    sums.gradient[i] = gradient;
  }
}

// The columns first, … last - 1.
struct ColumnRange {
  std::size_t first;
  std::size_t last;
};

// Products of these columns with column `own` of one block's Jacobian, or of two blocks' that lie behind each other:
// two blocks at a time, for the sums are more than fits into the cache next to the registers.
template <std::size_t kBlocks, std::size_t kRows>
static inline Vector* add_products(const Vector* J, std::size_t columns, std::size_t own, ColumnRange others,
                                   Vector* gram) {
  Vector a[kBlocks][kRows];
  for (std::size_t b = 0; b < kBlocks; ++b) {
    for (std::size_t row = 0; row < kRows; ++row) {
      a[b][row] = J[6 * (b * columns + own) + row];
    }
  }
  for (std::size_t column = others.first; column < others.last; ++column) {
    Vector sum = *gram;
    for (std::size_t b = 0; b < kBlocks; ++b) {
      const Vector* const c = J + 6 * (b * columns + column);
      Vector product = (a[b][0] * c[0] + a[b][1] * c[1]) + a[b][2] * c[2];
      if constexpr (kRows == 6) {
        product += (a[b][3] * c[3] + a[b][4] * c[4]) + a[b][5] * c[5];
      }
      sum += product;
    }
    *gram++ = sum;
  }
  return gram;
}

template <std::size_t kBlocks>
static inline void add_gram(const ChainKernelInput& input, const Vector* J, Vector* gram) {
  const std::size_t columns = input.columns.size();
  const std::size_t turning = input.turning;
  for (std::size_t i = 0; i < turning; ++i) {
    gram = add_products<kBlocks, 6>(J, columns, i, {i, turning}, gram);
    gram = add_products<kBlocks, 3>(J, columns, i, {turning, columns}, gram);
  }
  for (std::size_t i = turning; i < columns; ++i) {
    gram = add_products<kBlocks, 3>(J, columns, i, {i, columns}, gram);
  }
}

// Which lanes of a part hold a configuration: 1 or 0.
static inline Vector mask_of(std::size_t first, std::size_t configurations) {
  Vector mask;
  for (std::size_t lane = 0; lane < kAtOnce; ++lane) {
    mask[lane] = first + lane < configurations ? 1.0 : 0.0;
  }
  return mask;
}

static void sum(const ChainKernelInput& input, bool cost_only, ChainKernelSums& all) {
  const std::size_t joints = input.prismatic.size();
  const std::size_t columns = input.columns.size();
  const std::size_t rows = joints + 3 * input.points.size();
  const std::size_t blocks = (input.configurations + kLanes - 1) / kLanes;
  auto* const poses = reinterpret_cast<Vector*>(all.poses.data());
  auto* const turns = reinterpret_cast<Vector*>(all.turns.data());
  auto* const jacobian = reinterpret_cast<Vector*>(all.jacobian.data());
  // One part after the other through a few blocks: the sums of all parts are more than the nearest cache holds.
  for (std::size_t begin = 0; begin < blocks; begin += kBlocksInCache) {
    const std::size_t end = std::min(begin + kBlocksInCache, blocks);
    for (std::size_t part = 0; part < kParts; ++part) {
      Vector* const cost = reinterpret_cast<Vector*>(all.lanes.data()) + part * all.lanes.size();
      Vector* const gradient = cost + 1;
      Vector* const twist = gradient + columns;
      Vector* const force = twist + 6 * columns;
      const Sums sums{
          .gram = force + 3 * input.points.size(), .gradient = gradient, .twist = twist, .force = force, .cost = cost};
      for (std::size_t block = begin; block < end; block += 2) {
        const std::size_t together = std::min<std::size_t>(2, end - block);
        for (std::size_t k = 0; k < together; ++k) {
          const LaneRow* const first = input.data + (block + k) * rows;
          const Rows data{reinterpret_cast<const Vector*>(first) + part};
          const Vector mask = mask_of((block + k) * kLanes + part * kAtOnce, input.configurations);
          Vector wrench[6];
          chain_poses(input, mask, data, turns, poses);
          residuals(input, {mask, {&data[joints]}, poses}, cost_only, sums, wrench);
          if (!cost_only) {
            columns_of(input, poses, wrench, sums, jacobian + 6 * columns * k);
          }
        }
        if (!cost_only) {
          together == 2 ? add_gram<2>(input, jacobian, sums.gram) : add_gram<1>(input, jacobian, sums.gram);
        }
      }
    }
  }
  add_lanes(all.lanes, kAtOnce, all);
}
