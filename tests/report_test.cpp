#include "kdl_calibration/report.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "kdl_calibration/deflection.hpp"
#include "kdl_calibration/simulation.hpp"
#include "printed_text.hpp"
#include "support.hpp"

namespace kdl_calibration {
namespace {

using testing::decimals;
using testing::fanuc;
using testing::kOddArm;
using testing::squeezed;

// ---- units of the table --------------------------------------------------------------------------------------------

/// A calibration of which nothing is known but one estimated parameter, with this error and 1 sigma.
Calibration with_one_parameter(const ErrorModel& model, const std::string& name, double error, double std) {
  Calibration calibration;
  calibration.model = model;
  calibration.parameters.push_back({.name = name, .joint = "j", .error = error, .std = std, .identifiable = true});
  return calibration;
}

std::string line_of(const Calibration& calibration, const std::string& name) {
  for (const std::string& line : testing::lines_of(result_table({}, calibration))) {
    if (squeezed(line).rfind(name + " ", 0) == 0) {
      return squeezed(line);
    }
  }
  return "no line of " + name;
}

TEST(ReportUnits, EachParameterIsPrintedInTheUnitOfItsKind) {
  ErrorModel model = complete_model(parse_robot(kOddArm));
  model.deflections = gain_deflections(model);
  model.deflections.push_back({.name = "gravity1_6", .joint = "turn", .index = 0, .masses = {}});
  model.deflections.push_back({.name = "gravity2_6", .joint = "slide", .index = 1, .masses = {}});
  const double degree = std::numbers::pi / 180.0;
  struct Case {
    const char* name;
    double per_unit;  // SI
    const char* printed;
  };
  // Joint 2 is prismatic; gains have no dimension on any joint.
  for (const Case& c :
       {Case{"dq1", degree, "1.25000 deg +- 0.50000"}, Case{"dq2", 1e-3, "1.2500 mm +- 0.5000"},
        Case{"dq3", degree, "1.25000 deg +- 0.50000"}, Case{"Tx1", 1e-3, "1.2500 mm +- 0.5000"},
        Case{"Ry3", degree, "1.25000 deg +- 0.50000"}, Case{"gain1", 1e-2, "1.25000 % +- 0.50000"},
        Case{"gain2", 1e-2, "1.25000 % +- 0.50000"}, Case{"gravity1_6", degree, "1.25000 deg +- 0.50000"},
        Case{"gravity2_6", 1e-3, "1.2500 mm +- 0.5000"}}) {
    const Calibration found = with_one_parameter(model, c.name, 1.25 * c.per_unit, 0.5 * c.per_unit);
    EXPECT_EQ(line_of(found, c.name), std::string(c.name) + " j " + c.printed);
  }
}

}  // namespace
}  // namespace kdl_calibration
