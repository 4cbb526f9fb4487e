// Part of chain_kernel_body.hpp: what measured points say of the frame P.

struct MeasuredBlock {
  Vector mask;  // which lanes hold a configuration
  Rows points;
  const Vector* pose_in_base;
};

// Residuals of one block; force F and moment M into `wrench`.
static inline __attribute__((always_inline)) void residuals_of_points(const ChainKernelInput& input,
                                                                      const MeasuredBlock& block, bool cost_only,
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

// What points with noise that is alike in every direction make of a column's twist.
struct PointsAlike {
  const double* L;

  std::size_t width() const { return 6; }
  // The rows [v; L^T a] from the twist (v, a), where it does not turn from v alone.
  template <bool kTurns>
  void rows_of(const Vector* twist, Vector* out) const {
    for (std::size_t c = 0; c < 3; ++c) {
      out[c] = twist[c];
    }
    if constexpr (kTurns) {
      const Vector* const a = twist + 3;
      out[3] = L[0] * a[0] + L[1] * a[1] + L[3] * a[2];
      out[4] = L[2] * a[1] + L[4] * a[2];
      out[5] = L[5] * a[2];
    }
  }
  // Adds what the targets need of it.
  template <bool kTurns>
  void add_coupling(const Vector* twist, Vector* sums) const {
    for (std::size_t c = 0; c < (kTurns ? 6 : 3); ++c) {
      sums[c] += twist[c];
    }
  }
};

static inline void cross(const std::array<double, 3>& a, const Vector* b, Vector* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

// The upper triangle of a symmetric matrix of six rows, row by row.
constexpr std::size_t place_in_triangle(std::size_t row, std::size_t column) { return row * (11 - row) / 2 + column; }

// The same for noise of its own along each axis of W: P gets the information of all rows together.
struct PointsByAxis {
  std::size_t targets;
  Vector* pulls;           // 18 per target: of each coordinate, what a force along it is as a wrench on P
  Vector wrench[6];        // of the residuals on P
  Vector information[21];  // of a twist of P, upper triangle
  Vector root[21];         // M with information = M^T M, upper triangle but for zeros in front of it

  std::size_t width() const { return 3 * targets; }
  template <bool kTurns>
  void rows_of(const Vector* twist, Vector* out) const {
    constexpr std::size_t kCount = kTurns ? 6 : 3;
    for (std::size_t row = 0; row < kCount; ++row) {
      Vector sum = root[place_in_triangle(row, row)] * twist[row];
      for (std::size_t c = row + 1; c < kCount; ++c) {
        sum += root[place_in_triangle(row, c)] * twist[c];
      }
      out[row] = sum;
    }
  }
  template <bool kTurns>
  void add_coupling(const Vector* twist, Vector* sums) const {
    for (std::size_t k = 0; k < 3 * targets; ++k) {
      const Vector* const pull = pulls + 6 * k;
      Vector sum = sums[k];
      for (std::size_t c = 0; c < (kTurns ? 6 : 3); ++c) {
        sum += twist[c] * pull[c];
      }
      sums[k] = sum;
    }
  }

  // Cholesky: M is upper triangular. Directions of which nothing is known, as those of a lane without a configuration,
  // have rows of zeros.
  void take_root() {
    constexpr double kNothing = 1e-14;
    for (std::size_t row = 0; row < 6; ++row) {
      const Vector own = information[place_in_triangle(row, row)];
      Vector pivot = own;
      for (std::size_t above = 0; above < row; ++above) {
        pivot -= root[place_in_triangle(above, row)] * root[place_in_triangle(above, row)];
      }
      Vector inverse{};
      for (std::size_t lane = 0; lane < kAtOnce; ++lane) {
        inverse[lane] = pivot[lane] > kNothing * own[lane] ? 1.0 / std::sqrt(pivot[lane]) : 0.0;
      }
      for (std::size_t column = row; column < 6; ++column) {
        Vector sum = information[place_in_triangle(row, column)];
        for (std::size_t above = 0; above < row; ++above) {
          sum -= root[place_in_triangle(above, row)] * root[place_in_triangle(above, column)];
        }
        root[place_in_triangle(row, column)] = sum * inverse;
      }
    }
  }
};

// What a target's coordinates pull at, and how the rows turn.
static inline void pulls_of(const ChainKernelInput& input, const Vector* R, const Sums& sums, PointsByAxis& points) {
  for (std::size_t k = 0; k < 18 * points.targets; ++k) {
    points.pulls[k] = Vector{};
  }
  for (std::size_t x = 0; x < 3; ++x) {
    const Vector* const r = R + 3 * x;
    for (std::size_t l = 0; l < points.targets; ++l) {
      const AxisRow& pull = input.pulls[3 * l + x];
      Vector wrench[6] = {pull.sum * r[0], pull.sum * r[1], pull.sum * r[2]};
      cross(pull.target, r, wrench + 3);
      for (std::size_t c = 0; c < 3; ++c) {
        for (std::size_t i = 0; i < 6; ++i) {
          points.pulls[6 * (3 * l + c) + i] += r[c] * wrench[i];
        }
      }
    }
    Vector* turned = sums.turned + 6 * x;
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t d = c; d < 3; ++d) {
        *turned++ += r[c] * r[d];
      }
    }
  }
}

// As residuals_of_points, for rows along the axes of W.
static inline void residuals_by_axis(const ChainKernelInput& input, const MeasuredBlock& block, bool cost_only,
                                     const Sums& sums, PointsByAxis& points) {
  Vector pose[12];
  behind(input.base, block.pose_in_base, pose);
  for (Vector& sum : points.information) {
    sum = Vector{};
  }
  for (Vector& sum : points.wrench) {
    sum = Vector{};
  }
  for (std::size_t j = 0; j < input.kept.size(); ++j) {
    const std::size_t x = j % 3;
    const AxisRow& kept = input.kept[j];
    const Vector* const r = pose + 3 * x;
    const Vector predicted =
        kept.sum * pose[9 + x] + ((kept.target[0] * r[0] + kept.target[1] * r[1]) + kept.target[2] * r[2]);
    const Vector e = (block.points[j] - predicted) * block.mask;
    sums.cost[0] += e * e;
    if (cost_only) {
      continue;
    }
    Vector row[6] = {kept.sum * r[0], kept.sum * r[1], kept.sum * r[2]};
    cross(kept.target, r, row + 3);
    for (std::size_t i = 0; i < 6; ++i) {
      points.wrench[i] += row[i] * e;
      for (std::size_t k = i; k < 6; ++k) {
        points.information[place_in_triangle(i, k)] += row[i] * row[k];
      }
    }
    for (std::size_t l = 0; l < points.targets; ++l) {
      const double share = input.shares[j * points.targets + l];
      if (share == 0.0) {
        continue;
      }
      for (std::size_t c = 0; c < 3; ++c) {
        sums.force[3 * l + c] += share * r[c] * e;
      }
    }
  }
  if (!cost_only) {
    points.take_root();
    pulls_of(input, pose, sums, points);
  }
}
