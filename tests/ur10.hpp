#pragma once

// A UR10 as the description of Universal Robots has it, and a calibration of one.

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

/// Values that an owner of such a robot published:
/// https://forum.universal-robots.com/t/calibrated-kinamatics-info/18921
inline constexpr const char* kUrCalibration = R"([mounting]
delta_theta = [ -8.20642406610186392e-05, -0.103609197138685979, 0.673631891251821102, -0.57016974724960845, -4.59636351675856217e-05, 9.74999561134540574e-07]
delta_a = [ -0.000161187342296687116, 0.00304003843792177708, 0.0916468555721788314, -9.62964975953143595e-05, -2.97595340762196176e-05, 0]
delta_d = [ 0.000505390894843998906, 11.1984514757821039, -92.5270326908668181, 81.3282683520703529, -0.000212852818740727479, -0.000126145560998547346]
delta_alpha = [ -0.00032142399895862539, -0.00565024518540147101, -0.00378922621833689211, -0.00106533274011644252, 0.000999586303470856308, 0]
joint_checksum = [ 0x6e0f7bf, 0xa32a713f, 0xf636a50, 0x9ec2338a, 0xa1afded8, 0xb29b2979]
calibration_status = 2 # 0 == notInitialized / 1 == notLinearised / 2 == Linearised
)";

}  // namespace kdl_calibration::testing
