#include "estimation/chain_kernel.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

Vector3d random_vector(Random& random) { return {random.normal(), random.normal(), random.normal()}; }

Isometry3d random_pose(Random& random) {
  const Vector3d axis = random_vector(random);
  Isometry3d X = Isometry3d::Identity();
  X.linear() = Eigen::AngleAxisd(axis.norm(), axis.normalized()).toRotationMatrix();
  X.translation() = random_vector(random);
  return X;
}

FrameNumbers numbers_of(const Isometry3d& X) {
  FrameNumbers numbers{};
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(numbers.data()) = X.linear();
  Eigen::Map<Vector3d>(numbers.data() + 9) = X.translation();
  return numbers;
}

Vector3d vector_of(const std::array<double, 3>& numbers) { return Vector3d(numbers.data()); }

// What is kept of the points.
enum class Kept { points, rows_by_axis, own_rows, coupled_own_rows };

struct Kind {
  Kept kept = Kept::points;
  bool oriented = false;
};

// An arm with a prismatic joint in the middle, columns of every kind, joints that terms move and tilt, and a number of
// configurations that leaves lanes empty, in one block more than are done in one go.
struct Case {
  static constexpr std::size_t kJoints = 3;
  static constexpr std::size_t kConfigurations = 8 * 16 + 5;
  Random random{7};
  Isometry3d X_WB = random_pose(random);
  Isometry3d X_FP = Isometry3d(Eigen::Translation3d(random_vector(random)));
  std::vector<Isometry3d> links;
  ChainKernelInput input;
  std::vector<LaneRow> data;

  explicit Case(const Kind& kind) {
    for (std::size_t i = 0; i <= kJoints; ++i) {
      links.push_back(random_pose(random));
      input.links.push_back(numbers_of(i < kJoints ? links[i] : links[i] * X_FP));
    }
    input.prismatic = {0, 1, 0};
    input.base = numbers_of(X_WB);
    input.flange = numbers_of(X_FP);
    for (int i = 0; i < 9; ++i) {
      const bool turns = i < 5;
      const bool moves = i % 2 == 0 || !turns;
      ChainColumn column{.frame = i % 5, .moves = moves, .turns = turns, .linear = {}, .angular = {}};
      if (moves) {
        Eigen::Map<Vector3d>(column.linear.data()) = random_vector(random);
      }
      if (turns) {
        Eigen::Map<Vector3d>(column.angular.data()) = random_vector(random);
      }
      input.columns.push_back(column);
    }
    input.turning = 5;
    input.weights = {2.0, 0.5};
    input.points = {{0.1, -0.2, 0.3}, {-0.4, 0.8, -1.2}};
    input.root = {0.3, -0.2, 0.7, 0.1, 0.4, 0.9};
    const ChainColumn turn{.frame = kJoints + 2, .turns = true, .linear = {}, .angular = {0.0, 0.0, 1.0}};
    const ChainColumn slide{.frame = kJoints + 3, .moves = true, .linear = {0.0, 0.0, 1.0}, .angular = {}};
    const ChainColumn tilt_x{.frame = 3, .turns = true, .linear = {}, .angular = {1.0, 0.0, 0.0}};
    const ChainColumn tilt_y{.frame = kJoints + 4, .turns = true, .linear = {}, .angular = {0.0, 1.0, 0.0}};
    input.motions = {{.entry = 0, .column = turn, .first = 0, .free = 2, .last = 3},
                     {.entry = 1, .column = slide, .first = 3, .free = 1, .last = 4},
                     {.entry = kJoints + 4, .column = tilt_x, .first = 4, .free = 2, .last = 6},
                     {.entry = kJoints + 5, .column = tilt_y, .first = 6, .free = 0, .last = 7}};
    if (kind.kept == Kept::rows_by_axis) {
      keep_rows();
    }
    input.own_roots = kind.kept == Kept::own_rows || kind.kept == Kept::coupled_own_rows;
    input.coupled = kind.kept == Kept::coupled_own_rows;
    for (int k = 0; kind.oriented && k < 2; ++k) {
      const FrameNumbers numbers = numbers_of(random_pose(random));
      std::copy_n(numbers.begin(), 9, input.oriented.emplace_back().begin());
    }
    input.values = {0.1, -0.2, 0.05, 0.3, -0.1, 0.2, 0.15};
    input.tilts = true;
    const std::size_t rows = input.rows();
    data.resize((kConfigurations + kLanes - 1) / kLanes * rows);
    for (LaneRow& row : data) {
      for (int lane = 0; lane < kLanes; ++lane) {
        row.lanes[lane] = 2.0 * random.normal();
      }
    }
    input.data = data.data();
    input.configurations = kConfigurations;
    for (std::size_t n = 0; n < kConfigurations; ++n) {
      orient(n);
    }
  }

