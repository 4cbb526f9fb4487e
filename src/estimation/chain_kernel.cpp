#include "estimation/chain_kernel.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "model/kinematics.hpp"

namespace kdl_calibration {

namespace {

constexpr std::size_t kBlocksInCache = 16;
constexpr std::size_t kMostBlocks = 4;  // blocks accumulated before their products are added to the sums

// The sums besides the cost, in the order of ChainKernelSums::lanes.
constexpr std::array kSummed = {&ChainKernelSums::gradient, &ChainKernelSums::coupling, &ChainKernelSums::force,
                                &ChainKernelSums::turned,   &ChainKernelSums::weights,  &ChainKernelSums::gram,
                                &ChainKernelSums::spread};

// Sums over the lanes of `rows`, which are stored in parts of kAtOnce lanes. Two lanes at a time (parts are even) and
// in an order independent of the parts.
template <std::size_t kAtOnce>
void add_lanes(const std::vector<LaneRow>& rows, ChainKernelSums& sums) {
  using Pair = double __attribute__((vector_size(16)));
  std::array<const double*, kLanes / 2> pairs{};
  for (std::size_t lane = 0; lane < kLanes; lane += 2) {
    pairs[lane / 2] =
        reinterpret_cast<const double*>(rows.data()) + lane / kAtOnce * rows.size() * kAtOnce + lane % kAtOnce;
  }
  std::size_t row = 0;
  const auto next = [&] {
    const auto pair = [&](std::size_t i) { return Pair{pairs[i][row * kAtOnce], pairs[i][row * kAtOnce + 1]}; };
    const Pair sum = (pair(0) + pair(1)) + (pair(2) + pair(3));
    ++row;
    return sum[0] + sum[1];
  };
  sums.cost = next();
  for (const auto part : kSummed) {
    std::generate((sums.*part).begin(), (sums.*part).end(), next);
  }
}

// The rotation vector of a matrix given row by row; the same function for all instruction sets.
void take_rotation_vector(const std::array<double, 9>& R, std::array<double, 3>& vector) {
  Eigen::Map<Eigen::Vector3d>(vector.data()) =
      rotation_log(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data()));
}

}  // namespace

// The same source for every instruction set; without fused multiply-add the results are bitwise equal.
namespace baseline {
#define KDL_CALIBRATION_AT_ONCE 2
#include "estimation/chain_kernel_body.hpp"
#undef KDL_CALIBRATION_AT_ONCE
}  // namespace baseline

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define KDL_CALIBRATION_WIDE_KERNELS
#pragma GCC push_options
#pragma GCC target("avx2")
namespace avx2 {
#define KDL_CALIBRATION_AT_ONCE 4
#include "estimation/chain_kernel_body.hpp"
#undef KDL_CALIBRATION_AT_ONCE
}  // namespace avx2
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,prefer-vector-width=512")
namespace avx512 {
#define KDL_CALIBRATION_AT_ONCE 8
#include "estimation/chain_kernel_body.hpp"
#undef KDL_CALIBRATION_AT_ONCE
}  // namespace avx512
#pragma GCC pop_options
#endif

std::vector<InstructionSet> instruction_sets() {
  std::vector<InstructionSet> sets = {InstructionSet::baseline};
#ifdef KDL_CALIBRATION_WIDE_KERNELS
  if (__builtin_cpu_supports("avx2")) {
    sets.push_back(InstructionSet::avx2);
  }
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
    sets.push_back(InstructionSet::avx512);
  }
#endif
  return sets;
}

void add(const ChainKernelSums& others, ChainKernelSums& sums) {
  sums.cost += others.cost;
  for (const auto part : kSummed) {
    std::transform((sums.*part).begin(), (sums.*part).end(), (others.*part).begin(), (sums.*part).begin(),
                   std::plus<>());
  }
}

void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums) {
  static const InstructionSet widest = instruction_sets().back();
  sum_chain(input, cost_only, sums, widest);
}

void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums, InstructionSet set) {
  const std::size_t joints = input.prismatic.size();
  const std::size_t columns = input.columns.size();
  std::size_t terms = 0;
  for (const ChainMotion& motion : input.motions) {
    terms += motion.free;
  }
  sums.gradient.resize(columns + terms);
  sums.coupling.resize(input.width() * (columns + terms));
  sums.force.resize(3 * (input.targets() + input.oriented.size()));
  sums.turned.resize(input.by_axis() ? 18 : input.own_roots ? root_rows(input.targets(), true) : 0);
  sums.weights.resize(input.oriented.size());
  sums.gram.resize(columns * (columns + 1) / 2);
  sums.spread.resize(terms * columns + terms * (terms + 1) / 2);
  sums.lanes.assign(1 + sums.gradient.size() + sums.coupling.size() + sums.force.size() + sums.turned.size() +
                        sums.weights.size() + sums.gram.size() + sums.spread.size(),
                    {});
  sums.joints.resize(input.entries());
  sums.turns.resize(2 * input.entries());
  sums.poses.resize(15 * ((input.tilts ? 2 : 1) * joints + 2));
  const std::size_t together = input.motions.empty() ? 2 : kMostBlocks;
  sums.jacobian.resize(6 * together * (columns + input.motions.size()));
  sums.forces.resize((1 + input.width()) * together * input.motions.size());
  sums.pulls.resize(input.in_rows() ? 24 * input.targets() : 0);
  sums.turning.resize(input.oriented.size());
  switch (set) {
#ifdef KDL_CALIBRATION_WIDE_KERNELS
    case InstructionSet::avx512:
      avx512::sum(input, cost_only, sums);
      return;
    case InstructionSet::avx2:
      avx2::sum(input, cost_only, sums);
      return;
#endif
    default:
      baseline::sum(input, cost_only, sums);
  }
}

}  // namespace kdl_calibration
