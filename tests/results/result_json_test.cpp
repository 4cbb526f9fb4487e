// The result as JSON: of calibrations, every figure against KDL and formulas; of one that is made up, letter by letter.

#include "results/result_json.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <clocale>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <locale>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "german_locale.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "printed_text.hpp"
#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/report_page.hpp"
#include "results/result_table.hpp"
#include "validation/validation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::result_json_test {
namespace {

using Json = nlohmann::json;
using testing::fanuc;
using testing::kOddArm;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// ---- calibrations of every sort ------------------------------------------------------------------------------------

struct Case {
  std::string name;
  Robot robot;
  Measurements measurements;
  CalibrationSettings options;
  CalibrationResult calibration;
  Json result;
};

Json rendered(const Case& c) { return Json::parse(result_json(c.robot, c.measurements, c.calibration)); }

/// A robot with errors of a millimetre and a milliradian, measured by a tracker a few metres away.
struct Setup : testing::VirtualExperiment {
  Robot nominal;

  Setup(Robot of, const std::vector<TargetFrame>& stated, std::uint64_t seed)
      : VirtualExperiment(
            {.model = complete_model(of), .targets = stated, .X_WB = some_metres_away(), .random = Random(seed)}),
        nominal(std::move(of)) {}

  static Eigen::Isometry3d some_metres_away() {
    const Eigen::AngleAxisd turn(2.5, Eigen::Vector3d(0.3, -0.2, 0.9).normalized());
    return Eigen::Translation3d(2.0, -1.5, 0.4) * turn;
  }

  /// Without stated sigmas.
  Measurements measured(const Eigen::MatrixXd& q, const MeasuringNoise& noise, Split split = Split::train) {
    return testing::without_sigmas(measure(q, noise, split));
  }