  Matrix3d orientation_of(std::size_t k) const {
    return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(input.oriented[k].data());
  }

  // Measured orientations at all distances from those expected: none, small, and up to half a turn.
  void orient(std::size_t n);

  // Two rows along each axis, of three targets.
  void keep_rows() {
    input.points.clear();
    input.weights.clear();
    const std::vector<Vector3d> targets = {{0.3, -0.2, 0.1}, {-0.1, 0.4, 0.2}, {0.2, 0.1, -0.5}};
    input.kept.resize(6);
    input.pulls.resize(9);
    for (std::size_t row = 0; row < 6; ++row) {
      for (std::size_t l = 0; l < 3; ++l) {
        const double share = l == 1 && row == 4 ? 0.0 : random.normal();
        input.shares.push_back(share);
        input.kept[row].sum += share;
        Eigen::Map<Vector3d>(input.kept[row].target.data()) += share * targets[l];
      }
    }
    for (std::size_t row = 0; row < 6; ++row) {
      for (std::size_t l = 0; l < 3; ++l) {
        AxisRow& pull = input.pulls[3 * l + row % 3];
        pull.sum += input.shares[3 * row + l] * input.kept[row].sum;
        Eigen::Map<Vector3d>(pull.target.data()) += input.shares[3 * row + l] * vector_of(input.kept[row].target);
      }
    }
  }

  void set_value(std::size_t configuration, std::size_t row, double value) {
    data[configuration / kLanes * input.rows() + row].lanes[configuration % kLanes] = value;
  }

  double value(std::size_t configuration, std::size_t row) const {
    return data[configuration / kLanes * input.rows() + row].lanes[configuration % kLanes];
  }

  double worth(std::size_t configuration, std::size_t term) const {
    return value(configuration, input.rows() - input.values.size() + term);
  }

  // Of the joint values and tilts.
  double moved(std::size_t configuration, std::size_t entry) const {
    double sum = entry < kJoints ? value(configuration, entry) : 0.0;
    for (const ChainMotion& motion : input.motions) {
      for (std::size_t k = motion.first; motion.entry == entry && k < motion.last; ++k) {
        sum += input.values[k] * worth(configuration, k);
      }
    }
    return sum;
  }
};

Matrix3d measured_orientation(const Case& c, std::size_t n, std::size_t k) {
  Matrix3d Z;
  for (std::size_t i = 0; i < 9; ++i) {
    Z(static_cast<Index>(i / 3), static_cast<Index>(i % 3)) =
        c.value(n, c.input.first_orientation() + kOrientationRows * k + i);
  }
  return Z;
}

double weight_of_orientation(const Case& c, std::size_t n, std::size_t k) {
  return c.value(n, c.input.first_orientation() + kOrientationRows * k + 9);
}

// U of a configuration, 3 points x 3 points.
MatrixXd own_root(const Case& c, std::size_t n) {
  const auto size = static_cast<Index>(3 * c.input.points.size());
  MatrixXd U = MatrixXd::Zero(size, size);
  std::size_t next = Case::kJoints + 3 * c.input.points.size();
  for (Index row = 0; row < size; ++row) {
    for (Index column = row; column < (c.input.coupled ? size : row - row % 3 + 3); ++column) {
      U(row, column) = c.value(n, next++);
    }
  }
  EXPECT_EQ(next, c.input.first_orientation());
  return U;
}

Isometry3d turned_about(const Vector3d& axis, double angle) { return Isometry3d(Eigen::AngleAxisd(angle, axis)); }

struct Sums {
  MatrixXd gram;
  VectorXd gradient;
  MatrixXd coupling;
  MatrixXd force;
  std::array<Matrix3d, 3> turned = {Matrix3d::Zero(), Matrix3d::Zero(), Matrix3d::Zero()};
  MatrixXd of_targets;  // of own rows: all coordinates with each other
  VectorXd weights;
  double cost = 0.0;
};

