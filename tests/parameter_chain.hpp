#pragma once

#include <kdl/chain.hpp>
#include <vector>

#include "model/error_chains.hpp"

namespace kdl_calibration::testing {

/// The chain in which every error parameter is a joint, for KDL's own solvers.
struct ParameterChain {
  KDL::Chain chain;
  std::vector<unsigned> joint_index;      ///< position of the robot's joint i among the chain's joints
  std::vector<unsigned> parameter_index;  ///< position of parameter p among the chain's joints
};

inline ParameterChain parameter_chain(const ErrorModel& model) {
  ParameterChain result;
  result.joint_index.resize(model.joints.size());
  result.parameter_index.resize(model.parameters.size());
  for (const ChainFactor& factor : chain_factors(model)) {
    if (factor.source == ChainFactor::Source::fixed) {
      result.chain.addSegment(KDL::Segment(factor.name, KDL::Joint(KDL::Joint::Fixed), factor.frame));
      continue;
    }
    auto& indices = factor.source == ChainFactor::Source::joint ? result.joint_index : result.parameter_index;
    indices[factor.index] = result.chain.getNrOfJoints();
    result.chain.addSegment(KDL::Segment(factor.name, factor.motion));
  }
  return result;
}

}  // namespace kdl_calibration::testing