  /// Without other readings, of which a report shows nothing but warnings.
  Case calibrated(const std::string& name, const Measurements& measurements, CalibrationSettings options = {}) {
    options.diagnosis.try_readings = false;
    Case result{name, nominal, measurements, options, calibrate(model, measurements, options), {}};
    result.result = rendered(result);
    return result;
  }
};

std::vector<TargetFrame> with_orientation(std::vector<TargetFrame> targets) {
  for (TargetFrame& target : targets) {
    target.with_orientation = true;
    target.X_FT.linear() = Eigen::AngleAxisd(2.0, Eigen::Vector3d(1.0, 0.5, -0.3).normalized()).toRotationMatrix();
  }
  return targets;
}

const MeasuringNoise kPoints{.sigma = 3e-5};
const MeasuringNoise kRepeats{.sigma = 1e-5, .repeats = 3, .common = Eigen::Vector3d(4e-5, 3e-5, 2e-5)};

void add_cases_of_points(std::vector<Case>& cases) {
  Setup s(fanuc(), published_targets(), 1);
  const Eigen::MatrixXd q = s.configurations(25);
  const Measurements plain = s.measured(q, kPoints);
  const Measurements with_test = joined(plain, s.measured(s.configurations(6), kPoints, Split::test));
  cases.push_back(s.calibrated("plain", plain));
  cases.push_back(s.calibrated("test rows, leave-one-out, k-fold", with_test,
                               {.validation = {.leave_one_out = true, .k_fold = 5}}));
  cases.push_back(s.calibrated("two-step", plain, {.estimator = {.method = Method::two_step}}));
  cases.push_back(s.calibrated("complete model", plain, {.parameters = {.model = ModelChoice::complete}}));
  cases.push_back(
      s.calibrated("known base", plain, {.parameters = {.known = {.bases = {{.X_WB = s.robot.truth.frames.base()}}}}}));
  cases.push_back(
      s.calibrated("known targets", plain, {.parameters = {.known = {.targets = s.robot.truth.frames.targets}}}));
  cases.push_back(s.calibrated("hardly enough", s.measured(s.configurations(5), kPoints)));
  Measurements mistyped = plain;
  mistyped.observations[40].position().y() += 0.01;
  cases.push_back(s.calibrated("robust loss", mistyped, {.estimator = {.loss = Loss::tukey}}));
  CalibrationSettings stated{.predict_at = {{"first", "second"}, s.configurations(2)}};
  stated.noise.stated.independent = Eigen::Vector3d(1e-5, 2e-5, 3e-5);
  stated.noise.stated.common = Eigen::Vector3d(3e-5, 2e-5, 1e-5);
  cases.push_back(s.calibrated("noise that is stated, predictions", with_test, stated));
  Eigen::MatrixXd held = q;
  held.row(3).setConstant(0.6);
  Eigen::MatrixXd asked = s.configurations(2);
  asked(3, 0) = 0.6;
  cases.push_back(s.calibrated("a joint that never moves", s.measured(held, kPoints),
                               {.predict_at = {{"measured there", "not there"}, asked}}));
}

void add_cases_of_repeats(std::vector<Case>& cases) {
  Setup s(fanuc(), published_targets(2), 2);
  const Measurements repeats =
      joined(s.measured(s.configurations(20), kRepeats), s.measured(s.configurations(4), kRepeats, Split::test));
  cases.push_back(s.calibrated("repeats", repeats));
  cases.push_back(s.calibrated("noise from repeats", repeats, {.noise = {.weights = Weights::repeats}}));
  Setup poses(fanuc(), with_orientation(published_targets(2)), 3);
  MeasuringNoise noise = kRepeats;
  noise.orientation_sigma = 1e-4;
  cases.push_back(poses.calibrated("orientations", poses.measured(poses.configurations(15), noise),
                                   {.noise = {.weights = Weights::repeats}}));
}

void add_cases_of_effects(std::vector<Case>& cases) {
  Setup s(fanuc(), published_targets(), 4);
  s.robot.model.effects = load_terms(s.model);
  const auto count = static_cast<Eigen::Index>(s.robot.model.effects.size());
  s.robot.truth.effects = Eigen::VectorXd::LinSpaced(count, 4e-4, 8e-4);
  const Measurements sagging =
      joined(s.measured(s.configurations(24), kPoints), s.measured(s.configurations(5), kPoints, Split::test));
  cases.push_back(s.calibrated("gravity and gains", sagging,
                               {.selection = {.priors = {.length = 1e-3, .angle = 2e-3},
                                              .effects = {.groups = {EffectGroup::gravity, EffectGroup::gain}}},
                                .validation = {.leave_one_out = true}}));
  const Measurements few = subset(sagging, [](const Observation& o) { return o.configuration < 14; });
  cases.push_back(
      s.calibrated("automatic choice, nested", few,
                   {.selection = {.priors = {.length = 1e-3, .angle = 2e-3}, .effects = {.automatic = true}},
                    .validation = {.leave_one_out = true, .nested = true}}));
  Setup odd(parse_robot(kOddArm), testing::targets_at({{0.1, 0.0, 0.05}, {0.0, 0.12, 0.0}}), 5);
  const Eigen::MatrixXd q = odd.configurations(45);
  cases.push_back(odd.calibrated(
      "odd arm", odd.measured(q, kPoints),
      {.noise = {.weights = Weights::equal},
       .selection = {.effects = {.groups = {EffectGroup::gravity, EffectGroup::transverse, EffectGroup::backlash,
                                            EffectGroup::harmonics, EffectGroup::tables}}},
       .predict_at = {{"here"}, odd.configurations(1)}}));
}

const std::vector<Case>& cases() {
  static const std::vector<Case> all = [] {
    std::vector<Case> result;
    add_cases_of_points(result);
    add_cases_of_repeats(result);
    add_cases_of_effects(result);
    return result;
  }();
  return all;
}

const Case& case_of(const std::string& name) {
  const auto found = std::find_if(cases().begin(), cases().end(), [&](const Case& c) { return c.name == name; });
  EXPECT_NE(found, cases().end()) << "no case " << name;
  return *found;
}

// ---- a result that is made up --------------------------------------------------------------------------------------

/// Statistics in which no two numbers are alike.
ErrorStatistics made(int n) {
  return {.count = n, .mean = n + 0.1, .rms = n + 0.2, .p95 = n + 0.3, .max = n + 0.4, .std = n + 0.5};
}

Json made_json(int n) {
  return {{"count", n}, {"mean", n + 0.1}, {"rms", n + 0.2}, {"p95", n + 0.3}, {"max", n + 0.4}, {"std", n + 0.5}};
}

// NOLINTNEXTLINE(readability-function-size): one value after the other
Case made_up() {
  Case c;
  c.robot = parse_robot(kOddArm);
  c.robot.source = "robot.urdf";
  c.robot.urdf = "abc";
  c.measurements.source = "points.csv";
  c.measurements.joints = {"turn", "slide", "skew", "elbow", "wrist"};
  c.measurements.joint_values = Eigen::MatrixXd::Zero(5, 2);
  c.measurements.configurations = {"first", "second"};
  c.measurements.targets = {"A", "B"};
  c.measurements.observations = {{.reading = Point{{1.0, 2.0, 3.0}}, .configuration = 0, .target = 1},
                                 {.reading = Point{{4.0, 5.0, 6.0}}, .configuration = 1, .target = 0}};
  CalibrationResult& found = c.calibration;
  found.model = complete_model(parse_robot(kOddArm));
  found.fit.identification = {.termination = Termination::stalled, .message = "stands", .iterations = 7};
  found.fit.identification.rms_history = {0.5, 0.25};
  Estimate& estimate = found.fit.identification.estimate;
  estimate.errors = testing::errors_of(found.model);
  estimate.frames.targets = testing::targets_at({{0.1, 0.2, 0.3}, {0.4, 0.5, 0.6}});
  estimate.frames.base() = Eigen::Translation3d(1.0, 2.0, 3.0) * Eigen::Quaterniond(-0.6, 0.0, 0.0, 0.8);
  found.exported.estimate = estimate;
  found.uncertainty.identifiability.rank = 21;
  found.uncertainty.identifiability.condition = 55.5;
  found.uncertainty.identifiability.singular_values = Eigen::Vector2d(4.0, 2.0);
  found.uncertainty.identifiability.tied = {{"dq2"}, {"Tx1", "Ry1"}};
  found.uncertainty.identifiability.weak = {{"Rz3", "A.x"}};
  found.uncertainty.fixed_by_gauge = {"Tz3"};
  found.uncertainty.observability = {.O1 = 1.5, .O2 = 2.5, .O3 = 3.5, .O4 = 4.5, .O5 = 5.5};
  found.selection.priors = {.length = 0.01, .angle = 0.02};
  found.selection.not_tried = {{"gravity, gain", "20 configurations needed"}, {"priors", "too few data"}};
  found.selection.tried = {{.priors = {.length = 0.03, .angle = 0.04},
                            .effects = {"gravity", "gain"},
                            .sized = true,
                            .held_out_rms = 0.05,
                            .evidence = -6.5},
                           {.held_out_rms = kInfinity, .evidence = 0.07}};
  found.accuracy.train = {.before = made(1), .after = made(2), .rigid = made(3)};
  found.accuracy.test = {.before = made(4), .after = made(5)};
  found.accuracy.leave_one_out = {.before = made(6), .after = made(7)};
  found.accuracy.nested_leave_one_out = made(8);
  found.accuracy.k_fold = {.before = made(9), .after = made(10)};
  found.accuracy.folds = 11;
  found.accuracy.iso_before = {.accuracy = made(12), .repeatability = made(13)};
  found.accuracy.iso_after = {.accuracy = made(14), .repeatability = {}};
  found.accuracy.iso_test_before = {.accuracy = made(16), .repeatability = made(17)};
  found.accuracy.iso_test_after = {.accuracy = made(18), .repeatability = made(19)};
  found.exported.train = made(20);
  found.exported.test = made(21);
  found.exported.held_out = made(22);
  found.noise = {.source = NoiseSource::parts, .sigma = 0.1, .independent = {0.2, 0.3, 0.4}, .common = {0.5, 0.6, 0.7}};
  found.noise.misfit = 0.8;
  found.noise.target_misfit = 0.9;
  found.noise.degrees_of_freedom = 12.5;
  found.noise.variance_factor = 1.25;
  found.noise.orientation_length = 0.35;
  found.noise.tracker = TrackerNoise{1e-5, 2e-6, 3e-5, 4e-6};
  RepeatNoise& repeats = found.noise.repeats.emplace();
  repeats.independent = {1.1, 1.2, 1.3};
  repeats.common = {1.4, 1.5, 1.6};
  repeats.total = {1.7, 1.8, 1.9};
  repeats.degrees_of_freedom = 33.0;
  repeats.orientation = 0.44;
  repeats.orientation_degrees_of_freedom = 5.0;
  LackOfFit& lack = found.noise.lack_of_fit.emplace();
  lack.f = 2.25;
  lack.degrees_of_freedom = 10.0;
  lack.repeat_degrees_of_freedom = 20.0;
  lack.p_value = 0.015;
  lack.explained_by_joint = {0.1, 0.2, 0.3};
  found.diagnosis.findings = {{.kind = QualityKind::mistyped_coordinate,
                               .configuration = "second",
                               .repeat = 2,
                               .targets = {"B"},
                               .axis = 'y',
                               .amount = 0.01,
                               .message = "mistyped"},
                              {.kind = QualityKind::swapped_targets,
                               .configuration = "first",
                               .targets = {"A", "B"},
                               .amount = 0.1,
                               .message = "swapped"}};
  found.diagnosis.doubts = {{.cause = Cause::not_converged,
                             .subjects = {{SubjectKind::target, "A"}, {SubjectKind::configuration, "first"}},
                             .figures = {{"misfit", 0.5}, {"estimate", std::numeric_limits<double>::infinity()}},
                             .message = "doubted"}};
  found.diagnosis.remarks = {{.cause = Cause::lack_of_fit, .figures = {{"p_value", 0.25}}, .message = "one"},
                             {.cause = Cause::held_by_gauge,
                              .subjects = subjects_named(SubjectKind::parameter, {"Tz3"}),
                              .message = "another"}};
  found.fit.robust.weights = {0.25, 0.5};
  found.difference_to_kdl = 1e-15;
  found.uncertainty.predicted.measured = made(23);
  found.uncertainty.predicted.unseen = made(25);
  found.uncertainty.predicted.of_assumptions = 0.5;
  found.uncertainty.predicted.workspace = made(24);
  found.uncertainty.predicted.cell = 0.5;
  found.uncertainty.predicted.region = {
      .radius_factor = 1.75, .largest_variance = 0.25, .joints = {{-1.0, 2.0}}, .unproved = 0.125};
  found.uncertainty.predicted.cells = {{.centre = {1.0, 2.0, 3.0}, .count = 4, .mean = 5.0, .max = 6.0}};
  found.uncertainty.predicted.asked = {{.configuration = "there",
                                        .target = "A",
                                        .position = {1.0, 2.0, 3.0},
                                        .nominal = {7.0, 8.0, 9.0},
                                        .position_W = {4.0, 5.0, 6.0},
                                        .std = {0.5, 1.0, kInfinity},
                                        .sigma = 0.75,
                                        .radius_95 = kInfinity,
                                        .outside = true,
                                        .degrees_of_freedom = 10.0}};
  found.uncertainty.influence = {.leverage_limit = 0.5, .cook_limit = 0.6, .point_cook_limit = 0.7};
  found.uncertainty.influence.configurations = {
      {.configuration = 1, .leverage = 0.8, .cook = kInfinity, .high_leverage = true}};
  found.uncertainty.influence.configurations[0].points = {
      {.target = 1, .leverage = 0.9, .cook = 1.1, .influential = true}};
  found.uncertainty.parameters = {{.name = "base.Ty",
                                   .kind = ParameterKind::translation,
                                   .axis = "y",
                                   .nominal = 1.0,
                                   .value = 3.0,
                                   .error = 2.0,
                                   .std = 0.5,
                                   .degrees_of_freedom = 10.0,
                                   .identifiable = true},
                                  {.name = "B.z", .kind = ParameterKind::translation, .axis = "z", .std = 0.0625},
                                  {.name = "dq4",
                                   .joint = "elbow",
                                   .kind = ParameterKind::joint_offset,
                                   .nominal = 4.0,
                                   .value = 4.5,
                                   .error = 0.5,
                                   .std = kInfinity,
                                   .degrees_of_freedom = kInfinity,
                                   .gauge = true}};
  found.fit.reduction.candidates = 40;
  found.fit.reduction.rank = 33;
  found.fit.reduction.dropped = {{.name = "Tz1", .replaced_by = {{"Tz2", -1.0}}}};
  found.fit.reduction.gauge = {{.name = "dq1", .tied_to = {"base.Rz"}}};
  c.result = rendered(c);
  return c;
}

// NOLINTNEXTLINE(readability-function-size): one block after the other
TEST(ResultJson, IsWrittenAsItStandsHere) {
  const Json result = made_up().result;
  // FIPS 180-4: the digest of "abc" is among its examples.
  EXPECT_EQ(result["input"], Json::parse(R"({"urdf": "robot.urdf", "base": "world", "tip": "tool", "configurations": 2,
      "sha256": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad", "measurements": "points.csv",
      "observations": 2, "method": "joint", "model": "irreducible"})"));
  Json single;
  for (const char* key : {"termination", "message", "trusted", "iterations", "rank", "condition", "history",
                          "singular_values", "weights", "difference_to_kdl", "fixed_by_gauge", "warnings", "remarks",
                          "doubts", "tied", "weak", "observability", "priors"}) {
    single[key] = result[key];
  }
  EXPECT_EQ(single, Json::parse(R"({"termination": "stalled", "message": "stands", "trusted": false, "iterations": 7,
      "rank": 21, "condition": 55.5, "history": [0.5, 0.25], "singular_values": [4.0, 2.0], "weights": [0.25, 0.5],
      "difference_to_kdl": 1e-15, "fixed_by_gauge": ["Tz3"], "warnings": ["one", "another"],
      "remarks": [{"cause": "lack_of_fit", "subjects": [], "figures": {"p_value": 0.25}, "information": false},
                  {"cause": "held_by_gauge", "subjects": [{"kind": "parameter", "name": "Tz3"}], "figures": {},
                   "information": false}],
      "doubts": [{"cause": "not_converged", "message": "doubted",
                  "subjects": [{"kind": "target", "name": "A"}, {"kind": "configuration", "name": "first"}],
                  "figures": {"misfit": 0.5, "estimate": null}}], "tied": [["dq2"], ["Tx1", "Ry1"]],
      "weak": [["Rz3", "A.x"]], "observability": {"O1": 1.5, "O2": 2.5, "O3": 3.5, "O4": 4.5, "O5": 5.5},
      "priors": {"length": 0.01, "angle": 0.02}})"));
  EXPECT_EQ(result["not_tried"], "gravity, gain (20 configurations needed); priors (too few data)");
  EXPECT_EQ(result["tried"], Json::parse(R"([{"priors": {"length": 0.03, "angle": 0.04}, "effects": ["gravity", "gain"],
      "sized": true, "held_out_rms": 0.05, "evidence": -6.5}, {"priors": {"length": 0.0, "angle": 0.0}, "effects": [],
      "sized": false, "held_out_rms": null, "evidence": 0.07}])"));
  EXPECT_EQ(result["position_error"],
            (Json{{"train", {{"before", made_json(1)}, {"after", made_json(2)}, {"exported_urdf", made_json(3)}}},
                  {"test", {{"before", made_json(4)}, {"after", made_json(5)}}},
                  {"leave_one_out", {{"before", made_json(6)}, {"after", made_json(7)}}},
                  {"nested_leave_one_out", made_json(8)},
                  {"k_fold", {{"before", made_json(9)}, {"after", made_json(10)}, {"folds", 11}}}}));
  EXPECT_EQ(result["iso_9283"], (Json{{"before", {{"accuracy", made_json(12)}, {"repeatability", made_json(13)}}},
                                      {"after", {{"accuracy", made_json(14)}, {"repeatability", nullptr}}},
                                      {"test",
                                       {{"before", {{"accuracy", made_json(16)}, {"repeatability", made_json(17)}}},
                                        {"after", {{"accuracy", made_json(18)}, {"repeatability", made_json(19)}}}}}}));
  EXPECT_EQ(result["exported_urdf"]["position_error"],
            (Json{{"train", made_json(20)}, {"test", made_json(21)}, {"held_out", made_json(22)}}));
  EXPECT_EQ(result["noise"], Json::parse(R"({"model": "parts", "sigma": 0.1, "independent": [0.2, 0.3, 0.4],
      "common": [0.5, 0.6, 0.7], "misfit": 0.8, "target_misfit": 0.9, "degrees_of_freedom": 12.5,
      "degrees_of_freedom_of_point": 12.5, "variance_factor": 1.25, "tracker": [1e-5, 2e-6, 3e-5, 4e-6], "orientation_length": 0.35, "repeats": {"independent": [1.1, 1.2, 1.3],
      "common": [1.4, 1.5, 1.6], "total": [1.7, 1.8, 1.9], "degrees_of_freedom": 33.0, "orientation": 0.44}})"));
  EXPECT_EQ(result["lack_of_fit"], Json::parse(R"({"F": 2.25, "degrees_of_freedom": 10.0,
      "repeat_degrees_of_freedom": 20.0, "p_value": 0.015, "explained_by_joint": [0.1, 0.2, 0.3]})"));
  EXPECT_EQ(result["findings"], Json::parse(R"([{"kind": "mistyped_coordinate", "configuration": "second", "repeat": 2,
      "targets": ["B"], "axis": "y", "amount": 0.01, "message": "mistyped"}, {"kind": "swapped_targets",
      "configuration": "first", "repeat": 0, "targets": ["A", "B"], "axis": null, "amount": 0.1,
      "message": "swapped"}])"));
  EXPECT_EQ(result["influence"], Json::parse(R"({"leverage_limit": 0.5, "cook_limit": 0.6, "point_cook_limit": 0.7,
      "configurations": [{"configuration": "second", "leverage": 0.8, "cook": null, "high_leverage": true,
      "influential": false, "points": [{"target": "B", "leverage": 0.9, "cook": 1.1, "high_leverage": false,
      "influential": true}]}]})"));
  EXPECT_EQ(result["model"], Json::parse(R"({"candidates": 40, "rank": 33,
      "dropped": [{"name": "Tz1", "replaced_by": {"Tz2": -1.0}}],
      "gauge": [{"name": "dq1", "tied_to": ["base.Rz"]}]})"));
  EXPECT_EQ(result["targets"][1],
            Json::parse(R"({"name": "B", "position": [0.4, 0.5, 0.6], "std": [0.0, 0.0, 0.0625]})"));
  EXPECT_EQ(result["base"]["position"], (Json{1.0, 2.0, 3.0}));
  EXPECT_EQ(result["base"]["std"], (Json{0.0, 0.5, 0.0, 0.0, 0.0, 0.0}));
  EXPECT_NEAR(result["base"]["quaternion_wxyz"][0], 0.6, 1e-15);
  EXPECT_NEAR(result["base"]["quaternion_wxyz"][3], -0.8, 1e-15);
}

