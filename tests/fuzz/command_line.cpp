#include <sstream>

#include "cli/cell_options.hpp"
#include "cli/config_file.hpp"
#include "cli/frames.hpp"
#include "effects/arm_kinematics.hpp"
#include "promise.hpp"
#include "results/saved_calibration.hpp"
#include "targets.hpp"

namespace kdl_calibration::fuzzing {
namespace {

constexpr const char* kTwoJoints = R"(<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
  <joint name="j1" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
  <joint name="j2" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.5 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>)";

}  // namespace

void json_inputs(std::string_view bytes) {
  static const Robot robot = parse_robot(kTwoJoints);
  static const ErrorModel model = complete_model(robot);
  let_input_errors_pass([&] {
    const cli::Json json = cli::json_of(bytes, "input.json");
    let_input_errors_pass([&] {
      const Eigen::Isometry3d base = cli::base_of(json, "input.json");
      promise(base.matrix().allFinite(), "a finite base");
      promise((base.linear() * base.linear().transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-12, "a rotation");
      static_cast<void>(cli::json_text(cli::frame_json(base)));
    });
    let_input_errors_pass([&] {
      const cli::FacingTargets read = cli::facing_targets_of(json, "input.json");
      promise(!read.targets.empty() && read.targets.size() == read.facing.size(), "a direction for each");
      for (std::size_t i = 0; i < read.targets.size(); ++i) {
        promise(read.targets[i].X_FT.matrix().allFinite() && read.facing[i].allFinite(), "finite targets");
        static_cast<void>(cli::json_text(cli::target_json(read.targets[i])));
      }
    });
    let_input_errors_pass([&] { cli::require_same_nominal(json, "input.json", model); });
    let_input_errors_pass([&] {
      const CalibrationParts saved = parse_calibration(bytes, robot, "input.json");
      promise(saved.estimate.errors.allFinite(), "finite errors of the parameters");
      promise(static_cast<std::size_t>(saved.estimate.effects.size()) == saved.model.effects.size(),
              "one value a term");
      const ArmKinematics arm(saved.model, saved.estimate.errors, saved.estimate.effects);
      static_cast<void>(arm.flange_pose(Eigen::Vector2d(0.3, -0.2)));
    });
  });
}

void config_file(std::string_view bytes) {
  static CLI::App parser;
  static std::vector<std::string> joints;
  static std::string output;
  if (parser.get_config_ptr() == nullptr) {
    parser.set_config("--config");
    parser.add_subcommand("fk")->add_option("--joints", joints)->delimiter(',');
    parser.add_subcommand("plan")->add_option("--output", output);
  }
  std::istringstream stream{std::string(bytes)};
  try {
    for (const CLI::ConfigItem& item : cli::ConfigFile(parser).from_config(stream)) {
      promise(!item.name.empty(), "an option with a name");
    }
  } catch (const InputError&) {  // its control characters are taken away where it is printed
  } catch (const CLI::Error&) {
  }
}

}  // namespace kdl_calibration::fuzzing
