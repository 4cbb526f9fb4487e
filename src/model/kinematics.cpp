#include "model/kinematics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "model/error_chains.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {

Eigen::Matrix3d z_onto(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
  if (axis.z() < -0.55) {  // half a turn about x first, so that the remaining angle stays away from pi
    const Eigen::Matrix3d flip = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    return flip * z_onto(flip * axis);
  }
  const Eigen::Vector3d v = z.cross(axis);
  const Eigen::Matrix3d k = skew(v);
  return Eigen::Matrix3d::Identity() + k + k * k / (1.0 + axis.z());
}

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d result;
  result << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return result;
}

Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& v) {
  const double angle = v.norm();
  if (angle == 0.0) {
    return Eigen::Matrix3d::Identity();
  }
  return Eigen::AngleAxisd(angle, v / angle).toRotationMatrix();
}

Eigen::Vector3d rotation_log(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd rotation(R);
  return rotation.angle() * rotation.axis();
}

FoldedChain folded(const ErrorModel& model, const Eigen::VectorXd& errors) {
  FoldedChain chain;
  Eigen::Matrix3d turn_back = Eigen::Matrix3d::Identity();  // undoes the alignment of the previous joint
  for (std::size_t i = 0; i <= model.joints.size(); ++i) {
    const bool tip = i == model.joints.size();
    const KDL::Frame& origin = tip ? model.tip_origin : model.joints[i].origin;
    Eigen::Isometry3d link = to_eigen(origin * frame_correction(model, errors, static_cast<int>(i)));
    link = turn_back * link;
    if (!tip) {
      const Eigen::Matrix3d turn = z_onto(to_eigen(model.joints[i].axis));
      link.linear() = link.linear() * turn;
      turn_back = turn.transpose();
      chain.prismatic.push_back(model.joints[i].type == JointType::prismatic);
      chain.stretches.push_back(link_before(model, i).stableNormalized());
    }
    chain.links.push_back(link);
  }
  return chain;
}

std::vector<ParameterTwist> parameter_twists(const ErrorModel& model, const Eigen::VectorXd& errors,
                                             const std::vector<std::size_t>& which) {
  const std::vector<ChainFactor> factors = chain_factors(model);
  const auto joints = static_cast<int>(model.joints.size());
  std::vector<ParameterTwist> all(model.parameters.size());
  int frame = -1;
  Eigen::Isometry3d behind;  // the joint frame in the frame after the factor
  for (std::size_t i = factors.size(); i-- > 0;) {
    const ChainFactor& factor = factors[i];
    if (factor.source != ChainFactor::Source::parameter) {
      continue;
    }
    const ErrorParameter& parameter = model.parameters[factor.index];
    if (parameter.frame != frame) {
      frame = parameter.frame;
      behind = Eigen::Isometry3d::Identity();
      behind.translation() = -to_eigen(pivot_of(model, frame));
      if (frame < joints) {
        behind.linear() = z_onto(to_eigen(model.joints[static_cast<std::size_t>(frame)].axis));
      }
    }
    const Eigen::Vector3d axis = to_eigen(factor.motion.JointAxis());
    const Eigen::Matrix3d turned = behind.linear().transpose();
    ParameterTwist& twist = all[factor.index];
    twist.frame = frame;
    if (factor.motion.getType() == KDL::Joint::TransAxis) {
      twist.linear = turned * axis;
    } else {
      twist.linear = turned * axis.cross(behind.translation());
      twist.angular = turned * axis;
    }
    behind = to_eigen(factor.motion.pose(errors[static_cast<Eigen::Index>(factor.index)])) * behind;
  }
  std::vector<ParameterTwist> twists;
  twists.reserve(which.size());
  for (const std::size_t p : which) {
    twists.push_back(all[p]);
  }
  return twists;
}

Eigen::Vector3d link_before(const ErrorModel& model, std::size_t joint) {
  const Eigen::Vector3d link = to_eigen(model.joints[joint].origin.p);
  return joint == 0 ? link : Eigen::Vector3d(z_onto(to_eigen(model.joints[joint - 1].axis)).transpose() * link);
}