/// Student's t at 97.5 % with 10 degrees of freedom, of tables.
constexpr double kT = 2.228138852;

/// The same at 97.725 %, two sigma of a normal distribution, with 12.5: scipy.stats.t.ppf(norm.cdf(2), 12.5).
constexpr double kK = 2.2211425729756553;

TEST(ResultJson, IntervalsAreThoseOfStudentsT) {
  Json result = made_up().result;
  Json& parameters = result["parameters"];
  ASSERT_EQ(parameters.size(), 3U);
  EXPECT_NEAR(parameters[0]["interval_95"][0], 3.0 - 0.5 * kT, 1e-8);
  EXPECT_NEAR(parameters[0]["interval_95"][1], 3.0 + 0.5 * kT, 1e-8);
  parameters[0].erase("interval_95");
  EXPECT_EQ(parameters[0], Json::parse(R"({"name": "base.Ty", "joint": null, "kind": "translation", "axis": "y",
      "nominal": 1.0, "value": 3.0, "error": 2.0, "std": 0.5, "degrees_of_freedom": 10.0, "identifiable": true,
      "gauge": false})"));
  EXPECT_EQ(parameters[2], Json::parse(R"({"name": "dq4", "joint": "elbow", "kind": "joint_offset", "axis": "",
      "nominal": 4.0, "value": 4.5, "error": 0.5, "std": null, "degrees_of_freedom": null, "interval_95": null,
      "identifiable": false, "gauge": true})"));
  Json& predicted = result["predicted_accuracy"];
  Json& asked = predicted["asked"][0];
  EXPECT_NEAR(asked["interval_95"][1][0], 5.0 - kT, 1e-8);
  EXPECT_NEAR(asked["interval_95"][1][1], 5.0 + kT, 1e-8);
  EXPECT_TRUE(asked["interval_95"][2].is_null());
  asked.erase("interval_95");
  EXPECT_EQ(asked, Json::parse(R"({"configuration": "there", "target": "A", "position": [1.0, 2.0, 3.0],
      "position_nominal": [7.0, 8.0, 9.0], "position_measured_frame": [4.0, 5.0, 6.0], "std": [0.5, 1.0, null], "sigma": 0.75, "outside": true,
      "radius_95": null})"));
  for (const auto& [part, square] : std::map<std::string, double>{{"of_point", 1.25 * (0.04 + 0.09 + 0.16)},
                                                                  {"of_repeat", 1.25 * (0.25 + 0.36 + 0.49)},
                                                                  {"of_misfit", 3.0 * (0.64 + 0.81)},
                                                                  {"of_parameters", 25.2 * 25.2},
                                                                  {"of_assumptions", 0.25},
                                                                  {"total", 0.3625 + 1.375 + 4.35 + 635.04 + 0.25},
                                                                  {"expanded", kK * kK * 641.3775}}) {
    EXPECT_NEAR(predicted["budget"][part], std::sqrt(square), 1e-12) << part;
  }
  predicted.erase("budget");
  predicted.erase("asked");
  EXPECT_EQ(predicted, (Json{{"measured", made_json(23)},
                             {"unseen", made_json(25)},
                             {"workspace", made_json(24)},
                             {"cell", 0.5},
                             {"radius_factor", 1.75},
                             {"region", {{"joints", {{-1.0, 2.0}}}, {"largest_variance", 0.25}, {"unproved", 0.125}}},
                             {"cells", Json::parse(R"([{"centre": [1.0, 2.0, 3.0], "count": 4, "mean": 5.0,
                                                        "max": 6.0}])")}}));
}

/// As CMakeLists.txt states it.
std::string version_of_the_project() {
  std::ifstream stream(std::string(URDF_DIR) + "/../CMakeLists.txt");
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  std::smatch found;
  std::regex_search(text, found, std::regex(R"(project\(\s*kdl_calibration\s+VERSION\s+([0-9.]+))"));
  return found.size() == 2 ? found[1].str() : "no version in CMakeLists.txt";
}

TEST(ResultJson, NamesTheProgram) {
  EXPECT_EQ(case_of("plain").result["software"],
            (Json{{"name", "kdl_calibration"}, {"version", version_of_the_project()}}));
}

TEST(ResultJson, ACalibrationOfEachSortHasTheFieldsOfThatSort) {
  const auto has = [](const std::string& name, const char* pointer) {
    return case_of(name).result.contains(Json::json_pointer(pointer));
  };
  const std::vector<std::pair<const char*, std::set<std::string>>> only_in = {
      {"/convergence_factor", {"two-step"}},
      {"/weights", {"robust loss"}},
      {"/position_error/test",
       {"test rows, leave-one-out, k-fold", "noise that is stated, predictions", "repeats", "noise from repeats",
        "gravity and gains"}},
      {"/doubts/0", {}},
      {"/reservation", {"a joint that never moves"}},
      {"/position_error/nested_leave_one_out", {"automatic choice, nested"}},
      {"/position_error/k_fold", {"test rows, leave-one-out, k-fold"}},
      {"/noise/repeats", {"repeats", "noise from repeats", "orientations"}},
      {"/noise/repeats/orientation", {"orientations"}},
      {"/lack_of_fit", {"repeats", "noise from repeats", "orientations"}},
      {"/targets/0/quaternion_wxyz", {"orientations"}},
      {"/tried/0", {"automatic choice, nested", "gravity and gains", "odd arm"}},
      {"/findings/0", {"robust loss"}},
      {"/fixed_by_gauge/0", {"complete model", "a joint that never moves"}},
      {"/predicted_accuracy/asked", {"noise that is stated, predictions", "a joint that never moves", "odd arm"}}};
  for (const auto& [pointer, names] : only_in) {
    for (const Case& c : cases()) {
      EXPECT_EQ(has(c.name, pointer), names.count(c.name) == 1) << pointer << " in " << c.name;
    }
  }
  for (const Case& c : cases()) {
    EXPECT_EQ(has(c.name, "/position_error/leave_one_out"), c.name != std::string("hardly enough")) << c.name;
    for (const char* rows : {"train", "leave_one_out"}) {
      EXPECT_EQ(has(c.name, ("/position_error/" + std::string(rows) + "/exported_urdf").c_str()),
                !c.calibration.fit.free.effects().empty())
          << c.name;
    }
  }
}

/// KDL's pose of the flange for each configuration.
std::vector<KDL::Frame> kdl_poses(const ErrorModel& model, const Estimate& estimate, const Eigen::MatrixXd& q) {
  const Eigen::MatrixXd there = effective_joint_values(model, estimate.effects, q);
  std::vector<KDL::Frame> poses;
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    const Eigen::VectorXd tilts = there.col(c).tail(there.rows() - q.rows());
    const KDL::Chain chain = tilts.size() == 0 ? error_chain(model, estimate.errors)
                                               : tilted_chain(folded_chain(model, estimate.errors), tilts);
    poses.push_back(testing::kdl_pose(chain, there.col(c).head(q.rows())));
  }
  return poses;
}

KDL::Vector predicted_point(const KDL::Frame& X_BF, const Estimate& estimate, int target) {
  const Eigen::Vector3d point = estimate.frames.targets[static_cast<std::size_t>(target)].X_FT.translation();
  return to_kdl(estimate.frames.base()) * (X_BF * KDL::Vector(point.x(), point.y(), point.z()));
}

TEST(ResultJson, ResidualsAreMeasuredMinusKdlsPrediction) {
  for (const Case& c : cases()) {
    const Estimate& estimate = c.calibration.fit.identification.estimate;
    const std::vector<KDL::Frame> poses = kdl_poses(c.calibration.model, estimate, c.measurements.joint_values);
    const Json& rows = c.result["residuals"]["rows"];
    ASSERT_EQ(rows.size(), c.measurements.observations.size()) << c.name;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Observation& o = c.measurements.observations[i];
      const KDL::Vector p = predicted_point(poses[static_cast<std::size_t>(o.configuration)], estimate, o.target);
      const Eigen::Vector3d residual = o.position() - Eigen::Vector3d(p.x(), p.y(), p.z());
      for (Eigen::Index k = 0; k < 3; ++k) {
        EXPECT_NEAR(rows[i]["residual"][static_cast<std::size_t>(k)], residual[k], 1e-12) << c.name << i;
      }
      EXPECT_NEAR(rows[i]["distance"], residual.norm(), 1e-12) << c.name << i;
      EXPECT_EQ(rows[i]["split"], o.split == Split::train ? "train" : "test");
    }
  }
}

