#include "robot/fixed_frame.hpp"

#include <urdf_model/model.h>

#include "robot/urdf_model.hpp"
#include "robot/urdf_reading.hpp"

namespace kdl_calibration {
namespace {

// The last link from which fixed joints lead to a link, and the link's frame there.
struct Fixed {
  std::string root;
  KDL::Frame frame;
};

Fixed fixed_to(urdf::LinkConstSharedPtr link) {
  KDL::Frame frame;
  while (link->parent_joint && link->parent_joint->type == urdf::Joint::FIXED) {
    frame = to_kdl(link->parent_joint->parent_to_joint_origin_transform) * frame;
    link = link->getParent();
  }
  return {.root = link->name, .frame = frame};
}

}  // namespace

std::optional<KDL::Frame> fixed_frame(const Robot& robot, const std::string& from, const std::string& link) {
  const urdf::ModelInterfaceSharedPtr model = parse_model(robot.urdf, robot.source);
  const urdf::LinkConstSharedPtr first = model->getLink(from);
  const urdf::LinkConstSharedPtr second = model->getLink(link);
  if (!first || !second) {
    return std::nullopt;
  }
  const Fixed a = fixed_to(first);
  const Fixed b = fixed_to(second);
  return a.root == b.root ? std::optional<KDL::Frame>(a.frame.Inverse() * b.frame) : std::nullopt;
}

}  // namespace kdl_calibration
