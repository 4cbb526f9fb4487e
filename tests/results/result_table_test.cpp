// The table letter by letter, of a calibration that is made up.

#include "results/result_table.hpp"

#include <gmock/gmock.h>

#include <limits>
#include <regex>

#include "kdl_calibration/joint_convention.hpp"
#include "printed_text.hpp"
#include "support.hpp"

namespace kdl_calibration::result_table_test {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using testing::kDegree;
using ::testing::Not;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The odd arm, of which the slide has a gain.
struct Made {
  Measurements measured;
  CalibrationResult calibration;
  JointConvention convention;
  TableOptions options{
      .written = {"a.urdf", "result.json"}, .fixed = "held by --fix", .convention = nullptr, .details = true};

  Made() {
    CalibrationResult& c = calibration;
    c.model = complete_model(parse_robot(testing::kOddArm));
    c.model.effects = {{.name = "gain.2", .joint = "slide", .index = 1, .function = JointGain{}},
                       {.name = "transverse.4.y.4x",
                        .joint = "elbow",
                        .index = 3,
                        .axis = EffectAxis::across_y,
                        .function = GravityMoment{.link = 3, .axis = 0}}};
    Estimate& estimate = c.fit.identification.estimate;
    estimate.errors = testing::errors_of(c.model);
    estimate.effects = Eigen::Vector2d(0.002, 0.0);
    estimate.frames.base() = Eigen::Translation3d(1.5, -2.25, 0.125) *
                             Eigen::AngleAxisd(30.0 * kDegree, Eigen::Vector3d::UnitZ()) *
                             Eigen::AngleAxisd(-20.0 * kDegree, Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(10.0 * kDegree, Eigen::Vector3d::UnitX());
    estimate.frames.targets = testing::targets_at({{0.1, 0.0, -0.05}, {0.0, 0.1205, 0.0}});
    measured.joint_values = Eigen::MatrixXd::Zero(5, 7);
    measured.joint_values.row(1).setLinSpaced(-0.4, 0.5);
    for (std::int32_t i = 0; i < 7; ++i) {
      measured.configurations.push_back("c" + std::to_string(i + 1));
      measured.observations.push_back({.reading = Point{Eigen::Vector3d::Zero()}, .configuration = i});
    }
    measured.observations.back().split = Split::test;
    measured.targets = {"A", "B"};
    c.fit.identification.iterations = 5;
    c.uncertainty.identifiability.rank = 20;
    c.uncertainty.identifiability.columns = 21;
    c.uncertainty.identifiability.condition = 123.4;
    c.fit.free = Unknowns(c.model, estimate.frames.targets, {"dq2", "dq4", "Tx1"});
    c.uncertainty.covariance = Eigen::Vector3d(1e-8, std::pow(0.01 * kDegree, 2), 1.0).asDiagonal();
    c.accuracy.train.before = {.count = 12, .mean = 1.1e-3, .rms = 1.2e-3, .p95 = 1.9e-3, .max = 2.0e-3};
    c.accuracy.train.after = {.count = 12, .mean = 0.11e-3, .rms = 0.12e-3, .p95 = 0.19e-3, .max = 0.2e-3};
    c.accuracy.iso_before.accuracy = c.accuracy.train.before;
    c.accuracy.iso_after.accuracy = c.accuracy.train.after;
    c.offsets_alone = {.errors = testing::errors_of(c.model, {{"dq4", 0.25 * kDegree}}),
                       .accuracy = {.count = 12, .rms = 0.9e-3}};
    c.noise = {.source = NoiseSource::residuals, .sigma = 1e-4, .independent = Eigen::Vector3d::Constant(3e-5)};
    add_parameters();
    add_influence();
    add_predictions();
    convention = {.name = "fanuc",
                  .controller_joints = {"J1", "J2", "J3", "J4", "J5"},
                  .urdf_joints = {"turn", "slide", "skew", "elbow", "wrist"},
                  .matrix = Eigen::MatrixXd::Identity(5, 5),
                  .offset = Eigen::VectorXd::Zero(5)};
    convention.matrix(1, 1) = -1.0;
    convention.matrix(4, 3) = 1.0;
  }

  void add_parameters() {
    const auto add = [&](const ParameterEstimate& parameter) {
      calibration.uncertainty.parameters.push_back(parameter);
    };
    add({.name = "base.Tx", .kind = ParameterKind::translation});
    add({.name = "dq2",
         .joint = "slide",
         .kind = ParameterKind::joint_offset,
         .error = 0.00125,
         .std = 1e-4,
         .degrees_of_freedom = kInfinity,
         .identifiable = true});
    add({.name = "dq4",
         .joint = "elbow",
         .kind = ParameterKind::joint_offset,
         .error = 0.5 * kDegree,
         .std = 0.01 * kDegree,
         .degrees_of_freedom = kInfinity,
         .identifiable = true});
    add({.name = "Tx1",
         .joint = "slide",
         .kind = ParameterKind::translation,
         .axis = "x",
         .error = -0.002,
         .gauge = true});
    add({.name = "Ry1", .joint = "slide", .kind = ParameterKind::rotation, .axis = "y", .error = 0.0, .gauge = true});
    add({.name = "Rz3",
         .joint = "elbow",
         .kind = ParameterKind::rotation,
         .axis = "z",
         .error = 0.1 * kDegree,
         .std = kInfinity});
    add({.name = "Tx5", .joint = "", .kind = ParameterKind::translation, .axis = "x", .error = 0.003});
    add({.name = "Ty5", .joint = "", .kind = ParameterKind::translation, .axis = "y", .error = 0.001});
    calibration.fit.reduction.dropped = {{.name = "Ty5", .replaced_by = {{"A.x", 0.2}, {"A.y", -0.9}}}};
  }

  void add_influence() {
    Influence& influence = calibration.uncertainty.influence;
    influence.cook_limit = 0.667;
    const std::vector<std::pair<double, bool>> cooks = {{0.25, false}, {kInfinity, true}, {0.5, false},
                                                        {0.75, true},  {0.5, true},       {0.125, false}};
    for (std::size_t i = 0; i < cooks.size(); ++i) {
      influence.configurations.push_back({.configuration = static_cast<std::int32_t>(i),
                                          .leverage = 0.1 * static_cast<double>(i + 1),
                                          .cook = cooks[i].first,
                                          .high_leverage = cooks[i].second,
                                          .influential = cooks[i].first > 0.667});
    }
  }

  void add_predictions() {
    const Eigen::Vector3d position(1.2345678, -0.5, 0.25);
    const Eigen::Vector3d nominal(1.234, -0.49975, 0.25);
    calibration.uncertainty.predicted.asked = {{.configuration = "there",
                                                .target = "A",
                                                .position = position,
                                                .nominal = nominal,
                                                .sigma = 1.25e-4,
                                                .radius_95 = 2.5e-4},
                                               {.configuration = "far",
                                                .target = "B",
                                                .position = position,
                                                .nominal = nominal,
                                                .sigma = kInfinity,
                                                .radius_95 = kInfinity}};
  }

  std::string printed() const { return result_table(measured, calibration, options); }
};

constexpr const char* kTable = R"(Trusted. Calibration of 6 configurations, 12 points, 3 parameters.
A new point lies within 0.30 mm (k = 2.5) in compensated programs or with the
    URDF, 3.02 mm as the robot is (by the fitted rows, which is too good:
    nothing was left out).

position error, rms [mm]       nominal  calibrated                points
fitted                           1.200       0.120                    12
left out                  not known

noise per coordinate: 0.030 mm per point (from the residuals)
rank 20 of 21 parameters, condition number 123, 5 iterations

joint zero offsets, for mastering: add to the displayed values
  enter nothing if you use the calibrated URDF or compensate, which correct
  them, or enter the first column and go on with kdlcal apply
                                             +- 95 %   if only these
  J1                         0.00000 deg        held     0.00000 deg
  J2                         -1.2500 mm       0.1960      0.0000 mm
  J3                         0.00000 deg        held     0.00000 deg
  J4                         0.50000 deg     0.01960     0.25000 deg
  J5                        -0.50000 deg     0.01960    -0.25000 deg
  the first column includes the mean of the effects of each joint
  enter the last column only if you use neither the calibrated URDF nor
  compensate: 0.900 mm would be left (fitted)

predicted, in the base [mm]           x          y          z  sigma   95 %
  there A                      1234.568   -500.000    250.000  0.125  0.250
    minus nominal                 0.568     -0.250      0.000
  far B                        1234.568   -500.000    250.000  not determined
    minus nominal                 0.568     -0.250      0.000

position error [mm]              rms        mean         p95         max  points
fitted, nominal                1.200       1.100       1.900       2.000      12
fitted, calibrated             0.120       0.110       0.190       0.200      12

geometric errors, +- half of the 95 % interval
  dq2   zero offset of slide                        1.2500 mm   +- 0.1960
  dq4   zero offset of elbow                       0.50000 deg  +- 0.01960
  Tx1   x shift of link 1 (origin of slide)        -2.0000 mm   by gauge
  Ry1   y turn of link 1 (origin of slide)         0.00000 deg  held, gauge
  Rz3   z turn of link 3 (origin of elbow)         0.10000 deg  not determined
  Tx5   x shift of link 5                           3.0000 mm   held by --fix
  Ty5   y shift of link 5                           1.0000 mm   held, in A.y

effects beyond geometry, largest motion at the measured configurations
  transverse  elbow, y across its axis             0.00000 deg
  gain        slide                                 1.0000 mm
  slide moves 0.2 % further than it is told

most influential: 2 of 6 configurations have a Cook's distance above 0.667,
3 a high leverage (*)
  configuration               Cook's  leverage
  c2                        not without     0.200 *
  c4                           0.750     0.400 *
  c3                           0.500     0.300
  c5                           0.500     0.500 *
  c1                           0.250     0.100

base, as measured [mm]               x           y           z
  origin                      1500.000   -2250.000     125.000
  roll, pitch, yaw [deg]      10.00000   -20.00000    30.00000

targets on the flange [mm]           x           y           z
  A                            100.000       0.000     -50.000
  B                              0.000     120.500       0.000

Written: a.urdf, result.json
)";

TEST(ResultTable, IsPrintedAsItStandsHere) {
  Made made;
  made.options.convention = &made.convention;
  EXPECT_EQ(std::regex_replace(made.printed(), std::regex(" +\n"), "\n"), kTable);
}

TEST(ResultTable, ListsTheFirstTwentyPredictions) {
  const auto counted = [](std::size_t points) {
    Made made;
    std::vector<AskedPoint>& asked = made.calibration.uncertainty.predicted.asked;
    asked.resize(points, asked.front());
    const std::string text = made.printed();
    const std::regex row("minus nominal");
    return std::pair(std::distance(std::sregex_iterator(text.begin(), text.end(), row), std::sregex_iterator()),
                     text.find("further ones: --result lists all") != std::string::npos);
  };
  EXPECT_EQ(counted(20), std::pair(std::ptrdiff_t{20}, false));
  EXPECT_EQ(counted(21), std::pair(std::ptrdiff_t{20}, true));
}

/// The lines of the noise.
std::string noise_of(const NoiseReport& noise) {
  Made made;
  made.calibration.noise = noise;
  const std::string text = made.printed();
  const std::size_t start = text.find("noise per coordinate");
  const std::size_t end = text.find("rank 20");
  return testing::squeezed(text.substr(start, end - start - 1));
}

TEST(ResultTable, NamesTheNoiseInItsParts) {
  NoiseReport noise{.source = NoiseSource::residuals, .sigma = 1e-4};
  EXPECT_EQ(noise_of(noise), "noise per coordinate: 0.100 mm in all (from the residuals)");
  noise.independent = Eigen::Vector3d(1e-5, 2e-5, 3e-5);
  EXPECT_EQ(noise_of(noise), "noise per coordinate: 0.010, 0.020, 0.030 mm per point (from the residuals)");
  noise.independent = Eigen::Vector3d(1e-5, 1e-5, 3e-5);
  EXPECT_EQ(noise_of(noise), "noise per coordinate: 0.010, 0.010, 0.030 mm per point (from the residuals)");
  noise.independent.setConstant(1e-5);
  noise.common.z() = 2e-5;
  noise.repeats.emplace();
  EXPECT_THAT(noise_of(noise), ::testing::MatchesRegex("noise per coordinate: 0.010 mm per point, 0.000, 0.000, 0.020 "
                                                       "mm common to a[ \n]+repeat \\(from residuals and repeats\\)"));
  noise = {.source = NoiseSource::stated, .independent = Eigen::Vector3d::Constant(1e-5)};
  EXPECT_THAT(noise_of(noise), EndsWith("per point (as stated)"));
  noise.misfit = 2e-5;
  EXPECT_THAT(noise_of(noise), HasSubstr("per point, 0.020 mm common to a"));
  EXPECT_THAT(noise_of(noise), EndsWith("the misfits from the residuals)"));
  noise.misfit = 0.0;
  noise.target_misfit = 3e-5;
  EXPECT_THAT(noise_of(noise), HasSubstr("per point, 0.030 mm of a target in a"));
  EXPECT_THAT(noise_of(noise), EndsWith("the misfits from the residuals)"));
  noise.source = NoiseSource::parts;
  EXPECT_THAT(noise_of(noise), EndsWith("(from the residuals)"));
  noise.parts.emplace();
  EXPECT_THAT(noise_of(noise), EndsWith("the misfits from the residuals)")) << "the points' own part is stated";
  noise.common.z() = 2e-5;
  noise.parts->estimated[NoiseParts::kCommon] = true;
  EXPECT_THAT(noise_of(noise), EndsWith("(the first as stated, the rest\n from the residuals)"));
  noise.parts->estimated[NoiseParts::kIndependent] = true;
  EXPECT_THAT(noise_of(noise), EndsWith("(from the residuals)"));
}

TEST(ResultTable, EveryErrorStandsInARowWithItsName) {
  Made made;
  Accuracy& accuracy = made.calibration.accuracy;
  const auto pair = [](double before, double after) {
    return BeforeAfter{.before = {.count = 6, .rms = before, .max = 2.0 * before},
                       .after = {.count = 6, .rms = after, .max = 2.0 * after},
                       .rigid = ErrorStatistics{.count = 6, .rms = 3e-3, .max = 4e-3}};
  };
  accuracy.train.rigid = accuracy.train.after;
  accuracy.train_means = pair(1.1e-3, 0.11e-3);
  accuracy.test = pair(1.5e-3, 0.5e-3);
  accuracy.test_means = pair(1.4e-3, 0.4e-3);
  accuracy.leave_one_out = pair(1.3e-3, 0.3e-3);
  const std::string text = std::regex_replace(made.printed(), std::regex(" +\n"), "\n");
  EXPECT_THAT(text, HasSubstr(R"(
position error, rms [mm]       nominal  calibrated  URDF alone    points
fitted                           1.200       0.120       0.120        12
fitted, means of repeats         1.100       0.110       3.000         6
test                             1.500       0.500       3.000         6
test, means of repeats           1.400       0.400       3.000         6
left out, means of repeats       1.300       0.300       3.000         6
largest, left out                2.600       0.600       4.000         6
)"));
  for (const char* row : {"\nmeans, nominal                 1.100", "\ntest means, calibrated         0.400",
                          "\nleft out, URDF alone           3.000"}) {
    EXPECT_THAT(text, HasSubstr(row));
  }
}

TEST(ResultTable, FiguresThatAreThereAreShown) {
  Made made;
  CalibrationResult& c = made.calibration;
  c.fit.identification.convergence_factor = 0.625;
  c.uncertainty.predicted.workspace = {.count = 1, .rms = 2e-3};
  c.uncertainty.predicted.measured = {.count = 1, .rms = 1e-3};
  c.accuracy.iso_after.repeatability = {.count = 1, .max = 3e-4};
  const std::string text = made.printed();
  EXPECT_THAT(text, HasSubstr("\neach round left 0.625 of the error of the round before\n"));
  EXPECT_THAT(text, HasSubstr("\n  1.000 mm at the measured configurations, 2.000 mm over the whole workspace\n"));
  EXPECT_THAT(text, HasSubstr("\n  AP nominal 2.000 mm, calibrated 0.200 mm; RP 0.300 mm\n"));
}

TEST(ResultTable, DoubtsAndFindingsComeFirst) {
  Made made;
  made.calibration.diagnosis.doubts = {{.message = "one"}, {.message = "two"}};
  made.calibration.diagnosis.findings = {{.message = "three"}};
  const std::string text = made.printed();
  EXPECT_EQ(
      text.substr(0, text.find("\nposition")),
      "NOT TO BE TRUSTED: one.\nAlso: two.\nMeasurements: three.\n\nCalibration of 6 configurations, 12 points, 3 "
      "parameters.\n");
  EXPECT_THAT(text, Not(HasSubstr("geometric errors")));
}

// A URDF joint that no controller joint moves along keeps its unit.
TEST(ResultTable, AControllerThatCountsNoSlideHasDegreesAlone) {
  Made made;
  made.convention.controller_joints = {"J1"};
  made.convention.urdf_joints = {"elbow"};
  made.convention.matrix = Eigen::MatrixXd::Constant(1, 1, 2.0);
  made.options.convention = &made.convention;
  const std::string text = made.printed();
  EXPECT_THAT(testing::squeezed(text), HasSubstr("J1 0.25000 deg 0.00980 0.12500 deg\n the first"));
  for (ParameterEstimate& parameter : made.calibration.uncertainty.parameters) {
    parameter.gauge = parameter.gauge || parameter.name == "dq4";
  }
  EXPECT_THAT(testing::squeezed(made.printed()), HasSubstr("J1 not measurable: base or targets take it up"));
}

TEST(ResultTable, NumbersStandBelowTheirHeadingsUpToKilometres) {
  ErrorStatistics large{.count = 1234567, .mean = 1000.0, .rms = 1000.0, .p95 = 1000.0, .max = 1000.0};
  const std::string heading = statistics_heading("position error [mm]");
  const std::string row = statistics_row("left out, choice anew", large);
  EXPECT_EQ(heading.size(), 81U);
  EXPECT_EQ(testing::word_ends(heading.substr(0, 80), 5), testing::word_ends(row.substr(0, 80), 5)) << heading << row;
  EXPECT_EQ(testing::word_ends(statistics_row("none", {}).substr(0, 80), 5), testing::word_ends(row.substr(0, 80), 5));
}

}  // namespace
}  // namespace kdl_calibration::result_table_test
