#include "calibration/option_check.hpp"

#include <gmock/gmock.h>

#include <cmath>

#include "calibration/calibration_settings.hpp"
#include "refusal.hpp"

namespace kdl_calibration::option_check_test {
namespace {

using ::testing::HasSubstr;

const double kNone = std::nan("");

/// Two joints in three configurations, each with a torque of both.
struct Setting {
  Measurements measured;
  CalibrationSettings options;

  Setting() {
    measured.source = "points.csv";
    measured.joints = {"shoulder", "elbow"};
    measured.configurations = {"a", "b", "c"};
    measured.joint_values = Eigen::MatrixXd::Zero(2, 3);
    measured.signals.torques = Eigen::MatrixXd::Ones(2, 3);
    options.selection.effects.groups = {EffectGroup::gravity, EffectGroup::torque};
    options.predict_at = {.names = {"p", "q"}, .joint_values = Eigen::MatrixXd::Zero(2, 2), .signals = {}};
    options.predict_at.signals.torques = Eigen::MatrixXd::Ones(2, 2);
  }

  std::string refused() const {
    return testing::refusal([&] { require_signals(measured, options); });
  }
};

TEST(OptionCheck, EveryConfigurationHasTheTorquesThatAnyHas) {
  EXPECT_EQ(Setting().refused(), "nothing was refused");
  for (const auto& [joint, name] : {std::pair{0, "shoulder"}, std::pair{1, "elbow"}}) {
    for (const auto& [column, configuration] : {std::pair{0, "a"}, std::pair{2, "c"}}) {
      Setting s;
      s.measured.signals.torques(joint, column) = kNone;
      EXPECT_THAT(s.refused(), HasSubstr(std::string("points.csv: configuration '") + configuration +
                                         "' has no torque of " + name + ", expected one in each"));
    }
    Setting there;
    there.options.predict_at.signals.torques(joint, 1) = kNone;
    EXPECT_THAT(there.refused(), HasSubstr(std::string("configuration 'q' has no torque of ") + name));
    Setting nobody;  // measured one of this joint
    nobody.measured.signals.torques.row(joint).setConstant(kNone);
    nobody.options.predict_at.signals.torques.row(joint).setConstant(kNone);
    EXPECT_EQ(nobody.refused(), "nothing was refused");
  }
  Setting unnamed;
  unnamed.measured.joints.clear();
  unnamed.measured.signals.torques(1, 1) = kNone;
  EXPECT_THAT(unnamed.refused(), HasSubstr("configuration 'b' has no torque of joint number 2,"));
  Setting without;
  without.options.predict_at.signals.torques.resize(0, 0);
  EXPECT_THAT(without.refused(), HasSubstr("configuration 'p' has no torque of shoulder"));
}

TEST(OptionCheck, TorquesAreNeededOnlyForTheirEffect) {
  Setting s;
  s.measured.signals.torques.setConstant(kNone);
  EXPECT_THAT(s.refused(), HasSubstr("effects: torque needs measured torques, expected columns tau_<joint>"));
  s.measured.signals.torques.resize(0, 0);
  EXPECT_THAT(s.refused(), HasSubstr("effects: torque needs measured torques"));
  s.options.selection.effects.groups = {EffectGroup::gravity};
  EXPECT_EQ(s.refused(), "nothing was refused");
  s.options.predict_at.signals.torques.resize(1, 2);
  EXPECT_THAT(s.refused(), HasSubstr("to predict at"));
}

}  // namespace
}  // namespace kdl_calibration::option_check_test
