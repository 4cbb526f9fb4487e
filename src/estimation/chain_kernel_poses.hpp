// Part of chain_kernel_body.hpp: poses of the chain.

constexpr std::size_t kAtOnce = KDL_CALIBRATION_AT_ONCE;
constexpr std::size_t kParts = kLanes / kAtOnce;

using Vector = double __attribute__((vector_size(kAtOnce * sizeof(double)), may_alias));
using Integers = long long __attribute__((vector_size(kAtOnce * sizeof(double))));

// One register's part of the lanes of all rows of data.
struct Rows {
  const Vector* first;
  const Vector& operator[](std::size_t row) const { return first[row * kParts]; }
  Rows from(std::size_t row) const { return {first + row * kParts}; }
};

// Sums of one part of the lanes.
struct Sums {
  Vector* gram;
  Vector* spread;
  Vector* gradient;
  Vector* coupling;
  Vector* force;
  Vector* turned;
  Vector* weights;
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

// R^T v for the rotation of a pose; v holds lanes or numbers.
template <class Coordinates>
static inline void turned_back(const Vector* R, const Coordinates& v, Vector* out) {
  for (std::size_t c = 0; c < 3; ++c) {
    out[c] = R[c] * v[0] + R[3 + c] * v[1] + R[6 + c] * v[2];
  }
}

// Lanes with `mask` 0 get a zero rotation, so that their columns vanish.
static inline void constant_pose(const FrameNumbers& frame, const Vector& mask, Vector* pose) {
  for (std::size_t i = 0; i < 12; ++i) {
    pose[i] = i < 9 ? frame[i] * mask : frame[i] - Vector{};
  }
}

// Rotates a pose in the plane of rows `from` and `to`.
static inline __attribute__((always_inline)) void turn(const Vector* sine_and_cosine, std::size_t from, std::size_t to,
                                                       Vector* pose) {
  const Vector s = sine_and_cosine[0];
  const Vector c = sine_and_cosine[1];
  const auto mix = [&](Vector & first, Vector & second) __attribute__((always_inline)) {
    const Vector x = first;
    first = c * x - s * second;
    second = s * x + c * second;
  };
  mix(pose[3 * from], pose[3 * to]);
  mix(pose[3 * from + 1], pose[3 * to + 1]);
  mix(pose[3 * from + 2], pose[3 * to + 2]);
  mix(pose[9 + from], pose[9 + to]);
}

// Joint values, then tilts: the commanded values plus the terms.
static inline void moved_joints(const ChainKernelInput& input, const Rows& commanded, const Rows& terms, Vector* q) {
  const std::size_t joints = input.prismatic.size();
  for (std::size_t i = 0; i < joints; ++i) {
    q[i] = commanded[i];
  }
  for (std::size_t i = joints; i < input.entries(); ++i) {
    q[i] = Vector{};
  }
  for (const ChainMotion& motion : input.motions) {
    Vector sum = q[motion.entry];
    for (std::size_t k = motion.first; k < motion.last; ++k) {
      sum += input.values[k] * terms[k];
    }
    q[motion.entry] = sum;
  }
}

// The poses of P in the flange, in every joint frame and in the base: poses[15 f] for frame f.
static inline __attribute__((always_inline)) void chain_poses(const ChainKernelInput& input, const Vector& mask,
                                                              const Vector* q, Vector* turns, Vector* poses) {
  const std::size_t count = input.prismatic.size();
  const std::size_t angles = (input.tilts ? 3 : 1) * count;
  for (std::size_t i = 0; i < angles; ++i) {  // all joints first: unlike the poses they are independent
    if (i >= count || input.prismatic[i] == 0) {
      sine_and_cosine(q[i], turns[2 * i], turns[2 * i + 1]);
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
      for (std::size_t k = 0; k < 3 && !input.stretches.empty(); ++k) {
        pose[9 + k] += q[3 * count + i] * input.stretches[i][k];
      }
    }
    if (i > 0 && input.prismatic[i - 1] != 0) {
      pose[11] += q[i - 1];
    } else if (i > 0) {
      turn(turns + 2 * (i - 1), 0, 1, pose);
    }
    if (i > 0 && input.tilts) {
      Vector* const tilted = poses + 15 * (count + 1 + i);
      for (std::size_t k = 0; k < 12; ++k) {
        tilted[k] = pose[k];
      }
      turned_back(tilted, tilted + 9, tilted + 12);
      const Vector* const about_x = turns + 2 * (count + 2 * (i - 1));
      turn(about_x + 2, 2, 0, pose);
      turn(about_x, 1, 2, pose);
    }
    turned_back(pose, pose + 9, pose + 12);
  }
}

// Which lanes of a part hold a configuration: 1 or 0.
static inline Vector mask_of(std::size_t first, std::size_t configurations) {
  Vector mask{};
  for (std::size_t lane = 0; lane < kAtOnce; ++lane) {
    mask[lane] = first + lane < configurations ? 1.0 : 0.0;
  }
  return mask;
}
