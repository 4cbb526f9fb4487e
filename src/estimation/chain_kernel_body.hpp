// Included by chain_kernel.cpp inside a namespace, once per instruction set. KDL_CALIBRATION_AT_ONCE is the number of
// doubles in one of its registers.

#include "estimation/chain_kernel_poses.hpp"
// uses the declarations of
#include "estimation/chain_kernel_points.hpp"

// Number of nonzero coordinates of a twist (v, a): all six if it turns, else three.
template <bool kTurns>
constexpr std::size_t kCoordinates = kTurns ? 6 : 3;

// A column's twist in P.
template <bool kTurns>
static inline __attribute__((always_inline)) void twist_of(const ChainColumn& column, const Vector* poses,
                                                           Vector* twist) {
  const Vector* R = poses + 15 * static_cast<std::size_t>(column.frame);
  Vector* const v = twist;
  v[0] = v[1] = v[2] = Vector{};
  if (column.moves) {
    turned_back(R, column.linear, v);
  }
  if constexpr (kTurns) {
    Vector* const a = twist + 3;
    turned_back(R, column.angular, a);
    const Vector* p = R + 12;
    v[0] += a[1] * p[2] - a[2] * p[1];
    v[1] += a[2] * p[0] - a[0] * p[2];
    v[2] += a[0] * p[1] - a[1] * p[0];
  }
}

// One block after its residuals: the chain's poses, and the residuals as a wrench on P.
struct PulledBlock {
  const Vector* poses;
  const Vector* wrench;
};

// Pointers to the sums of a column or motion.
struct ColumnSums {
  Vector* gradient;
  Vector* coupling;
};

// Computes the rows of a column and adds to its sums.
template <bool kTurns, class Points>
static inline __attribute__((always_inline)) void add_column(const ChainColumn& column, const PulledBlock& block,
                                                             const Points& points, const ColumnSums& sums,
                                                             Vector* rows) {
  Vector twist[6];
  twist_of<kTurns>(column, block.poses, twist);
  points.template rows_of<kTurns>(twist, rows);
  points.template add_coupling<kTurns>(twist, sums.coupling);
  Vector gradient = *sums.gradient;
  for (std::size_t c = 0; c < kCoordinates<kTurns>; ++c) {
    gradient += twist[c] * block.wrench[c];
  }
  *sums.gradient = gradient;
}

// Computes the rows of one block's columns and adds to gradient and coupling.
template <class Points>
static inline __attribute__((always_inline)) void add_columns(const ChainKernelInput& input, const PulledBlock& block,
                                                              const Points& points, const Sums& sums, Vector* rows) {
  const std::size_t width = points.width();
  for (std::size_t i = 0; i < input.turning; ++i) {
    add_column<true>(input.columns[i], block, points, {sums.gradient + i, sums.coupling + width * i}, rows + 6 * i);
  }
  for (std::size_t i = input.turning; i < input.columns.size(); ++i) {
    add_column<false>(input.columns[i], block, points, {sums.gradient + i, sums.coupling + width * i}, rows + 6 * i);
  }
}

// Computes the rows of one block's motions and their additions to gradient and coupling.
template <class Points>
static inline void take_motions(const ChainKernelInput& input, const PulledBlock& block, const Points& points,
                                Vector* rows, Vector* forces) {
  for (const ChainMotion& motion : input.motions) {
    for (std::size_t c = 0; c <= points.width(); ++c) {
      forces[c] = Vector{};
    }
    for (std::size_t c = 3; c < 6; ++c) {
      rows[c] = Vector{};
    }
    const ColumnSums own{forces, forces + 1};
    if (motion.column.turns) {
      add_column<true>(motion.column, block, points, own, rows);
    } else {
      add_column<false>(motion.column, block, points, own, rows);
    }
    rows += 6;
    forces += 1 + points.width();
  }
}

// The columns first, … last - 1.
struct ColumnRange {
  std::size_t first;
  std::size_t last;
};

// Products of these columns with column `own` of one block's Jacobian, or of two consecutive blocks with that many
// columns. Two at a time, because the sums exceed the first-level cache.
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
  const std::size_t both = columns + input.motions.size();
  const std::size_t turning = input.turning;
  for (std::size_t i = 0; i < turning; ++i) {
    gram = add_products<kBlocks, 6>(J, both, i, {i, turning}, gram);
    gram = add_products<kBlocks, 3>(J, both, i, {turning, columns}, gram);
  }
  for (std::size_t i = turning; i < columns; ++i) {
    gram = add_products<kBlocks, 3>(J, both, i, {i, columns}, gram);
  }
}