// By the header's formulas, what the rows of one configuration add: J has the twists of all columns.
void add_rows(const Case& c, std::size_t n, const Isometry3d& X_WP, const MatrixXd& J, Sums& sums) {
  for (std::size_t x = 0; x < 3; ++x) {
    const Vector3d r = X_WP.linear().row(static_cast<Index>(x)).transpose();
    sums.turned[x] += r * r.transpose();
  }
  for (std::size_t row = 0; row < c.input.kept.size(); ++row) {
    const auto x = static_cast<Index>(row % 3);
    const AxisRow& kept = c.input.kept[row];
    const Vector3d r = X_WP.linear().row(x).transpose();
    const Vector3d s = vector_of(kept.target);
    const double e = c.value(n, Case::kJoints + row) - kept.sum * X_WP.translation()[x] - r.dot(s);
    const Eigen::RowVectorXd own =
        kept.sum * r.transpose() * J.topRows<3>() + s.cross(r).transpose() * J.bottomRows<3>();
    sums.cost += e * e;
    sums.gradient += e * own.transpose();
    sums.gram += own.transpose() * own;
    for (Index l = 0; l < 3; ++l) {
      const Vector3d of_target = c.input.shares[3 * row + static_cast<std::size_t>(l)] * r;
      sums.force.col(l) += e * of_target;
      sums.coupling.middleRows<3>(3 * l) += of_target * own;
    }
  }
}

// The same for a configuration's own rows U, whose Jacobian by all coordinates and by the twist is U R (I, [-t x]).
void add_own_rows(const Case& c, std::size_t n, const Isometry3d& X_WP, const MatrixXd& J, Sums& sums) {
  const auto points = static_cast<Index>(c.input.points.size());
  VectorXd e(3 * points);
  MatrixXd of_twist(3 * points, 6);
  MatrixXd R = MatrixXd::Zero(3 * points, 3 * points);
  for (Index l = 0; l < points; ++l) {
    const Vector3d t = vector_of(c.input.points[static_cast<std::size_t>(l)]);
    const auto row = Case::kJoints + 3 * static_cast<std::size_t>(l);
    e.segment<3>(3 * l) = Vector3d(c.value(n, row), c.value(n, row + 1), c.value(n, row + 2)) - X_WP * t;
    Matrix3d cross;
    cross << 0.0, -t.z(), t.y(), t.z(), 0.0, -t.x(), -t.y(), t.x(), 0.0;
    of_twist.middleRows<3>(3 * l) << X_WP.linear(), -X_WP.linear() * cross;
    R.block<3, 3>(3 * l, 3 * l) = X_WP.linear();
  }
  const MatrixXd U = own_root(c, n);
  const VectorXd Ue = U * e;
  const MatrixXd own = U * of_twist * J;
  const MatrixXd of_target = U * R;
  sums.cost += Ue.squaredNorm();
  sums.gradient += own.transpose() * Ue;
  sums.gram += own.transpose() * own;
  sums.force.leftCols(points).reshaped() += of_target.transpose() * Ue;
  sums.coupling.topRows(3 * points) += of_target.transpose() * own;
  sums.of_targets += of_target.transpose() * of_target;
}

// What the measured orientations of one configuration add, behind all that positions do.
void add_orientations(const Case& c, std::size_t n, const Isometry3d& X_WP, const MatrixXd& J, Sums& sums) {
  const auto positions = static_cast<Index>(c.input.targets());
  const auto width = static_cast<Index>(c.input.width_of_positions());
  for (Index k = 0; k < sums.weights.size(); ++k) {
    const auto place = static_cast<std::size_t>(k);
    const double weight = weight_of_orientation(c, n, place);
    const Matrix3d R_PT = c.orientation_of(place);
    const Eigen::AngleAxisd error(
        Matrix3d(R_PT.transpose() * X_WP.linear().transpose() * measured_orientation(c, n, place)));
    const Vector3d e = error.angle() * error.axis();
    sums.cost += weight * e.squaredNorm();
    sums.gradient += weight * J.bottomRows<3>().transpose() * R_PT * e;
    sums.force.col(positions + k) += weight * e;
    sums.coupling.middleRows<3>(width + 3 * k) += weight * J.bottomRows<3>();
    sums.weights[k] += weight;
    if (c.input.in_rows()) {  // else `root` says it
      sums.gram += weight * J.bottomRows<3>().transpose() * J.bottomRows<3>();
    }
  }
}