std::vector<double> distances_by_hand(const ErrorModel& model, const Estimate& estimate,
                                      const Measurements& measurements, Split split) {
  const std::vector<KDL::Frame> poses = kdl_poses(model, estimate, measurements.joint_values);
  std::vector<double> distances;
  for (const Observation& o : measurements.observations) {
    if (o.split == split) {
      const KDL::Vector p = predicted_point(poses[static_cast<std::size_t>(o.configuration)], estimate, o.target);
      distances.push_back(std::hypot(o.position().x() - p.x(), o.position().y() - p.y(), o.position().z() - p.z()));
    }
  }
  return distances;
}

void expect_statistics(const Json& got, const std::vector<double>& distances, const std::string& what) {
  const ErrorStatistics wanted = error_statistics(distances);
  EXPECT_EQ(got.size(), 6U) << what << got;
  EXPECT_EQ(got["count"], wanted.count) << what;
  for (const auto& [key, value] : std::map<std::string, double>{
           {"mean", wanted.mean}, {"rms", wanted.rms}, {"p95", wanted.p95}, {"max", wanted.max}, {"std", wanted.std}}) {
    EXPECT_NEAR(got[key], value, 2e-11) << what << ", " << key;
  }
}

Estimate start_of(const Case& c) {
  return nominal_start(c.calibration.model, c.measurements, {.known = c.options.parameters.known});
}

