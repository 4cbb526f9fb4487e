#include "estimation/chain_kernel.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>

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

// An arm with a prismatic joint in the middle, columns of every kind, and a number of configurations that leaves lanes
// empty, in one block more than are done in one go.
struct Case {
  static constexpr std::size_t kJoints = 3;
  static constexpr std::size_t kConfigurations = 8 * 16 + 5;
  Random random{7};
  Isometry3d X_WB = random_pose(random);
  Isometry3d X_FP = Isometry3d(Eigen::Translation3d(random_vector(random)));
  std::vector<Isometry3d> links;
  ChainKernelInput input;
  std::vector<LaneRow> data;

  Case() {
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
    const std::size_t rows = kJoints + 3 * input.points.size();
    data.resize((kConfigurations + kLanes - 1) / kLanes * rows);
    for (LaneRow& row : data) {
      for (int lane = 0; lane < kLanes; ++lane) {
        row.lanes[lane] = 2.0 * random.normal();
      }
    }
    input.data = data.data();
    input.configurations = kConfigurations;
  }

  double value(std::size_t configuration, std::size_t row) const {
    return data[configuration / kLanes * (kJoints + 3 * input.points.size()) + row].lanes[configuration % kLanes];
  }
};

struct Sums {
  MatrixXd gram;
  VectorXd gradient;
  MatrixXd twist;
  MatrixXd force;
  double cost = 0.0;
};

// The header's formulas, written out for one configuration after the other.
Sums formulas(const Case& c) {
  const auto columns = static_cast<Index>(c.input.columns.size());
  const auto points = static_cast<Index>(c.input.points.size());
  Sums sums{.gram = MatrixXd::Zero(columns, columns),
            .gradient = VectorXd::Zero(columns),
            .twist = MatrixXd::Zero(6, columns),
            .force = MatrixXd::Zero(3, points)};
  Matrix3d L = Matrix3d::Zero();
  const auto& root = c.input.root;
  L << root[0], 0.0, 0.0, root[1], root[2], 0.0, root[3], root[4], root[5];
  for (std::size_t n = 0; n < Case::kConfigurations; ++n) {
    std::vector<Isometry3d> X_Bf = {Isometry3d::Identity()};  // of a joint: before its own motion
    Isometry3d X_B = Isometry3d::Identity();
    for (std::size_t i = 0; i < Case::kJoints; ++i) {
      Isometry3d joint = Isometry3d::Identity();
      if (c.input.prismatic[i] != 0) {
        joint.translation().z() = c.value(n, i);
      } else {
        joint.linear() = Eigen::AngleAxisd(c.value(n, i), Vector3d::UnitZ()).toRotationMatrix();
      }
      X_Bf.push_back(X_B * c.links[i]);
      X_B = X_Bf.back() * joint;
    }
    X_Bf.push_back(X_B * c.links[Case::kJoints]);
    const Isometry3d X_BP = X_Bf.back() * c.X_FP;
    const Isometry3d X_WP = c.X_WB * X_BP;
    Vector3d F = Vector3d::Zero();
    Vector3d M = Vector3d::Zero();
    for (Index k = 0; k < points; ++k) {
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
    MatrixXd J(6, columns);
    for (Index i = 0; i < columns; ++i) {
      const ChainColumn& column = c.input.columns[static_cast<std::size_t>(i)];
      const Isometry3d X_Pf = X_BP.inverse() * X_Bf[static_cast<std::size_t>(column.frame)];
      const Vector3d a = X_Pf.linear() * vector_of(column.angular);
      const Vector3d v = X_Pf.linear() * vector_of(column.linear) + X_Pf.translation().cross(a);
      sums.twist.col(i) += (Eigen::Matrix<double, 6, 1>() << v, a).finished();
      sums.gradient[i] += v.dot(F) + a.dot(M);
      J.col(i) << v, L.transpose() * a;
    }
    sums.gram += J.transpose() * J;
  }
  return sums;
}

ChainKernelSums sums_of(const Case& c, bool cost_only, InstructionSet set) {
  ChainKernelSums sums;
  ChainKernelInput other = c.input;  // leaves nothing behind
  other.columns.resize(7);
  other.configurations = 30;
  sum_chain(other, false, sums, set);
  sum_chain(c.input, cost_only, sums, set);
  return sums;
}

TEST(ChainKernel, AddsUpWhatTheFormulasSay) {
  const Case c;
  const Sums expected = formulas(c);
  const double scale = expected.gram.cwiseAbs().maxCoeff();
  for (const InstructionSet set : instruction_sets()) {
    const ChainKernelSums sums = sums_of(c, false, set);
    EXPECT_NEAR(sums.cost, expected.cost, 1e-12 * expected.cost);
    std::size_t row = 0;
    for (Index i = 0; i < expected.gram.rows(); ++i) {
      for (Index j = i; j < expected.gram.cols(); ++j) {
        EXPECT_NEAR(sums.gram[row++], expected.gram(i, j), 1e-12 * scale) << i << ", " << j;
      }
      const auto column = static_cast<std::size_t>(i);
      EXPECT_NEAR(sums.gradient[column], expected.gradient[i], 1e-12 * scale) << i;
      for (Index k = 0; k < 6; ++k) {
        EXPECT_NEAR(sums.twist[6 * column + static_cast<std::size_t>(k)], expected.twist(k, i), 1e-12 * scale);
      }
    }
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

TEST(ChainKernel, GivesTheSameBitsWithEveryInstructionSet) {
  const Case c;
  const ChainKernelSums baseline = sums_of(c, false, InstructionSet::baseline);
  for (const InstructionSet set : instruction_sets()) {
    const ChainKernelSums sums = sums_of(c, false, set);
    EXPECT_EQ(sums.cost, baseline.cost);
    EXPECT_EQ(sums.gram, baseline.gram);
    EXPECT_EQ(sums.gradient, baseline.gradient);
    EXPECT_EQ(sums.twist, baseline.twist);
    EXPECT_EQ(sums.force, baseline.force);
    EXPECT_EQ(sums_of(c, true, set).cost, baseline.cost);
  }
}

}  // namespace
}  // namespace kdl_calibration