// Frames of a configuration in the base frame: of each joint before its own motion, of the flange, of each joint behind
// its tilts as well.
std::vector<Isometry3d> frames(const Case& c, std::size_t n) {
  std::vector<Isometry3d> X_Bf = {Isometry3d::Identity()};
  std::vector<Isometry3d> X_Bt;
  Isometry3d X_B = Isometry3d::Identity();
  for (std::size_t i = 0; i < Case::kJoints; ++i) {
    Isometry3d joint = Isometry3d::Identity();
    if (c.input.prismatic[i] != 0) {
      joint.translation().z() = c.moved(n, i);
    } else {
      joint = turned_about(Vector3d::UnitZ(), c.moved(n, i));
    }
    X_Bf.push_back(X_B * c.links[i]);
    X_Bt.push_back(X_Bf.back() * turned_about(Vector3d::UnitX(), c.moved(n, Case::kJoints + 2 * i)) *
                   turned_about(Vector3d::UnitY(), c.moved(n, Case::kJoints + 2 * i + 1)));
    X_B = X_Bt.back() * joint;
  }
  X_Bf.push_back(X_B * c.links[Case::kJoints]);
  X_Bf.insert(X_Bf.end(), X_Bt.begin(), X_Bt.end());
  return X_Bf;
}

// Each column's twist at the flange's point P, in its axes: linear above angular part. Terms lie behind the others.
MatrixXd twists(const Case& c, std::size_t n, const std::vector<Isometry3d>& X_Bf, const Isometry3d& X_BP) {
  std::vector<std::pair<ChainColumn, double>> all;
  for (const ChainColumn& column : c.input.columns) {
    all.emplace_back(column, 1.0);
  }
  for (const ChainMotion& motion : c.input.motions) {
    for (std::size_t k = motion.first; k < motion.first + motion.free; ++k) {
      all.emplace_back(motion.column, c.worth(n, k));
    }
  }
  MatrixXd J(6, static_cast<Index>(all.size()));
  for (Index i = 0; i < J.cols(); ++i) {
    const auto& [column, worth] = all[static_cast<std::size_t>(i)];
    const Isometry3d X_Pf = X_BP.inverse() * X_Bf[static_cast<std::size_t>(column.frame)];
    const Vector3d a = worth * X_Pf.linear() * vector_of(column.angular);
    const Vector3d v = worth * X_Pf.linear() * vector_of(column.linear) + X_Pf.translation().cross(a);
    J.col(i) << v, a;
  }
  return J;
}

void Case::orient(std::size_t n) {
  const Isometry3d X_WP = X_WB * frames(*this, n)[kJoints + 1] * X_FP;
  for (std::size_t k = 0; k < input.oriented.size(); ++k) {
    const double angle =
        n % 4 == 0 ? 0.0
                   : std::pow(10.0, -static_cast<double>(n % 9)) * std::abs(std::sin(1.0 + static_cast<double>(n)));
    const Matrix3d Z = X_WP.linear() * orientation_of(k) *
                       Eigen::AngleAxisd(3.0 * angle, random_vector(random).normalized()).toRotationMatrix();
    const std::size_t first = input.first_orientation() + kOrientationRows * k;
    for (std::size_t i = 0; i < 9; ++i) {
      set_value(n, first + i, Z(static_cast<Index>(i / 3), static_cast<Index>(i % 3)));
    }
    set_value(n, first + 9, 0.5 + random.uniform());
  }
}

// Noise alike in every direction.
void add_points(const Case& c, std::size_t n, const Isometry3d& X_WP, MatrixXd J, Sums& sums) {
  Vector3d F = Vector3d::Zero();
  Vector3d M = Vector3d::Zero();
  for (Index k = 0; k < static_cast<Index>(c.input.points.size()); ++k) {
    const auto row = Case::kJoints + 3 * static_cast<std::size_t>(k);
    const Vector3d z(c.value(n, row), c.value(n, row + 1), c.value(n, row + 2));
    const Vector3d t = vector_of(c.input.points[static_cast<std::size_t>(k)]);
    const double w = c.input.weights[static_cast<std::size_t>(k)];
    const Vector3d e = X_WP.inverse() * z - t;
    sums.cost += w * e.squaredNorm();
    sums.force.col(k) += w * e;
    F += w * e;
    M += w * t.cross(e);
  }
  sums.coupling.topRows<6>() += J;
  sums.gradient += J.topRows<3>().transpose() * F + J.bottomRows<3>().transpose() * M;
  const auto& root = c.input.root;
  Matrix3d L = Matrix3d::Zero();
  L << root[0], 0.0, 0.0, root[1], root[2], 0.0, root[3], root[4], root[5];
  J.bottomRows<3>() = L.transpose() * J.bottomRows<3>().eval();
  sums.gram += J.transpose() * J;
}