// The accuracy of ISO 9283 is the error of the means of repeats. Its repeatability is the same for every estimate.
TEST(ResultJson, PositionErrorsAreTheDistancesToKdlsPrediction) {
  for (const Case& c : cases()) {
    const ErrorModel& model = c.calibration.model;
    for (const auto& [key, rows] : {std::pair{"train", Rows::train}, std::pair{"test", Rows::test}}) {
      const bool is_test = rows == Rows::test;
      EXPECT_EQ(c.result["position_error"].contains("test"), c.result["iso_9283"].contains("test")) << c.name;
      if (!c.result["position_error"].contains(key)) {
        continue;
      }
      const Json& errors = c.result["position_error"][key];
      const Json& iso = is_test ? c.result["iso_9283"]["test"] : c.result["iso_9283"];
      const Split split = is_test ? Split::test : Split::train;
      for (const auto& [when, estimate] :
           {std::pair{"before", start_of(c)}, std::pair{"after", c.calibration.fit.identification.estimate}}) {
        const std::string what = c.name + ", " + key + " " + when;
        expect_statistics(errors[when], distances_by_hand(model, estimate, c.measurements, split), what);
        expect_statistics(iso[when]["accuracy"], distances_by_hand(model, estimate, averaged(c.measurements), split),
                          what + ", ISO 9283");
        const ErrorStatistics repeatability = iso_9283(model, estimate, c.measurements, rows).repeatability;
        ASSERT_EQ(iso[when]["repeatability"].is_null(), repeatability.count == 0) << what;
        if (repeatability.count > 0) {
          EXPECT_NEAR(iso[when]["repeatability"]["max"], repeatability.max, 1e-12) << what;
        }
      }
    }
  }
}