// The product of two columns.
static inline Vector product_of(const Vector* one, const Vector* other, bool turns) {
  Vector product = (one[0] * other[0] + one[1] * other[1]) + one[2] * other[2];
  if (turns) {
    product += (one[3] * other[3] + one[4] * other[4]) + one[5] * other[5];
  }
  return product;
}

// Adds `factors` times the terms first, … last - 1 of each block. Returns a pointer past the last sum.
template <std::size_t kBlocks>
static inline __attribute__((always_inline)) Vector* add_terms(const Vector* factors, const Rows* terms,
                                                               ColumnRange range, Vector* sums) {
  for (std::size_t l = range.first; l < range.last; ++l) {
    Vector sum = factors[0] * terms[0][l];
    for (std::size_t b = 1; b < kBlocks; ++b) {
      sum += factors[b] * terms[b][l];
    }
    *sums++ += sum;
  }
  return sums;
}

// Adds the terms to gradient and coupling.
template <std::size_t kBlocks>
static inline void add_forces(const ChainKernelInput& input, const Vector* forces, const Rows* terms,
                              const Sums& sums) {
  const std::size_t width = input.width();
  Vector* gradient = sums.gradient + input.columns.size();
  Vector* coupling = sums.coupling + width * input.columns.size();
  for (std::size_t m = 0; m < input.motions.size(); ++m) {
    const ChainMotion& motion = input.motions[m];
    for (std::size_t k = motion.first; k < motion.first + motion.free; ++k) {
      for (std::size_t c = 0; c <= width; ++c) {
        Vector& sum = c == 0 ? *gradient++ : *coupling++;
        for (std::size_t b = 0; b < kBlocks; ++b) {
          sum += terms[b][k] * forces[(width + 1) * (b * input.motions.size() + m) + c];
        }
      }
    }
  }
}

// Products of the terms with the columns and with each other: those of their motions times the terms' basis values.
template <std::size_t kBlocks>
static inline void add_spread(const ChainKernelInput& input, const Vector* J, const Rows* terms, Vector* spread) {
  const std::size_t columns = input.columns.size();
  const std::size_t both = columns + input.motions.size();
  Vector products[kBlocks];
  for (std::size_t m = 0; m < input.motions.size(); ++m) {
    const ChainMotion& own = input.motions[m];
    const ColumnRange own_terms{own.first, own.first + own.free};
    const Vector* const rows = J + 6 * (columns + m);
    for (std::size_t i = 0; i < columns; ++i) {
      for (std::size_t b = 0; b < kBlocks; ++b) {
        products[b] = product_of(rows + 6 * b * both, J + 6 * (b * both + i), i < input.turning);
      }
      spread = add_terms<kBlocks>(products, terms, own_terms, spread);
    }
    for (std::size_t n = m; n < input.motions.size(); ++n) {
      const ChainMotion& other = input.motions[n];
      for (std::size_t b = 0; b < kBlocks; ++b) {
        products[b] = product_of(rows + 6 * b * both, J + 6 * (b * both + columns + n), true);
      }
      for (std::size_t k = own_terms.first; k < own_terms.last; ++k) {
        Vector factors[kBlocks];
        for (std::size_t b = 0; b < kBlocks; ++b) {
          factors[b] = products[b] * terms[b][k];
        }
        spread = add_terms<kBlocks>(factors, terms, {n == m ? k : other.first, other.first + other.free}, spread);
      }
    }
  }
}

// Output of one block: rows of columns and motions, the motions' additions, the targets' pulls.
struct BlockPlaces {
  Vector* jacobian;
  Vector* forces;
  Vector* pulls;
  Vector* turning;
};

// Residuals of one block, and the rows of its columns and motions.
static inline __attribute__((always_inline)) void linearise(const ChainKernelInput& input, MeasuredBlock block,
                                                            bool cost_only, const Sums& sums,
                                                            const BlockPlaces& places) {
  Vector pose[12];
  behind(input.base, block.pose_in_base, pose);
  block.pose = pose;
  const Turns turns{input.oriented.size(), places.turning};
  const auto add = [&](const Vector* wrench, const auto& points) __attribute__((always_inline)) {
    if (!cost_only) {
      const PulledBlock pulled{block.pose_in_base, wrench};
      add_columns(input, pulled, points, sums, places.jacobian);
      take_motions(input, pulled, points, places.jacobian + 6 * input.columns.size(), places.forces);
    }
  };
  if (input.in_rows()) {
    PointsInRows points{
        .targets = input.targets(), .turns = turns, .pulls = places.pulls, .wrench = {}, .information = {}, .root = {}};
    if (!cost_only) {
      points.clear_pulls();
    }
    if (input.by_axis()) {
      residuals_by_axis(input, block, cost_only, sums, points);
    } else {
      residuals_of_own_rows(input, block, cost_only, sums, points);
    }
    points.add_information_of_turns(
        residuals_of_orientations(input, block, cost_only, sums, {places.turning, points.wrench + 3}));
    if (!cost_only) {
      points.take_root();
    }
    add(points.wrench, points);
  } else {
    Vector wrench[6];
    residuals_of_points(input, block, cost_only, sums, wrench);
    residuals_of_orientations(input, block, cost_only, sums, {places.turning, wrench + 3});
    add(wrench, PointsAlike{input.root.data(), turns});
  }
}

