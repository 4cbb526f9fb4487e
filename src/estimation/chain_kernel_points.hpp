// Part of chain_kernel_body.hpp: residuals and information of measured points about the frame P.

struct MeasuredBlock {
  Vector mask;  // which lanes hold a configuration
  Rows data;    // of points, then of orientations
  const Vector* pose_in_base;
  const Vector* pose;  // of P in W
};

// Residuals of one block; force F and moment M into `wrench`.
static inline __attribute__((always_inline)) void residuals_of_points(const ChainKernelInput& input,
                                                                      const MeasuredBlock& block, bool cost_only,
                                                                      const Sums& sums, Vector* wrench) {
  const Rows& measured = block.data;
  const Vector* const pose = block.pose;
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

// The measured orientations, with the weight o of each.
struct Turns {
  std::size_t count;
  const Vector* weights;

  // Adds a column's twist to their coupling.
  template <bool kTurns>
  void add_coupling(const Vector* twist, Vector* sums) const {
    for (std::size_t k = 0; kTurns && k < count; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        *sums++ += weights[k] * twist[3 + c];
      }
    }
  }
};

// Rows and coupling of a column for points with isotropic noise.
struct PointsAlike {
  const double* L;
  Turns turns;

  std::size_t width() const { return 6 + 3 * turns.count; }
  // The rows [v; L^T a] of the twist (v, a); only v if it does not turn.
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
  // Adds it to the targets' coupling.
  template <bool kTurns>
  void add_coupling(const Vector* twist, Vector* sums) const {
    for (std::size_t c = 0; c < (kTurns ? 6 : 3); ++c) {
      sums[c] += twist[c];
    }
    turns.add_coupling<kTurns>(twist, sums + 6);
  }
};