// The rigid robot's base and targets are not part of the result. Weighted as the points are, they are near those that
// leave the least.
TEST(ResultJson, TheExportedUrdfIsJudgedWithItsOwnBaseAndTargets) {
  for (const Case& c : cases()) {
    const Json& errors = c.result["position_error"];
    if (!errors["train"].contains("exported_urdf")) {
      continue;
    }
    const ErrorModel& model = c.calibration.model;
    Estimate start = start_of(c);
    start.errors = c.calibration.exported.estimate.errors;
    const Unknowns frames = c.calibration.fit.free.without(UnknownGroup::geometric).without(UnknownGroup::effects);
    const Estimate rigid = identify_jointly(model, c.measurements, start, frames).estimate;
    for (const auto& [key, split] : {std::pair{"train", Split::train}, std::pair{"test", Split::test}}) {
      if (errors.contains(key)) {
        const Json& stated = errors[key]["exported_urdf"];
        expect_statistics(stated, distances_by_hand(model, c.calibration.exported.estimate, c.measurements, split),
                          c.name + ", exported");
        const double least = error_statistics(distances_by_hand(model, rigid, c.measurements, split)).rms;
        EXPECT_NEAR(stated["rms"].get<double>() / least, 1.0, 0.02) << c.name;
      }
    }
  }
}

