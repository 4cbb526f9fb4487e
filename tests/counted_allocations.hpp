#pragma once

// Counts the calls of malloc, through which both Eigen and operator new go. For one source of a program. Left out under
// sanitizers, which bring a malloc of their own.

#include <cstddef>

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(__clang__)

namespace {
thread_local long allocations = 0;
}  // namespace

extern "C" {
void* __libc_malloc(std::size_t size);
void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
}
#define KDL_CALIBRATION_COUNTS_ALLOCATIONS
#endif
