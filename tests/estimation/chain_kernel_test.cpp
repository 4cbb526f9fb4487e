#include "estimation/chain_kernel.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "base/random.hpp"

namespace kdl_calibration::chain_kernel_test {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

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
  ChainKernelInput input;
  std::vector<LaneRow> data;

  explicit Case(const Kind& kind) {
    for (std::size_t i = 0; i <= kJoints; ++i) {
      input.links.push_back(numbers_of(random_pose(random)));
    }
    input.prismatic = {0, 1, 0};
    input.base = numbers_of(random_pose(random));
    input.flange = numbers_of(Isometry3d(Eigen::Translation3d(random_vector(random))));
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

  // Measured orientations, anywhere.
  void orient(std::size_t n) {
    for (std::size_t k = 0; k < input.oriented.size(); ++k) {
      const FrameNumbers Z = numbers_of(random_pose(random));
      const std::size_t first = input.first_orientation() + kOrientationRows * k;
      for (std::size_t i = 0; i < 9; ++i) {
        set_value(n, first + i, Z[i]);
      }
      set_value(n, first + 9, 0.5 + random.uniform());
    }
  }

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
};

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

class ChainKernels : public ::testing::TestWithParam<Kind> {};

// All sums but the cost.
constexpr std::array kSums = {&ChainKernelSums::gram,     &ChainKernelSums::spread, &ChainKernelSums::gradient,
                              &ChainKernelSums::coupling, &ChainKernelSums::turned, &ChainKernelSums::force,
                              &ChainKernelSums::weights};

void expect_near(const std::vector<double>& found, const std::vector<double>& expected) {
  ASSERT_EQ(found.size(), expected.size());
  double largest = 0.0;
  for (const double value : expected) {
    largest = std::max(largest, std::abs(value));
  }
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_NEAR(found[i], expected[i], 1e-12 * largest) << i;
  }
}

// What the sums are is tested where they are used, in least_squares_test.
TEST_P(ChainKernels, SumsOfAllConfigurationsAreThoseOfTheirParts) {
  const Case c(GetParam());
  for (const InstructionSet set : instruction_sets()) {
    ChainKernelSums whole;
    sum_chain(c.input, false, whole, set);
    ChainKernelSums parts;
    for (std::size_t first = 0; first < Case::kConfigurations; first += 4 * kLanes) {
      ChainKernelInput part = c.input;
      part.data = c.data.data() + first / kLanes * c.input.rows();
      part.configurations = std::min<std::size_t>(4 * kLanes, Case::kConfigurations - first);
      ChainKernelSums sums;
      sum_chain(part, false, sums, set);
      if (first == 0) {
        parts = sums;
        continue;
      }
      parts.cost += sums.cost;
      for (const auto sum : kSums) {
        ASSERT_EQ((parts.*sum).size(), (sums.*sum).size());
        std::transform((parts.*sum).begin(), (parts.*sum).end(), (sums.*sum).begin(), (parts.*sum).begin(),
                       std::plus<>());
      }
    }
    EXPECT_NEAR(parts.cost, whole.cost, 1e-12 * whole.cost);
    for (const auto sum : kSums) {
      expect_near(parts.*sum, whole.*sum);
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
    for (const auto sum : kSums) {
      EXPECT_EQ(sums.*sum, baseline.*sum);
    }
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
}  // namespace kdl_calibration::chain_kernel_test
