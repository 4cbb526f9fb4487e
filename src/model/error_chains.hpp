#pragma once

// The chain of a model as a product of factors, and KDL chains of it. Indices in the model must be sound.

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <kdl/chain.hpp>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

/// The point about which the errors in this frame act.
KDL::Vector pivot_of(const ErrorModel& model, int frame);

/// E · Rot(dq) in the frame of joint `frame` (of the tip for frame = number of joints): the factor to the right of the
/// nominal origin. `errors` has one value per parameter of the model.
KDL::Frame frame_correction(const ErrorModel& model, const Eigen::VectorXd& errors, int frame);

/// One factor of the product that complete_model describes: a fixed frame, or a motion along an axis of its own frame
/// by the value of a joint or of a parameter.
struct ChainFactor {
  enum class Source : std::uint8_t { fixed, joint, parameter };
  Source source = Source::fixed;
  std::size_t index = 0;  ///< of the joint or the parameter
  std::string name;
  KDL::Frame frame;                      ///< if fixed
  KDL::Joint motion{KDL::Joint::Fixed};  ///< if it moves
};

/// All factors from base to tip.
std::vector<ChainFactor> chain_factors(const ErrorModel& model);

/// The chain with as few segments as moving joints (and one for the tip): nominal offsets and errors multiplied out.
KDL::Chain folded_chain(const ErrorModel& model, const Eigen::VectorXd& errors);

}  // namespace kdl_calibration
