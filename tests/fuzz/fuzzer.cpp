#include <cstddef>
#include <cstdint>

#include "targets.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  kdl_calibration::fuzzing::KDL_CALIBRATION_FUZZ_TARGET({reinterpret_cast<const char*>(data), size});
  return 0;
}
