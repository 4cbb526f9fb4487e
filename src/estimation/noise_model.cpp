#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

bool NoiseModel::is_alike_in_every_direction() const {
  return independent.isConstant(independent.x(), 0.0) && common.isConstant(common.x(), 0.0) && !tracker;
}

bool NoiseModel::is_isotropic() const { return is_alike_in_every_direction() && common.isZero(0.0) && !has_misfit(); }

}  // namespace kdl_calibration