TEST(ResultJson, PredictionsAreThoseOfKdl) {
  for (const char* name : {"noise that is stated, predictions", "odd arm"}) {
    const Case& c = case_of(name);
    const Estimate& estimate = c.calibration.fit.identification.estimate;
    const std::vector<KDL::Frame> poses = kdl_poses(c.calibration.model, estimate, c.options.predict_at.joint_values);
    const Json& asked = c.result["predicted_accuracy"]["asked"];
    const std::size_t targets = estimate.frames.targets.size();
    ASSERT_EQ(asked.size(), c.options.predict_at.names.size() * targets) << name;
    for (std::size_t i = 0; i < asked.size(); ++i) {
      EXPECT_EQ(asked[i]["configuration"], c.options.predict_at.names[i / targets]);
      EXPECT_EQ(asked[i]["target"], estimate.frames.targets[i % targets].name);
      const KDL::Vector p_W = predicted_point(poses[i / targets], estimate, static_cast<int>(i % targets));
      const KDL::Vector p_B = to_kdl(estimate.frames.base()).Inverse() * p_W;
      double squares = 0.0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(asked[i]["position"][axis], p_B[static_cast<int>(axis)], 1e-12) << name;
        EXPECT_NEAR(asked[i]["position_measured_frame"][axis], p_W[static_cast<int>(axis)], 1e-12) << name;
        squares += std::pow(asked[i]["std"][axis].get<double>(), 2);
      }
      EXPECT_NEAR(asked[i]["sigma"], std::sqrt(squares), 1e-12) << name;
      EXPECT_GT(asked[i]["radius_95"], asked[i]["sigma"]) << name;
    }
  }
}

TEST(ResultJson, WhatIsNotDeterminedIsNullAndTheRestIsNot) {
  const Json& asked = case_of("a joint that never moves").result["predicted_accuracy"]["asked"];
  ASSERT_EQ(asked.size(), 6U);
  for (std::size_t i = 0; i < 6; ++i) {
    const bool determined = i < 3;  // where joint 4 stood
    EXPECT_EQ(asked[i]["sigma"].is_number(), determined) << asked[i];
    EXPECT_EQ(asked[i]["radius_95"].is_number(), determined) << asked[i];
    EXPECT_EQ(asked[i]["std"][0].is_number(), determined) << asked[i];
    EXPECT_EQ(asked[i]["interval_95"][2].is_array(), determined) << asked[i];
    EXPECT_TRUE(asked[i]["position"][0].is_number()) << asked[i];
  }
  EXPECT_TRUE(case_of("complete model").result["condition"].is_null());
  EXPECT_TRUE(case_of("plain").result["condition"].is_number());
  const Json& few = case_of("hardly enough").result["influence"]["configurations"];
  EXPECT_TRUE(few[0]["cook"].is_null()) << few[0];
  EXPECT_TRUE(case_of("plain").result["influence"]["configurations"][0]["cook"].is_number());
}