ChainFolder::ChainFolder(const ErrorModel& model, const std::vector<std::size_t>& which) {
  frames_.resize(model.joints.size() + 1);
  shape_.links.resize(frames_.size());
  Eigen::Matrix3d turn_back = Eigen::Matrix3d::Identity();
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const bool tip = i == model.joints.size();
    frames_[i].origin = turn_back * to_eigen(tip ? model.tip_origin : model.joints[i].origin);
    frames_[i].pivot = to_eigen(pivot_of(model, static_cast<int>(i)));
    if (!tip) {
      frames_[i].turn = z_onto(to_eigen(model.joints[i].axis));
      turn_back = frames_[i].turn.transpose();
      shape_.prismatic.push_back(model.joints[i].type == JointType::prismatic);
      shape_.stretches.push_back(link_before(model, i).stableNormalized());
    }
  }
  for (const bool offsets : {false, true}) {  // the order of chain_factors
    for (std::size_t p = 0; p < model.parameters.size(); ++p) {
      const ErrorParameter& parameter = model.parameters[p];
      if ((parameter.kind == ParameterKind::joint_offset) != offsets) {
        continue;
      }
      const auto found = std::find(which.begin(), which.end(), p);
      frames_[static_cast<std::size_t>(parameter.frame)].factors.push_back(
          {.parameter = static_cast<Eigen::Index>(p),
           .axis = to_eigen(parameter_axis(model, parameter)),
           .translation = is_length(model, parameter),
           .column = found == which.end() ? -1 : static_cast<int>(found - which.begin())});
    }
  }
}

void ChainFolder::fold(const Eigen::VectorXd& errors, FoldedChain& chain, std::vector<ParameterTwist>& twists,
                       std::size_t first) const {
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    Eigen::Matrix3d R = frames_[i].turn;  // with p: the joint frame in the frame after the factor
    Eigen::Vector3d p = -frames_[i].pivot;
    for (auto factor = frames_[i].factors.rbegin(); factor != frames_[i].factors.rend(); ++factor) {
      const Eigen::Vector3d& axis = factor->axis;
      if (factor->column >= 0) {
        const std::size_t place = first + static_cast<std::size_t>(factor->column);
        ParameterTwist& twist = twists[place];
        const Eigen::Vector3d turned = R.transpose() * axis;
        twist.frame = static_cast<int>(i);
        twist.linear = factor->translation ? turned : Eigen::Vector3d(R.transpose() * axis.cross(p));
        twist.angular = factor->translation ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : turned;
      }
      const double value = errors[factor->parameter];
      if (value == 0.0) {
        continue;
      }
      if (factor->translation) {
        p += value * axis;
      } else {
        const Eigen::Matrix3d motion = Eigen::AngleAxisd(value, axis).toRotationMatrix();
        R = motion * R;
        p = motion * p;
      }
    }
    chain.links[i].linear().noalias() = frames_[i].origin.linear() * R;
    chain.links[i].translation() =
        frames_[i].origin.linear() * (p + frames_[i].pivot) + frames_[i].origin.translation();
  }
}

std::vector<ParameterTwist> base_twists() {
  std::vector<ParameterTwist> twists(6);
  for (int axis = 0; axis < 3; ++axis) {
    twists[static_cast<std::size_t>(axis)] = {.frame = -1, .linear = Eigen::Vector3d::Unit(axis)};
    twists[static_cast<std::size_t>(axis) + 3] = {.frame = -1, .angular = Eigen::Vector3d::Unit(axis)};
  }
  return twists;
}

namespace {

// The rows of [R | p]: multiplication from the left combines whole rows.
class PoseRows {
public:
  explicit PoseRows(const Eigen::Isometry3d& pose) {
    for (Eigen::Index row = 0; row < 3; ++row) {
      rows_[static_cast<std::size_t>(row)] = pose.matrix().row(row).transpose();
    }
  }

  Eigen::Isometry3d pose() const {
    Eigen::Isometry3d result;
    result.matrix() << rows_[0].transpose(), rows_[1].transpose(), rows_[2].transpose(), 0.0, 0.0, 0.0, 1.0;
    return result;
  }

  Eigen::Vector3d position() const { return {rows_[0][3], rows_[1][3], rows_[2][3]}; }
  /// R^T v.
  Eigen::Vector3d turned_back(const Eigen::Vector3d& v) const {
    return (v[0] * rows_[0] + v[1] * rows_[1] + v[2] * rows_[2]).head<3>();
  }

  void put_in_front(const Eigen::Isometry3d& link) {
    const auto& L = link.matrix();
    const std::array<Eigen::Vector4d, 3> old = rows_;
    for (Eigen::Index row = 0; row < 3; ++row) {
      Eigen::Vector4d& mixed = rows_[static_cast<std::size_t>(row)];
      mixed = L(row, 0) * old[0] + L(row, 1) * old[1] + L(row, 2) * old[2];
      mixed[3] += L(row, 3);
    }
  }

