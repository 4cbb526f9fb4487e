#include <gtest/gtest.h>

#include <clocale>
#include <functional>
#include <locale>
#include <nlohmann/json.hpp>

#include "german_locale.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "kdl_calibration/result_json.hpp"
#include "kdl_calibration/result_table.hpp"
#include "kdl_calibration/simulation.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::locale_test {
namespace {

/// A program under a German locale: both C's locale, which strtod and printf follow, and the streams'.
class UnderAComma {
public:
  explicit UnderAComma(const GermanLocaleFolder& german) {
    ::setenv("LOCPATH", german.path().c_str(), 1);
    before_ = std::locale::global(std::locale("de_DE"));
  }
  ~UnderAComma() {
    std::locale::global(before_);
    std::setlocale(LC_ALL, "C");
    ::unsetenv("LOCPATH");
  }
  UnderAComma(const UnderAComma&) = delete;
  UnderAComma& operator=(const UnderAComma&) = delete;

private:
  std::locale before_;
};

/// Everything that the library reads and writes, as one text.
std::string everything() {
  const Robot odd = parse_robot(kOddArm);
  const ErrorModel odd_model = complete_model(odd);
  Random random(7);
  std::string text = calibrated_urdf(odd, odd_model, random_errors(odd_model, random, 1.25e-3, 2.5e-3));
  const Robot again = parse_robot(text);
  for (const MovingJoint& joint : again.joints) {
    text += nlohmann::json(joint.origin.p.x()).dump() + nlohmann::json(joint.lower.value_or(1.5)).dump();
  }

  const Robot robot = fanuc();
  const ErrorModel model = complete_model(robot);
  const JointConvention convention = read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json");
  text += nlohmann::json(convention.matrix(2, 1)).dump();
  VirtualExperiment experiment({.model = model, .with_errors = {{6, 7, 8}}, .sizes = {}, .random = random});
  const Measurements measurements = experiment.measure(15, {.sigma = 1e-5});
  const std::string csv = measurements_csv(measurements);
  const Measurements read = parse_measurements(csv, joint_names(robot));
  const CalibrationOptions options;
  const Calibration found = calibrate(model, read, options);
  text += csv + result_table(read, found) + calibrated_urdf(robot, model, found.exported.estimate.errors);
  const std::string json = result_json(robot, read, options, found);
  text += json + nlohmann::json::parse(json).dump();
  text += testing::refusal(
      [&] { parse_measurements("configuration,target,turn,x,y,z,qw,qx,qy,qz\n1,A,0,0,0,0,1.5,0,0,0\n", {"turn"}); });
  return text;
}

TEST(Locale, OfTheProgramChangesNoByte) {
  const GermanLocaleFolder german;
  if (!german) {
    GTEST_SKIP() << "no locale with a decimal comma: localedef cannot make it here";
  }
  const std::string plain = everything();
  std::string comma;
  {
    const UnderAComma under(german);
    ASSERT_EQ(std::localeconv()->decimal_point, std::string(","));
    ASSERT_EQ(std::use_facet<std::numpunct<char>>(std::locale()).decimal_point(), ',');
    comma = everything();
  }
  EXPECT_EQ(plain, comma);
}

}  // namespace
}  // namespace kdl_calibration::testing::locale_test
