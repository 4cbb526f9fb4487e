#include "diagnosis/gain_trial.hpp"

#include <cmath>
#include <vector>

#include "diagnosis/trial_fit.hpp"
#include "effects/effect_terms.hpp"

namespace kdl_calibration {

using Eigen::Index;

std::optional<GainTrial> try_gains(const ErrorModel& model, const Measurements& measurements, const Estimate& start,
                                   const Unknowns& free) {
  ErrorModel wide = model;
  wide.effects = gain_terms(model);
  Estimate from = start;
  from.effects = Eigen::VectorXd::Zero(static_cast<Index>(wide.effects.size()));
  const Unknowns rigid = free.without(UnknownGroup::effects);
  const Estimate without = identify_jointly(wide, measurements, from, rigid).estimate;
  const Estimate with =
      identify_jointly(wide, measurements, from, rigid.with_group(wide, UnknownGroup::effects)).estimate;
  Index largest = 0;
  if (wide.effects.empty() || !plausible(wide, with.errors) || !(with.effects.cwiseAbs().maxCoeff(&largest) > 0.0)) {
    return std::nullopt;
  }
  GainTrial result{.joint = static_cast<std::size_t>(wide.effects[static_cast<std::size_t>(largest)].index),
                   .factor = 1.0 + with.effects[largest],
                   .rms = rms_of(wide, measurements, with),
                   .rms_rigid = std::min(rms_of(wide, measurements, from), rms_of(wide, measurements, without))};
  result.others = static_cast<int>((with.effects.array().abs() > kLeastWrongGain).count()) - 1;
  return result;
}

}  // namespace kdl_calibration