static inline void cross(const std::array<double, 3>& a, const Vector* b, Vector* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

// The upper triangle of a symmetric matrix of six rows, row by row.
constexpr std::size_t place_in_triangle(std::size_t row, std::size_t column) { return row * (11 - row) / 2 + column; }

// The same for rows with independent errors, whose information about P is summed.
struct PointsInRows {
  std::size_t targets;
  Turns turns;
  Vector* pulls;           // 18 per target: the wrench on P of a unit force along each coordinate
  Vector wrench[6];        // of the residuals on P
  Vector information[21];  // about a twist of P, upper triangle
  Vector root[21];         // M with information = M^T M, upper triangle

  std::size_t width() const { return 3 * (targets + turns.count); }
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
    turns.add_coupling<kTurns>(twist, sums + 3 * targets);
  }

  void clear_pulls() {
    for (std::size_t k = 0; k < 18 * targets; ++k) {
      pulls[k] = Vector{};
    }
  }
  // Adds a row of the derivative by a twist of P, and its residual.
  void add_row(const Vector* row, const Vector& e) {
    for (std::size_t i = 0; i < 6; ++i) {
      wrench[i] += row[i] * e;
      for (std::size_t k = i; k < 6; ++k) {
        information[place_in_triangle(i, k)] += row[i] * row[k];
      }
    }
  }
  void add_information_of_turns(const Vector& of_turns) {
    for (std::size_t i = 3; i < 6; ++i) {
      information[place_in_triangle(i, i)] += of_turns;
    }
  }

  // Cholesky: M is upper triangular. Directions without information, as in a lane without a configuration, get rows of
  // zeros.
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

// Computes the targets' pulls and the sums `turned`.
static inline void pulls_of(const ChainKernelInput& input, const Vector* R, const Sums& sums, PointsInRows& points) {
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
                                     const Sums& sums, PointsInRows& points) {
  const Vector* const pose = block.pose;
  for (std::size_t j = 0; j < input.kept.size(); ++j) {
    const std::size_t x = j % 3;
    const AxisRow& kept = input.kept[j];
    const Vector* const r = pose + 3 * x;
    const Vector predicted =
        kept.sum * pose[9 + x] + ((kept.target[0] * r[0] + kept.target[1] * r[1]) + kept.target[2] * r[2]);
    const Vector e = (block.data[j] - predicted) * block.mask;
    sums.cost[0] += e * e;
    if (cost_only) {
      continue;
    }
    Vector row[6] = {kept.sum * r[0], kept.sum * r[1], kept.sum * r[2]};
    cross(kept.target, r, row + 3);
    points.add_row(row, e);
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
    pulls_of(input, pose, sums, points);
  }
}

// A row j of U: g_jl of targets first, … last - 1, and its derivative by a twist of P.
struct OwnRow {
  std::size_t first;
  std::size_t last;
  Vector* g;  // for all targets
  Vector derivative[6];
};

// Adds the row with its residual.
static inline void add_own_row(const OwnRow& row, const Vector& e, const Sums& sums, PointsInRows& points) {
  points.add_row(row.derivative, e);
  const std::size_t coordinates = 3 * points.targets;
  for (std::size_t a = 3 * row.first; a < 3 * row.last; ++a) {
    sums.force[a] += row.g[a] * e;
    for (std::size_t i = 0; i < 6; ++i) {
      points.pulls[6 * a + i] += row.g[a] * row.derivative[i];
    }
    Vector* const turned = sums.turned + a * (2 * coordinates - a - 1) / 2;
    for (std::size_t b = a; b < 3 * row.last; ++b) {
      turned[b] += row.g[a] * row.g[b];
    }
  }
}

// As residuals_of_points, for configurations with their own roots.
static inline void residuals_of_own_rows(const ChainKernelInput& input, const MeasuredBlock& block, bool cost_only,
                                         const Sums& sums, PointsInRows& points) {
  const std::size_t targets = points.targets;
  const Vector* const pose = block.pose;
  Vector* const errors = points.pulls + 18 * targets;
  for (std::size_t l = 0; l < targets; ++l) {
    const Vector d[3] = {block.data[3 * l] - pose[9], block.data[3 * l + 1] - pose[10],
                         block.data[3 * l + 2] - pose[11]};
    turned_back(pose, d, errors + 3 * l);
    for (std::size_t c = 0; c < 3; ++c) {
      errors[3 * l + c] -= input.points[l][c];
    }
  }
  std::size_t at = 3 * targets;  // index of the next number of U
  for (std::size_t j = 0; j < 3 * targets; ++j) {
    OwnRow row{
        .first = j / 3, .last = input.coupled ? targets : j / 3 + 1, .g = errors + 3 * targets, .derivative = {}};
    Vector e{};
    for (std::size_t l = row.first; l < row.last; ++l) {
      Vector u[3];
      for (std::size_t c = 0; c < 3; ++c) {
        u[c] = 3 * l + c < j ? Vector{} : block.data[at++];
      }
      Vector* const own = row.g + 3 * l;
      turned_back(pose, u, own);
      e += (own[0] * errors[3 * l] + own[1] * errors[3 * l + 1]) + own[2] * errors[3 * l + 2];
      Vector moment[3];
      cross(input.points[l], own, moment);
      for (std::size_t c = 0; c < 3; ++c) {
        row.derivative[c] += own[c];
        row.derivative[3 + c] += moment[c];
      }
    }
    e *= block.mask;
    sums.cost[0] += e * e;
    if (!cost_only) {
      add_own_row(row, e, sums, points);
    }
  }
}

// Rotation vectors of the matrices E, row by row. With s = sin(h), h half the angle, the angle over its sine is
// arcsin(s) / (s sqrt(1 - s^2)), whose series has the terms (2 n)!! / (2 n + 1)!! s^(2 n); lanes far from the identity
// are computed one by one.
static inline void rotation_vectors(const Vector* E, const Vector& mask, Vector* vectors) {
  constexpr double kNear = 0.01;  // of s^2: 11 degrees
  const Vector s2 = 0.25 * (3.0 - (E[0] + E[4] + E[8])) * mask;
  Vector sum = {};
  for (int n = 9; n > 0; --n) {
    sum = (1.0 + sum) * s2 * (2.0 * n / (2.0 * n + 1.0));
  }
  const Vector half = 0.5 + 0.5 * sum;
  vectors[0] = half * (E[7] - E[5]);
  vectors[1] = half * (E[2] - E[6]);
  vectors[2] = half * (E[3] - E[1]);
  for (std::size_t lane = 0; lane < kAtOnce; ++lane) {
    if (!(s2[lane] <= kNear)) {
      std::array<double, 9> matrix;
      std::array<double, 3> vector;
      for (std::size_t i = 0; i < 9; ++i) {
        matrix[i] = E[i][lane];
      }
      take_rotation_vector(matrix, vector);
      for (std::size_t c = 0; c < 3; ++c) {
        vectors[c][lane] = vector[c];
      }
    }
  }
}

// Output of a block's orientations: the weight of each, and their moment on P, which is added.
struct TurnPlaces {
  Vector* weights;
  Vector* moment;
};

// Residuals of measured orientations; returns their information about a rotation of P.
static inline Vector residuals_of_orientations(const ChainKernelInput& input, const MeasuredBlock& block,
                                               bool cost_only, const Sums& sums, const TurnPlaces& places) {
  Rows measured = block.data.from(input.first_orientation() - input.prismatic.size());
  Vector* force = sums.force + 3 * input.targets();
  Vector information{};
  for (std::size_t k = 0; k < input.oriented.size(); ++k) {
    const OrientationNumbers& R_PT = input.oriented[k];
    Vector E[9] = {};  // R_PT^T R_PW Z
    for (std::size_t column = 0; column < 3; ++column) {
      const Vector Z[3] = {measured[column], measured[3 + column], measured[6 + column]};
      Vector turned[3];
      turned_back(block.pose, Z, turned);
      for (std::size_t row = 0; row < 3; ++row) {
        E[3 * row + column] = (R_PT[row] * turned[0] + R_PT[3 + row] * turned[1]) + R_PT[6 + row] * turned[2];
      }
    }
    Vector e[3];
    rotation_vectors(E, block.mask, e);
    const Vector weight = measured[9] * block.mask;
    for (Vector& component : e) {
      sums.cost[0] += weight * component * component;
      component *= weight;
    }
    if (!cost_only) {
      places.weights[k] = weight;
      sums.weights[k] += weight;
      for (std::size_t c = 0; c < 3; ++c) {
        *force++ += e[c];
        places.moment[c] += (R_PT[3 * c] * e[0] + R_PT[3 * c + 1] * e[1]) + R_PT[3 * c + 2] * e[2];
      }
    }
    information += weight;
    measured = measured.from(kOrientationRows);
  }
  return information;
}