TEST(ResultTableOfCalibrations, IsAtMostEightyColumnsWide) {
  for (const Case& c : cases()) {
    for (const std::string& line : testing::lines_of(result_table(c.measurements, c.calibration, {.details = true}))) {
      EXPECT_LE(line.size(), 80U) << c.name << ": " << line;
    }
    EXPECT_LE(testing::lines_of(result_table(c.measurements, c.calibration)).size(), 40U) << c.name;
  }
}

TEST(ResultTableOfCalibrations, SaysWhereAResultIsTrustedUnlessItIsNot) {
  const Case& bad = case_of("a joint that never moves");
  EXPECT_THAT(result_table(bad.measurements, bad.calibration),
              ::testing::StartsWith("Trusted where it was measured: the measurements do not determine"));
  CalibrationResult worse = bad.calibration;
  worse.diagnosis.doubts.push_back({.cause = Cause::not_converged, .message = "the fit did not converge"});
  EXPECT_THAT(result_table(bad.measurements, worse),
              ::testing::StartsWith("NOT TO BE TRUSTED: the fit did not converge"));
}

TEST(ModelJson, ListsWhatIsKeptAndTheGaugeInDeclaredOrder) {
  const ErrorModel model = complete_model(fanuc());
  const std::vector<TargetFrame> targets = generic_targets(2);
  const Reduction reduction = reduced_model(model, targets);
  const Json json = Json::parse(model_json(model, targets, reduction));
  EXPECT_EQ(json["rank"], 30);  // 6 of the base, 18 errors, 6 of targets
  std::vector<std::string> names;
  std::set<std::string> gauge;
  for (const Json& parameter : json["parameters"]) {
    names.push_back(parameter["name"]);
    EXPECT_NE(parameter["identifiable"], parameter["gauge"]) << parameter;
    if (parameter["gauge"]) {
      gauge.insert(names.back());
    }
  }
  EXPECT_EQ(gauge, (std::set<std::string>{"dq1", "dq6"}));
  EXPECT_EQ(names.size(), 32U);
  const std::vector<std::string> first = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz",
                                          "A.x",     "A.y",     "A.z",     "B.x",     "B.y",     "B.z"};
  EXPECT_TRUE(std::equal(first.begin(), first.end(), names.begin())) << ::testing::PrintToString(names);
  const auto length = std::find_if(json["parameters"].begin(), json["parameters"].end(),
                                   [](const Json& parameter) { return parameter["name"] == "Tz2"; });
  ASSERT_NE(length, json["parameters"].end());
  EXPECT_EQ(*length, Json::parse(R"({"name": "Tz2", "joint": "joint_3", "kind": "translation", "axis": "z",
      "nominal": 1.075, "identifiable": true, "gauge": false})"));
}

/// Everything that the library reads and writes, as one text.
std::string everything() {
  const Robot odd = parse_robot(kOddArm);
  const ErrorModel odd_model = complete_model(odd);
  Random random(7);
  std::string text = calibrated_urdf(odd, odd_model, testing::random_errors(odd_model, random, 1.25e-3, 2.5e-3));
  const Robot again = parse_robot(text);
  for (const MovingJoint& joint : again.joints) {
    text += Json(joint.origin.p.x()).dump() + Json(joint.lower.value_or(1.5)).dump();
  }

  text += measurements_csv(parse_measurements("configuration,target,turn,x,y,z\n1000000,A,1.5,-1234567.5,1234.5,0.25\n",
                                              {"turn"}));  // digits in groups

  const Robot robot = fanuc();
  const ErrorModel model = complete_model(robot);
  const JointConvention convention = read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json");
  text += Json(convention.matrix(2, 1)).dump();
  testing::VirtualExperiment experiment({.model = model, .with_errors = {{6, 7, 8}}, .sizes = {}, .random = random});
  const Measurements measurements = experiment.measure(15, {.sigma = 1e-5});
  const std::string csv = measurements_csv(measurements);
  const Measurements read = parse_measurements(csv, joint_names(robot));
  const CalibrationSettings options;
  const CalibrationResult found = calibrate(model, read, options);
  text += csv + result_table(read, found) + calibrated_urdf(robot, model, found.exported.estimate.errors);
  const std::string json = result_json(robot, read, found);
  text += json + Json::parse(json).dump();
  text += calibration_page({.result = json,
                            .source = "r.json",
                            .robot = &robot,
                            .measurements = &read,
                            .known = {},
                            .plan_command = "kdlcal plan"});
  text += testing::refusal(
      [&] { parse_measurements("configuration,target,turn,x,y,z,qw,qx,qy,qz\n1,A,0,0,0,0,1.5,0,0,0\n", {"turn"}); });
  return text;
}

TEST(Locale, OfTheProgramChangesNoByte) {
  const testing::GermanLocaleFolder german;
  if (!german) {
    GTEST_SKIP() << "no locale with a decimal comma: localedef cannot make it here";
  }
  const std::string plain = everything();
  std::string comma;
  {
    const testing::UnderAComma under(german);
    ASSERT_EQ(std::localeconv()->decimal_point, std::string(","));
    ASSERT_EQ(std::use_facet<std::numpunct<char>>(std::locale()).decimal_point(), ',');
    comma = everything();
  }
  EXPECT_EQ(plain, comma);
}
}  // namespace
}  // namespace kdl_calibration::result_json_test
