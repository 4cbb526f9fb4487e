#pragma once

// A UR10 as the description of Universal Robots has it.

namespace kdl_calibration::testing {

inline constexpr const char* kUr10 = R"(<robot name="ur10">
  <link name="base_link"/><link name="base_link_inertia"/><link name="shoulder_link"/><link name="upper_arm_link"/>
  <link name="forearm_link"/><link name="wrist_1_link"/><link name="wrist_2_link"/><link name="wrist_3_link"/>
  <link name="flange"/><link name="tool0"/>
  <joint name="base_link-base_link_inertia" type="fixed"><parent link="base_link"/><child link="base_link_inertia"/>
    <origin xyz="0 0 0" rpy="0 0 3.141592653589793"/></joint>
  <joint name="shoulder_pan_joint" type="continuous"><parent link="base_link_inertia"/><child link="shoulder_link"/>
    <origin xyz="0 0 0.1273" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="shoulder_lift_joint" type="continuous"><parent link="shoulder_link"/><child link="upper_arm_link"/>
    <origin xyz="0 0 0" rpy="1.570796327 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow_joint" type="continuous"><parent link="upper_arm_link"/><child link="forearm_link"/>
    <origin xyz="-0.612 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="wrist_1_joint" type="continuous"><parent link="forearm_link"/><child link="wrist_1_link"/>
    <origin xyz="-0.5723 0 0.163941" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="wrist_2_joint" type="continuous"><parent link="wrist_1_link"/><child link="wrist_2_link"/>
    <origin xyz="0 -0.1157 -2.373046667922381e-11" rpy="1.570796327 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="wrist_3_joint" type="continuous"><parent link="wrist_2_link"/><child link="wrist_3_link"/>
    <origin xyz="0 0.0922 -1.891053610911353e-11" rpy="1.570796326589793 3.141592653589793 3.141592653589793"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="wrist_3-flange" type="fixed"><parent link="wrist_3_link"/><child link="flange"/>
    <origin xyz="0 0 0" rpy="0 -1.5707963267948966 -1.5707963267948966"/></joint>
  <joint name="flange-tool0" type="fixed"><parent link="flange"/><child link="tool0"/>
    <origin xyz="0 0 0" rpy="1.5707963267948966 0 1.5707963267948966"/></joint>
</robot>)";

}  // namespace kdl_calibration::testing