  /// A joint's motion about or along z.
  void move(const Eigen::Ref<const Eigen::VectorXd>& q, std::size_t joint, bool prismatic) {
    const double value = q[static_cast<Eigen::Index>(joint)];
    if (prismatic) {
      rows_[2][3] += value;
    } else {
      turn(value, rows_[0], rows_[1]);
    }
  }
  /// Its tilts Rx Ry, if `q` has more entries than `joints`.
  void tilt(const Eigen::Ref<const Eigen::VectorXd>& q, std::size_t joint, std::size_t joints) {
    const auto first = static_cast<Eigen::Index>(joints + 2 * joint);
    if (q.size() > first) {
      turn(q[first + 1], rows_[2], rows_[0]);
      turn(q[first], rows_[1], rows_[2]);
    }
  }
  /// The expansion of the link before it, if `q` has entries for it.
  void stretch(const Eigen::Ref<const Eigen::VectorXd>& q, std::size_t joint, const FoldedChain& chain) {
    const auto entry = static_cast<Eigen::Index>(3 * chain.prismatic.size() + joint);
    for (std::size_t row = 0; row < 3 && q.size() > entry; ++row) {
      rows_[row][3] += q[entry] * chain.stretches[joint][static_cast<Eigen::Index>(row)];
    }
  }

private:
  // A rotation that turns the coordinate axis of one row towards another's.
  static void turn(double angle, Eigen::Vector4d& from, Eigen::Vector4d& to) {
    const double s = std::sin(angle);
    const double c = std::cos(angle);
    const Eigen::Vector4d row = from;
    from = c * row - s * to;
    to = s * row + c * to;
  }

  std::array<Eigen::Vector4d, 3> rows_;
};

}  // namespace

Eigen::Isometry3d flange_pose(const FoldedChain& chain, const Eigen::Ref<const Eigen::VectorXd>& q) {
  PoseRows pose(chain.links.back());
  for (std::size_t i = chain.prismatic.size(); i-- > 0;) {
    pose.move(q, i, chain.prismatic[i]);
    pose.tilt(q, i, chain.prismatic.size());
    pose.put_in_front(chain.links[i]);
    pose.stretch(q, i, chain);
  }
  return pose.pose();
}

std::vector<Eigen::Isometry3d> flange_poses(const FoldedChain& chain, const Eigen::MatrixXd& joint_values) {
  std::vector<Eigen::Isometry3d> poses(static_cast<std::size_t>(joint_values.cols()));
  for (Eigen::Index c = 0; c < joint_values.cols(); ++c) {
    poses[static_cast<std::size_t>(c)] = flange_pose(chain, joint_values.col(c));
  }
  return poses;
}

Eigen::Isometry3d flange_jacobian(const FoldedChain& chain, const std::vector<ParameterTwist>& twists,
                                  const Eigen::Ref<const Eigen::VectorXd>& q, Matrix6Xd& jacobian) {
  jacobian.resize(6, static_cast<Eigen::Index>(twists.size()));
  PoseRows pose(Eigen::Isometry3d::Identity());  // of the flange in the frame reached so far
  const auto write_columns = [&](int frame, bool tilted) {
    for (std::size_t t = 0; t < twists.size(); ++t) {
      const ParameterTwist& twist = twists[t];
      if (twist.frame == frame && twist.tilted == tilted) {
        auto column = jacobian.col(static_cast<Eigen::Index>(t));
        column.head<3>() = pose.turned_back(twist.linear + twist.angular.cross(pose.position()));
        column.tail<3>() = pose.turned_back(twist.angular);
      }
    }
  };
  const auto joints = static_cast<int>(chain.prismatic.size());
  write_columns(joints, false);
  pose.put_in_front(chain.links.back());
  for (int i = joints - 1; i >= 0; --i) {
    const auto joint = static_cast<std::size_t>(i);
    pose.move(q, joint, chain.prismatic[joint]);
    write_columns(i, true);
    pose.tilt(q, joint, chain.prismatic.size());
    write_columns(i, false);
    pose.put_in_front(chain.links[joint]);
    pose.stretch(q, joint, chain);
  }
  write_columns(-1, false);
  return pose.pose();
}

}  // namespace kdl_calibration
