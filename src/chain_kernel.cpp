#include "chain_kernel.hpp"

namespace kdl_calibration {

// The same source for every instruction set: without fused multiplication and addition the results are the same.
namespace baseline {
#define KDL_CALIBRATION_AT_ONCE 2
#include "chain_kernel_body.hpp"
#undef KDL_CALIBRATION_AT_ONCE
}  // namespace baseline

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define KDL_CALIBRATION_WIDE_KERNELS
#pragma GCC push_options
#pragma GCC target("avx2")
namespace avx2 {
#define KDL_CALIBRATION_AT_ONCE 4
#include "chain_kernel_body.hpp"
#undef KDL_CALIBRATION_AT_ONCE
}  // namespace avx2
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,prefer-vector-width=512")
namespace avx512 {
#define KDL_CALIBRATION_AT_ONCE 8
#include "chain_kernel_body.hpp"
#undef KDL_CALIBRATION_AT_ONCE
}  // namespace avx512
#pragma GCC pop_options
#endif

void ChainKernelSums::reset(std::size_t joints, std::size_t columns, std::size_t points) {
  gram.assign(columns * (columns + 1) / 2 + 1, {});
  gradient.assign(columns + 1, {});
  twist.assign(6 * columns + 1, {});
  force.assign(3 * points, {});
  cost = {};
  poses.resize(15 * (joints + 2));
  jacobian.resize(6 * columns + 1);
}

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

void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums) {
  static const InstructionSet widest = instruction_sets().back();
  sum_chain(input, cost_only, sums, widest);
}

void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums, InstructionSet set) {
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