// One part of the lanes of the blocks from `first` on.
struct BlockRange {
  std::size_t first;
  std::size_t part;
};

// Adds kBlocks blocks.
template <std::size_t kBlocks>
static inline __attribute__((always_inline)) void add_blocks(const ChainKernelInput& input, const BlockRange& range,
                                                             bool cost_only, const Sums& sums, ChainKernelSums& all) {
  const std::size_t joints = input.prismatic.size();
  const std::size_t motions = input.motions.size();
  const std::size_t rows = 6 * (input.columns.size() + motions);
  auto* const poses = reinterpret_cast<Vector*>(all.poses.data());
  auto* const turns = reinterpret_cast<Vector*>(all.turns.data());
  auto* const q = reinterpret_cast<Vector*>(all.joints.data());
  auto* const jacobian = reinterpret_cast<Vector*>(all.jacobian.data());
  auto* const forces = reinterpret_cast<Vector*>(all.forces.data());
  auto* const pulls = reinterpret_cast<Vector*>(all.pulls.data());
  auto* const turning = reinterpret_cast<Vector*>(all.turning.data());
  Rows terms[kBlocks];
  for (std::size_t b = 0; b < kBlocks; ++b) {
    const Rows data{reinterpret_cast<const Vector*>(input.data + (range.first + b) * input.rows()) + range.part};
    terms[b] = data.from(input.rows() - input.values.size());
    const Vector mask = mask_of((range.first + b) * kLanes + range.part * kAtOnce, input.configurations);
    moved_joints(input, data, terms[b], q);
    chain_poses(input, mask, q, turns, poses);
    linearise(input, {mask, data.from(joints), poses, nullptr}, cost_only, sums,
              {jacobian + rows * b, forces + (1 + input.width()) * motions * b, pulls, turning});
  }
  if (cost_only) {
    return;
  }
  constexpr std::size_t kPair = kBlocks < 2 ? 1 : 2;
  for (std::size_t b = 0; b < kBlocks; b += kPair) {
    add_gram<kPair>(input, jacobian + rows * b, sums.gram);
  }
  if (motions > 0) {
    add_forces<kBlocks>(input, forces, terms, sums);
    add_spread<kBlocks>(input, jacobian, terms, sums.spread);
  }
}

static void sum(const ChainKernelInput& input, bool cost_only, ChainKernelSums& all) {
  const std::size_t blocks = (input.configurations + kLanes - 1) / kLanes;
  // One part after the other for a few blocks, because the sums of all parts exceed the first-level cache.
  for (std::size_t begin = 0; begin < blocks; begin += kBlocksInCache) {
    const std::size_t end = std::min(begin + kBlocksInCache, blocks);
    for (std::size_t part = 0; part < kParts; ++part) {
      Vector* const cost = reinterpret_cast<Vector*>(all.lanes.data()) + part * all.lanes.size();
      Vector* const gradient = cost + 1;
      Vector* const coupling = gradient + all.gradient.size();
      Vector* const force = coupling + all.coupling.size();
      Vector* const turned = force + all.force.size();
      Vector* const weights = turned + all.turned.size();
      Vector* const gram = weights + all.weights.size();
      const Sums sums{.gram = gram,
                      .spread = gram + all.gram.size(),
                      .gradient = gradient,
                      .coupling = coupling,
                      .force = force,
                      .turned = turned,
                      .weights = weights,
                      .cost = cost};
      std::size_t block = begin;
      for (; !input.motions.empty() && block + kMostBlocks <= end; block += kMostBlocks) {
        add_blocks<kMostBlocks>(input, {block, part}, cost_only, sums, all);
      }
      for (; block + 2 <= end; block += 2) {
        add_blocks<2>(input, {block, part}, cost_only, sums, all);
      }
      if (block < end) {
        add_blocks<1>(input, {block, part}, cost_only, sums, all);
      }
    }
  }
  add_lanes<kAtOnce>(all.lanes, all);
}