// The header's formulas, written out for one configuration after the other.
Sums formulas(const Case& c) {
  const auto columns = static_cast<Index>(c.input.columns.size()) + 5;
  const auto points = static_cast<Index>(c.input.by_axis() ? 3 : c.input.points.size());
  const auto orientations = static_cast<Index>(c.input.oriented.size());
  Sums sums{.gram = MatrixXd::Zero(columns, columns),
            .gradient = VectorXd::Zero(columns),
            .coupling = MatrixXd::Zero(static_cast<Index>(c.input.width()), columns),
            .force = MatrixXd::Zero(3, points + orientations),
            .of_targets = MatrixXd::Zero(3 * points, 3 * points),
            .weights = VectorXd::Zero(orientations)};
  for (std::size_t n = 0; n < Case::kConfigurations; ++n) {
    const std::vector<Isometry3d> X_Bf = frames(c, n);
    const Isometry3d X_BP = X_Bf[Case::kJoints + 1] * c.X_FP;
    const Isometry3d X_WP = c.X_WB * X_BP;
    const MatrixXd J = twists(c, n, X_Bf, X_BP);
    if (c.input.by_axis()) {
      add_rows(c, n, X_WP, J, sums);
    } else if (c.input.own_roots) {
      add_own_rows(c, n, X_WP, J, sums);
    } else {
      add_points(c, n, X_WP, J, sums);
    }
    add_orientations(c, n, X_WP, J, sums);
  }
  return sums;
}

ChainKernelSums sums_of(const Case& c, bool cost_only, InstructionSet set) {
  ChainKernelSums sums;
  ChainKernelInput other = c.input;  // leaves nothing behind
  other.columns.resize(7);
  other.motions.pop_back();
  other.configurations = 30;
  sum_chain(other, false, sums, set);
  sum_chain(c.input, cost_only, sums, set);
  return sums;
}

// Products of the terms, of which the three motions that have some have two, one and two.
void expect_spread(const ChainKernelSums& sums, const MatrixXd& gram, Index columns) {
  const double tolerance = 1e-12 * gram.cwiseAbs().maxCoeff();
  const std::vector<std::pair<Index, Index>> terms = {{0, 2}, {2, 3}, {3, 5}};
  std::vector<std::pair<Index, Index>> order;  // rows and columns of `gram`
  for (auto own = terms.begin(); own != terms.end(); ++own) {
    for (Index j = 0; j < columns; ++j) {
      for (Index k = own->first; k < own->second; ++k) {
        order.emplace_back(columns + k, j);
      }
    }
    for (auto other = own; other != terms.end(); ++other) {
      for (Index k = own->first; k < own->second; ++k) {
        for (Index l = other == own ? k : other->first; l < other->second; ++l) {
          order.emplace_back(columns + k, columns + l);
        }
      }
    }
  }
  ASSERT_EQ(order.size(), sums.spread.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const auto& [row, column] = order[i];
    EXPECT_NEAR(sums.spread[i], gram(row, column), tolerance) << row << ", " << column;
  }
}

// Of own rows: the upper triangle, row by row.
void expect_products_of_targets(const ChainKernelSums& sums, const MatrixXd& of_targets) {
  const double tolerance = 1e-12 * of_targets.cwiseAbs().maxCoeff();
  std::size_t next = 0;
  for (Index row = 0; row < of_targets.rows(); ++row) {
    for (Index column = row; column < of_targets.cols(); ++column) {
      EXPECT_NEAR(sums.turned[next++], of_targets(row, column), tolerance) << row << ", " << column;
    }
  }
  EXPECT_EQ(next, sums.turned.size());
}

void expect_turned(const ChainKernelSums& sums, const Sums& expected, const ChainKernelInput& input) {
  if (input.own_roots) {
    expect_products_of_targets(sums, expected.of_targets);
    return;
  }
  ASSERT_EQ(sums.turned.size(), input.by_axis() ? 18U : 0U);
  for (std::size_t x = 0; input.by_axis() && x < 3; ++x) {
    const Matrix3d& turned = expected.turned[x];
    const std::vector<double> upper = {turned(0, 0), turned(0, 1), turned(0, 2),
                                       turned(1, 1), turned(1, 2), turned(2, 2)};
    for (std::size_t k = 0; k < 6; ++k) {
      EXPECT_NEAR(sums.turned[6 * x + k], upper[k], 1e-12 * static_cast<double>(Case::kConfigurations));
    }
  }
}

