#include "chain_kernel.hpp"

namespace kdl_calibration {

// The same source for every instruction set: without fused multiplication and addition the results are the same.
namespace baseline {
#include "chain_kernel_body.hpp"
}  // namespace baseline

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define KDL_CALIBRATION_WIDE_KERNELS
#pragma GCC push_options
#pragma GCC target("avx2")
namespace avx2 {
#include "chain_kernel_body.hpp"
}  // namespace avx2
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,prefer-vector-width=512")
namespace avx512 {
#include "chain_kernel_body.hpp"
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

void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums) {
#ifdef KDL_CALIBRATION_WIDE_KERNELS
  static const bool has_avx512 =
      __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  static const bool has_avx2 = __builtin_cpu_supports("avx2");
  if (has_avx512) {
    avx512::sum(input, cost_only, sums);
    return;
  }
  if (has_avx2) {
    avx2::sum(input, cost_only, sums);
    return;
  }
#endif
  baseline::sum(input, cost_only, sums);
}

}  // namespace kdl_calibration
