#include "cli/cures.hpp"

namespace kdl_calibration::cli {

std::string plan_to_add(bool stations) {
  return stations ? "kdlcal plan --stations N, with --sockets or --directions as measured,"
                  : "kdlcal plan --measured FILE --add N";
}

std::map<Cause, std::string> cures(bool stations) {
  const std::string plan = plan_to_add(stations);
  const std::string convention = "--joint-convention says how to read the joint values";
  return {{Cause::not_converged, "--iterations sets their number"},
          {Cause::not_determined, plan + " chooses them"},
          {Cause::unknown_length, plan + " chooses them, --fix and --prior-length hold"},
          {Cause::joint_convention, convention},
          {Cause::joint_sign, convention},
          {Cause::joint_unit, convention},
          {Cause::joint_columns, convention}};
}

}  // namespace kdl_calibration::cli