class ChainKernels : public ::testing::TestWithParam<Kind> {};

TEST_P(ChainKernels, AddUpWhatTheFormulasSay) {
  const Case c(GetParam());
  const Sums expected = formulas(c);
  const double scale = expected.gram.cwiseAbs().maxCoeff();
  for (const InstructionSet set : instruction_sets()) {
    const ChainKernelSums sums = sums_of(c, false, set);
    EXPECT_NEAR(sums.cost, expected.cost, 1e-12 * expected.cost);
    std::size_t row = 0;
    const auto columns = static_cast<Index>(c.input.columns.size());
    for (Index i = 0; i < expected.gram.rows(); ++i) {
      for (Index j = i; j < columns; ++j) {
        EXPECT_NEAR(sums.gram[row++], expected.gram(i, j), 1e-12 * scale) << i << ", " << j;
      }
      const auto column = static_cast<std::size_t>(i);
      EXPECT_NEAR(sums.gradient[column], expected.gradient[i], 1e-12 * scale) << i;
      for (Index k = 0; k < expected.coupling.rows(); ++k) {
        EXPECT_NEAR(sums.coupling[c.input.width() * column + static_cast<std::size_t>(k)], expected.coupling(k, i),
                    1e-12 * scale)
            << i << ", " << k;
      }
    }
    expect_spread(sums, expected.gram, columns);
    expect_turned(sums, expected, c.input);
    EXPECT_EQ(sums.weights.size(), c.input.oriented.size());
    for (Index k = 0; k < expected.weights.size(); ++k) {
      EXPECT_NEAR(sums.weights[static_cast<std::size_t>(k)], expected.weights[k], 1e-12 * expected.weights[k]);
    }
    EXPECT_EQ(sums.force.size(), static_cast<std::size_t>(expected.force.size()));
    for (Index k = 0; k < expected.force.size(); ++k) {
      EXPECT_NEAR(sums.force[static_cast<std::size_t>(k)], expected.force.reshaped()[k], 1e-12 * scale);
    }
  }
}

TEST(ChainKernel, KnowsTheInstructionSetsOfTheMachine) {
  std::vector<InstructionSet> expected = {InstructionSet::baseline};
#if defined(__x86_64__) && !defined(__clang__)
  if (__builtin_cpu_supports("avx2")) {
    expected.push_back(InstructionSet::avx2);
  }
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
    expected.push_back(InstructionSet::avx512);
  }
#endif
  EXPECT_EQ(instruction_sets(), expected);
}

TEST_P(ChainKernels, GiveTheSameBitsWithEveryInstructionSet) {
  const Case c(GetParam());
  const ChainKernelSums baseline = sums_of(c, false, InstructionSet::baseline);
  for (const InstructionSet set : instruction_sets()) {
    const ChainKernelSums sums = sums_of(c, false, set);
    EXPECT_EQ(sums.cost, baseline.cost);
    EXPECT_EQ(sums.gram, baseline.gram);
    EXPECT_EQ(sums.spread, baseline.spread);
    EXPECT_EQ(sums.gradient, baseline.gradient);
    EXPECT_EQ(sums.coupling, baseline.coupling);
    EXPECT_EQ(sums.turned, baseline.turned);
    EXPECT_EQ(sums.force, baseline.force);
    EXPECT_EQ(sums.weights, baseline.weights);
    EXPECT_EQ(sums_of(c, true, set).cost, baseline.cost);
  }
}

std::string name_of(const ::testing::TestParamInfo<Kind>& test) {
  const std::array names = {"Points", "RowsByAxis", "OwnRows", "CoupledOwnRows"};
  return std::string(names.at(static_cast<std::size_t>(test.param.kept))) + (test.param.oriented ? "Oriented" : "");
}

INSTANTIATE_TEST_SUITE_P(All, ChainKernels,
                         ::testing::Values(Kind{Kept::points, false}, Kind{Kept::points, true},
                                           Kind{Kept::rows_by_axis, false}, Kind{Kept::rows_by_axis, true},
                                           Kind{Kept::own_rows, false}, Kind{Kept::own_rows, true},
                                           Kind{Kept::coupled_own_rows, false}, Kind{Kept::coupled_own_rows, true}),
                         name_of);

}  // namespace
}  // namespace kdl_calibration
