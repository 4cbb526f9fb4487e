// Every number that result.json, the table and the model's JSON show, against what it was made from: each test walks
// the whole output, so that a field or a line without an expectation fails.

#include "base/sha256.hpp"
#include "base/wrapped_text.hpp"
#include "calibration/effect_findings.hpp"
#include "kdl_calibration/covariance.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/result_json.hpp"
#include "kdl_calibration/result_table.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <regex>
#include <set>

#include "base/f_distribution.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/simulation.hpp"
#include "printed_text.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::report_test {
namespace {

using Json = nlohmann::json;
using testing::decimals;
using testing::fanuc;
using testing::kOddArm;
using testing::squeezed;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;

// ---- calibrations of every sort ------------------------------------------------------------------------------------

struct Case {
  std::string name;
  Robot robot;
  Measurements measurements;
  CalibrationOptions options;
  Calibration calibration;
  Json result;
};

Json rendered(const Case& c) { return Json::parse(result_json(c.robot, c.measurements, c.options, c.calibration)); }

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
  Case calibrated(const std::string& name, const Measurements& measurements, CalibrationOptions options = {}) {
    options.try_readings = false;
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
  cases.push_back(s.calibrated("test rows, leave-one-out, k-fold", with_test, {.leave_one_out = true, .k_fold = 5}));
  cases.push_back(s.calibrated("two-step", plain, {.method = Method::two_step}));
  cases.push_back(s.calibrated("complete model", plain, {.model = ModelChoice::complete}));
  cases.push_back(s.calibrated("known base", plain, {.known_base = s.robot.truth.X_WB}));
  cases.push_back(s.calibrated("known targets", plain, {.known_targets = s.robot.truth.targets}));
  cases.push_back(s.calibrated("hardly enough", s.measured(s.configurations(5), kPoints)));
  Measurements mistyped = plain;
  mistyped.observations[40].position.y() += 0.01;
  cases.push_back(s.calibrated("robust loss", mistyped, {.loss = Loss::tukey}));
  CalibrationOptions stated{.predict_at = {{"first", "second"}, s.configurations(2)}};
  stated.noise.independent = Eigen::Vector3d(1e-5, 2e-5, 3e-5);
  stated.noise.common = Eigen::Vector3d(3e-5, 2e-5, 1e-5);
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
  cases.push_back(s.calibrated("noise from repeats", repeats, {.weights = Weights::repeats}));
  Setup poses(fanuc(), with_orientation(published_targets(2)), 3);
  MeasuringNoise noise = kRepeats;
  noise.orientation_sigma = 1e-4;
  cases.push_back(
      poses.calibrated("orientations", poses.measured(poses.configurations(15), noise), {.weights = Weights::repeats}));
}

void add_cases_of_effects(std::vector<Case>& cases) {
  Setup s(fanuc(), published_targets(), 4);
  s.robot.model.effects = load_terms(s.model);
  const auto count = static_cast<Eigen::Index>(s.robot.model.effects.size());
  s.robot.truth.effects = Eigen::VectorXd::LinSpaced(count, 4e-4, 8e-4);
  const Measurements sagging =
      joined(s.measured(s.configurations(24), kPoints), s.measured(s.configurations(5), kPoints, Split::test));
  cases.push_back(s.calibrated("gravity and gains", sagging,
                               {.priors = {.length = 1e-3, .angle = 2e-3},
                                .effects = {.groups = {EffectGroup::gravity, EffectGroup::gain}},
                                .leave_one_out = true}));
  const Measurements few = subset(sagging, [](const Observation& o) { return o.configuration < 14; });
  cases.push_back(s.calibrated("automatic choice, nested", few,
                               {.priors = {.length = 1e-3, .angle = 2e-3},
                                .effects = {.automatic = true},
                                .leave_one_out = true,
                                .nested = true}));
  Setup odd(parse_robot(kOddArm), testing::targets_at({{0.1, 0.0, 0.05}, {0.0, 0.12, 0.0}}), 5);
  const Eigen::MatrixXd q = odd.configurations(45);
  cases.push_back(
      odd.calibrated("odd arm", odd.measured(q, kPoints),
                     {.effects = {.groups = {EffectGroup::gravity, EffectGroup::transverse, EffectGroup::backlash,
                                             EffectGroup::harmonics, EffectGroup::tables}},
                      .weights = Weights::equal,
                      .predict_at = {{"here"}, odd.configurations(1)}}));
}

/// Joints move by tables, of which the last is withheld in the middle of its range, where nothing is measured.
Case table_with_a_gap() {
  Setup odd(parse_robot(kOddArm), testing::targets_at({{0.1, 0.0, 0.05}, {0.0, 0.12, 0.0}}), 5);
  Eigen::MatrixXd q = odd.configurations(36);
  q.row(4) = q.row(4).unaryExpr([](double value) { return value + std::copysign(1.0, value); }) * 2.0 / 3.0;
  Eigen::MatrixXd asked = q.leftCols(1).replicate(1, 2);
  asked(4, 1) = 0.0;
  odd.robot.model.effects = table_terms(odd.model, q, 0.3);
  const auto count = static_cast<Eigen::Index>(odd.robot.model.effects.size());
  odd.robot.truth.effects =
      Eigen::VectorXd::NullaryExpr(count, [&](Eigen::Index) { return 1e-3 * odd.random.normal(); });
  return odd.calibrated(
      "a table with a gap", odd.measured(q, kPoints),
      {.effects = {.groups = {EffectGroup::tables}}, .held_out = false, .predict_at = {{"here", "between"}, asked}});
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

// ---- a calibration in which no two numbers are alike
// -----------------------------------------------------------------

/// Gives each number a value of its own, different from all others by more than the table's last digit.
class Painter {
public:
  void paint(double& value) { value = 0.001 + 1.7e-5 * ++count_; }
  void paint(int& value) { value = 100 + ++count_; }
  void paint(long& value) { value = 100 + ++count_; }
  template <class Matrix>
  void paint_all(Matrix&& values) {
    for (auto& value : values.reshaped()) {
      paint(value);
    }
  }
  void paint(ErrorStatistics& s) {
    paint(s.count);
    for (double* value : {&s.mean, &s.rms, &s.p95, &s.max, &s.std}) {
      paint(*value);
    }
  }
  void paint(BeforeAfter& pair) {
    paint(pair.before);
    paint(pair.after);
    paint(pair.rigid.emplace());
  }
  void paint(Iso9283& iso) {
    paint(iso.accuracy);
    paint(iso.repeatability);
  }
  template <class Entry>
  void paint_influence(Entry& entry) {
    paint(entry.leverage);
    paint(entry.cook);
    entry.high_leverage = ++count_ % 3 == 0;
    entry.influential = count_ % 2 == 0;
  }

private:
  int count_ = 0;
};

void paint_accuracy(Painter& p, Calibration& c) {
  p.paint(c.train);
  p.paint(c.test.emplace());
  p.paint(c.leave_one_out.emplace());
  p.paint(c.nested_leave_one_out.emplace());
  p.paint(c.k_fold.emplace());
  p.paint(c.folds);
  p.paint(c.iso_before);
  p.paint(c.iso_after);
  p.paint(c.iso_test_before.emplace());
  p.paint(c.iso_test_after.emplace());
  p.paint(c.predicted.measured);
  p.paint(c.predicted.workspace);
  p.paint(c.predicted.cell);
  c.predicted.cells.resize(3);
  for (WorkspaceCell& cell : c.predicted.cells) {
    p.paint_all(cell.centre);
    p.paint(cell.count);
    p.paint(cell.mean);
    p.paint(cell.max);
  }
  for (PredictedPoint& point : c.predicted.asked) {
    for (Eigen::Vector3d* values : {&point.position, &point.position_W, &point.std}) {
      p.paint_all(*values);
    }
    p.paint(point.sigma);
    p.paint(point.radius_95);
  }
}

void paint_noise(Painter& p, NoiseReport& noise) {
  RepeatNoise& repeats = noise.repeats.emplace();
  for (Eigen::Vector3d* values :
       {&noise.independent, &noise.common, &repeats.independent, &repeats.common, &repeats.total}) {
    p.paint_all(*values);
  }
  for (double* value :
       {&noise.sigma, &noise.misfit, &noise.target_misfit, &noise.degrees_of_freedom, &noise.variance_factor,
        &repeats.degrees_of_freedom, &repeats.orientation, &repeats.orientation_degrees_of_freedom}) {
    p.paint(*value);
  }
}

void paint_judgement(Painter& p, Calibration& c) {
  p.paint(c.identification.iterations);
  p.paint(c.identification.convergence_factor);
  p.paint(c.identifiability.rank);
  p.paint(c.identifiability.columns);
  p.paint(c.identifiability.condition);
  p.paint_all(c.identifiability.singular_values);
  c.identifiability.tied = {{"dq2"}, {"Tx1", "Ry1"}};
  c.identifiability.weak = {{"Rz3", "A.x"}, {"base.Tx"}};
  c.fixed_by_gauge = {"Tz3", "base.Ry"};
  for (double* value : {&c.observability.O1, &c.observability.O2, &c.observability.O3, &c.observability.O4,
                        &c.observability.O5, &c.priors.length, &c.priors.angle}) {
    p.paint(*value);
  }
  c.tried.resize(2);
  for (ModelOption& option : c.tried) {
    for (double* value : {&option.priors.length, &option.priors.angle, &option.held_out_rms, &option.evidence}) {
      p.paint(*value);
    }
  }
  c.tried[0].effects = {"gravity", "gain"};
  c.tried[0].sized = true;
  c.findings = {{.kind = QualityKind::mistyped_coordinate,
                 .configuration = "7",
                 .repeat = 2,
                 .targets = {"B"},
                 .axis = 'y',
                 .amount = 0.01,
                 .message = "what is said of B"},
                {.kind = QualityKind::swapped_targets,
                 .configuration = "9",
                 .targets = {"A", "C"},
                 .amount = 0.1,
                 .message = "what is said of A and C"}};
  LackOfFit& lack = c.lack_of_fit.emplace();
  for (double* value : {&lack.f, &lack.degrees_of_freedom, &lack.repeat_degrees_of_freedom, &lack.p_value}) {
    p.paint(*value);
  }
  lack.explained_by_joint = {0.11, 0.22, 0.33};
  for (double* value : {&c.influence.leverage_limit, &c.influence.cook_limit, &c.influence.point_cook_limit}) {
    p.paint(*value);
  }
  for (ConfigurationInfluence& entry : c.influence.configurations) {
    p.paint_influence(entry);
    for (PointInfluence& point : entry.points) {
      p.paint_influence(point);
    }
  }
  c.influence.configurations[3].cook = kInfinity;
  c.influence.configurations[2].points[1].cook = kInfinity;
  c.weights = {0.25, 0.5, 1.0};
  p.paint(c.difference_to_kdl);
  c.warnings = {"one", "another"};
  c.doubts = {{.cause = "first", .message = "what is doubted"}, {.cause = "second", .message = "and why"}};
}

/// The calibration of the odd arm with effects and predictions, each number replaced.
Case painted() {
  Case result = case_of("odd arm");
  result.name = "painted";
  Calibration& c = result.calibration;
  Painter p;
  paint_accuracy(p, c);
  paint_noise(p, c.noise);
  paint_judgement(p, c);
  p.paint_all(c.identification.estimate.X_WB.translation());
  for (TargetFrame& target : c.identification.estimate.targets) {
    p.paint_all(target.X_FT.translation());
  }
  for (ParameterEstimate& parameter : c.parameters) {
    for (double* value : {&parameter.nominal, &parameter.value, &parameter.error, &parameter.std}) {
      p.paint(*value);
    }
  }
  // Eigen makes the largest component of such a rotation positive, and w negative.
  c.identification.estimate.X_WB.linear() =
      Eigen::AngleAxisd(3.0, Eigen::Vector3d(-0.9, 0.3, 0.2).normalized()).toRotationMatrix();
  c.parameters.back().gauge = true;  // held by choice elsewhere, but estimated here
  c.parameters.back().identifiable = true;
  c.parameters[0].std = kInfinity;
  c.parameters[0].identifiable = false;
  c.parameters[8].std = kInfinity;
  c.predicted.asked.back().sigma = kInfinity;
  c.predicted.asked.back().radius_95 = kInfinity;
  c.predicted.asked.back().std.setConstant(kInfinity);
  result.robot.source = "robot.urdf";
  result.robot.urdf = "abc";
  result.measurements.source = "points.csv";
  result.result = rendered(result);
  return result;
}

// ---- result.json ---------------------------------------------------------------------------------------------------

/// Every number, text and empty container of a JSON document by the way to it.
void collect(const Json& json, const std::string& path, std::map<std::string, Json>& leaves) {
  if (!json.is_structured() || json.empty()) {
    leaves[path] = json;
    return;
  }
  for (const auto& [key, value] : json.items()) {
    collect(value, path + "/" + key, leaves);
  }
}

/// What a JSON document must hold. All of it must have been expected, and nothing else.
class Expected {
public:
  void is(const std::string& path, const Json& value) { expected_[path] = value; }
  /// JSON knows neither infinity nor NaN.
  void number(const std::string& path, double value) {
    expected_[path] = std::isfinite(value) ? Json(value) : Json(nullptr);
  }
  template <class Numbers>
  void numbers(const std::string& path, const Numbers& values) {
    std::size_t i = 0;
    for (const double value : values) {
      number(path + "/" + std::to_string(i++), value);
    }
    if (i == 0) {
      is(path, Json::array());
    }
  }
  void texts(const std::string& path, const std::vector<std::string>& values) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      is(path + "/" + std::to_string(i), values[i]);
    }
    if (values.empty()) {
      is(path, Json::array());
    }
  }
  void statistics(const std::string& path, const ErrorStatistics& s) {
    if (s.count == 0) {
      is(path, nullptr);
      return;
    }
    is(path + "/count", s.count);
    number(path + "/mean", s.mean);
    number(path + "/rms", s.rms);
    number(path + "/p95", s.p95);
    number(path + "/max", s.max);
    number(path + "/std", s.std);
  }

  void compare(const Json& got, const std::string& what) const {
    std::map<std::string, Json> leaves;
    collect(got, "", leaves);
    for (const auto& [path, value] : leaves) {
      EXPECT_EQ(expected_.count(path), 1U) << what << ": nothing is expected at " << path << ", got " << value;
    }
    for (const auto& [path, value] : expected_) {
      const auto found = leaves.find(path);
      if (found == leaves.end()) {
        ADD_FAILURE() << what << ": expected " << value << " at " << path << ", got nothing";
        continue;
      }
      const bool close = is_computed(path) && value.is_number() && found->second.is_number() &&
                         std::abs(value.get<double>() - found->second.get<double>()) <= 1e-12;
      EXPECT_TRUE(found->second == value || close)
          << what << ": expected " << value << " at " << path << ", got " << found->second;
    }
  }

private:
  /// What the report computes itself may differ by rounding; all else is handed through to the last bit.
  static bool is_computed(const std::string& path) {
    return path.find("/interval_95") != std::string::npos || path.find("/quaternion_wxyz") != std::string::npos ||
           path.rfind("/residuals", 0) == 0;
  }
  std::map<std::string, Json> expected_;
};

/// Half the width of the 95 % interval of a standard normal value: where its distribution is at 97.5 %.
double normal_quantile() {
  double lower = 0.0;
  double upper = 10.0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (lower + upper);
    (0.5 * std::erfc(-middle / std::numbers::sqrt2) < 0.975 ? lower : upper) = middle;
  }
  return lower;
}

/// What Student's t exceeds with probability 0.025: its density by Simpson's rule.
double t_quantile(double freedom) {
  static std::map<double, double> known;
  if (!(freedom < 1e6)) {
    return normal_quantile();
  }
  const auto [place, is_new] = known.try_emplace(freedom, 0.0);
  if (!is_new) {
    return place->second;
  }
  const double scale =
      std::exp(std::lgamma((freedom + 1.0) / 2.0) - std::lgamma(freedom / 2.0)) / std::sqrt(freedom * std::numbers::pi);
  const auto density = [&](double t) { return scale * std::pow(1.0 + t * t / freedom, -(freedom + 1.0) / 2.0); };
  const auto from_zero = [&](double t) {
    constexpr int kSteps = 2000;
    double sum = density(0.0) + density(t);
    for (int i = 1; i < kSteps; ++i) {
      sum += (i % 2 == 0 ? 2.0 : 4.0) * density(t * i / kSteps);
    }
    return sum * t / (3.0 * kSteps);
  };
  double t = 1.9;  // below the quantile, from where Newton's steps lead up to it
  double step = 1.0;
  while (step > 1e-14) {
    step = (0.475 - from_zero(t)) / density(t);
    t += step;
  }
  return place->second = t;
}

void expect_interval(Expected& expected, const std::string& path, double value, double std, double freedom) {
  const double half = std > 0.0 ? t_quantile(freedom) * std : 0.0;
  expected.number(path + "/0", value - half);
  expected.number(path + "/1", value + half);
}

/// By KDL's conversion, with w not negative.
void expect_quaternion(Expected& expected, const std::string& path, const Eigen::Matrix3d& R) {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
  double w = 0.0;
  KDL::Rotation(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2))
      .GetQuaternion(x, y, z, w);
  const double sign = w < 0.0 ? -1.0 : 1.0;
  expected.numbers(path, std::vector<double>{sign * w, sign * x, sign * y, sign * z});
}

const ParameterEstimate& parameter_of(const Calibration& calibration, const std::string& name) {
  return *std::find_if(calibration.parameters.begin(), calibration.parameters.end(),
                       [&](const ParameterEstimate& parameter) { return parameter.name == name; });
}

/// As CMakeLists.txt states it.
std::string version_of_the_project() {
  std::ifstream stream(std::string(URDF_DIR) + "/../CMakeLists.txt");
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  std::smatch found;
  std::regex_search(text, found, std::regex(R"(project\(\s*kdl_calibration\s+VERSION\s+([0-9.]+))"));
  return found.size() == 2 ? found[1].str() : "no version in CMakeLists.txt";
}

void expect_input(Expected& expected, const Case& c) {
  expected.is("/software/name", "kdl_calibration");
  expected.is("/software/version", version_of_the_project());
  expected.is("/input/urdf", c.robot.source);
  expected.is("/input/base", c.robot.base);
  expected.is("/input/tip", c.robot.tip);
  expected.is("/input/measurements", c.measurements.source);
  expected.is("/input/configurations", c.measurements.configurations.size());
  expected.is("/input/observations", c.measurements.observations.size());
  expected.is("/input/method", c.options.method == Method::two_step ? "two-step" : "joint");
  expected.is("/input/model", c.options.model == ModelChoice::complete ? "complete" : "irreducible");
}

void expect_fit(Expected& expected, const Case& c) {
  const Calibration& found = c.calibration;
  expected.is("/termination", to_string(found.identification.termination));
  expected.is("/message", found.identification.message);
  expected.is("/trusted", found.doubts.empty());
  for (std::size_t i = 0; i < found.doubts.size(); ++i) {
    expected.is("/doubts/" + std::to_string(i) + "/cause", found.doubts[i].cause);
    expected.is("/doubts/" + std::to_string(i) + "/message", found.doubts[i].message);
  }
  if (found.doubts.empty()) {
    expected.is("/doubts", Json::array());
  }
  expected.is("/iterations", found.identification.iterations);
  expected.is("/rank", found.identifiability.rank);
  expected.number("/condition", found.identifiability.condition);
  if (c.options.method == Method::two_step) {
    expected.number("/convergence_factor", found.identification.convergence_factor);
  }
  const std::vector<double>& history = found.identification.rms_history;
  expected.numbers("/history",
                   Eigen::Map<const Eigen::VectorXd>(history.data(), static_cast<Eigen::Index>(history.size())));
  expected.numbers("/singular_values", found.identifiability.singular_values);
  expected.texts("/fixed_by_gauge", found.fixed_by_gauge);
  expected.is("/minimum_norm", found.minimum_norm);
  const auto groups = [&](const std::string& path, const std::vector<std::vector<std::string>>& names) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      expected.texts(path + "/" + std::to_string(i), names[i]);
    }
    if (names.empty()) {
      expected.is(path, Json::array());
    }
  };
  groups("/tied", found.identifiability.tied);
  groups("/weak", found.identifiability.weak);
  const ObservabilityIndices& o = found.observability;
  expected.number("/observability/O1", o.O1);
  expected.number("/observability/O2", o.O2);
  expected.number("/observability/O3", o.O3);
  expected.number("/observability/O4", o.O4);
  expected.number("/observability/O5", o.O5);
  expected.number("/difference_to_kdl", found.difference_to_kdl);
  expected.texts("/warnings", found.warnings);
  if (!found.weights.empty()) {
    expected.numbers("/weights", found.weights);
  }
}

void expect_parameters(Expected& expected, const Calibration& found) {
  for (std::size_t i = 0; i < found.parameters.size(); ++i) {
    const ParameterEstimate& parameter = found.parameters[i];
    if (parameter.kind == "effect") {  // the last ones, which have a block of their own
      continue;
    }
    const std::string path = "/parameters/" + std::to_string(i);
    expected.is(path + "/name", parameter.name);
    expected.is(path + "/joint", parameter.joint.empty() ? Json(nullptr) : Json(parameter.joint));
    expected.is(path + "/kind", parameter.kind);
    expected.is(path + "/axis", parameter.axis);
    expected.number(path + "/nominal", parameter.nominal);
    expected.number(path + "/value", parameter.value);
    expected.number(path + "/error", parameter.error);
    expected.number(path + "/std", parameter.std);
    expected.number(path + "/degrees_of_freedom", parameter.degrees_of_freedom);
    if (parameter.identifiable && std::isfinite(parameter.std)) {
      expect_interval(expected, path + "/interval_95", parameter.value, parameter.std, parameter.degrees_of_freedom);
    } else {
      expected.is(path + "/interval_95", nullptr);
    }
    expected.is(path + "/identifiable", parameter.identifiable);
    expected.is(path + "/gauge", parameter.gauge);
  }
}

void expect_frames(Expected& expected, const Calibration& found) {
  const Estimate& estimate = found.identification.estimate;
  expected.numbers("/base/position", Eigen::Vector3d(estimate.X_WB.translation()));
  expect_quaternion(expected, "/base/quaternion_wxyz", estimate.X_WB.linear());
  const std::vector<std::string> axes = {"Tx", "Ty", "Tz", "Rx", "Ry", "Rz"};
  for (std::size_t i = 0; i < axes.size(); ++i) {
    expected.number("/base/std/" + std::to_string(i), parameter_of(found, "base." + axes[i]).std);
  }
  for (std::size_t k = 0; k < estimate.targets.size(); ++k) {
    const TargetFrame& target = estimate.targets[k];
    const std::string path = "/targets/" + std::to_string(k);
    expected.is(path + "/name", target.name);
    expected.numbers(path + "/position", Eigen::Vector3d(target.X_FT.translation()));
    std::vector<std::string> names = {"x", "y", "z"};
    if (target.with_orientation) {
      expect_quaternion(expected, path + "/quaternion_wxyz", target.X_FT.linear());
      names.insert(names.end(), {"Rx", "Ry", "Rz"});
    }
    for (std::size_t i = 0; i < names.size(); ++i) {
      expected.number(path + "/std/" + std::to_string(i), parameter_of(found, target.name + "." + names[i]).std);
    }
  }
}

void expect_reduction(Expected& expected, const std::string& path, const Reduction& reduction) {
  expected.is(path + "/candidates", reduction.candidates);
  expected.is(path + "/rank", reduction.rank);
  for (std::size_t i = 0; i < reduction.dropped.size(); ++i) {
    const std::string at = path + "/dropped/" + std::to_string(i);
    expected.is(at + "/name", reduction.dropped[i].name);
    for (const auto& [name, coefficient] : reduction.dropped[i].replaced_by) {
      expected.number(at + "/replaced_by/" + name, coefficient);
    }
    if (reduction.dropped[i].replaced_by.empty()) {
      expected.is(at + "/replaced_by", Json::object());
    }
  }
  for (std::size_t i = 0; i < reduction.gauge.size(); ++i) {
    const std::string at = path + "/gauge/" + std::to_string(i);
    expected.is(at + "/name", reduction.gauge[i].name);
    expected.texts(at + "/tied_to", reduction.gauge[i].tied_to);
  }
  for (const auto& [list, empty] :
       {std::pair{"/dropped", reduction.dropped.empty()}, std::pair{"/gauge", reduction.gauge.empty()}}) {
    if (empty) {
      expected.is(path + list, Json::array());
    }
  }
}

void expect_accuracy(Expected& expected, const Calibration& found) {
  const auto pair = [&](const std::string& path, const BeforeAfter& errors) {
    expected.statistics(path + "/before", errors.before);
    expected.statistics(path + "/after", errors.after);
    if (errors.rigid) {
      expected.statistics(path + "/exported_urdf", *errors.rigid);
    }
  };
  pair("/position_error/train", found.train);
  if (found.test) {
    pair("/position_error/test", *found.test);
  }
  if (found.leave_one_out) {
    pair("/position_error/leave_one_out", *found.leave_one_out);
  }
  if (found.nested_leave_one_out) {
    expected.statistics("/position_error/nested_leave_one_out", *found.nested_leave_one_out);
  }
  if (found.k_fold) {
    pair("/position_error/k_fold", *found.k_fold);
    expected.is("/position_error/k_fold/folds", found.folds);
  }
  const auto iso = [&](const std::string& path, const Iso9283& figures) {
    expected.statistics(path + "/accuracy", figures.accuracy);
    expected.statistics(path + "/repeatability", figures.repeatability);
  };
  iso("/iso_9283/before", found.iso_before);
  iso("/iso_9283/after", found.iso_after);
  if (found.iso_test_before) {
    iso("/iso_9283/test/before", *found.iso_test_before);
    iso("/iso_9283/test/after", *found.iso_test_after);
  }
}

void expect_noise(Expected& expected, const Calibration& found) {
  const NoiseReport& noise = found.noise;
  expected.is("/noise/model", noise.model);
  expected.number("/noise/sigma", noise.sigma);
  expected.numbers("/noise/independent", noise.independent);
  expected.numbers("/noise/common", noise.common);
  expected.number("/noise/misfit", noise.misfit);
  expected.number("/noise/target_misfit", noise.target_misfit);
  expected.number("/noise/degrees_of_freedom", noise.degrees_of_freedom);
  expected.number("/noise/variance_factor", noise.variance_factor);
  if (noise.orientation_length) {
    expected.number("/noise/orientation_length", *noise.orientation_length);
  }
  if (noise.repeats) {
    expected.numbers("/noise/repeats/independent", noise.repeats->independent);
    expected.numbers("/noise/repeats/common", noise.repeats->common);
    expected.numbers("/noise/repeats/total", noise.repeats->total);
    expected.number("/noise/repeats/degrees_of_freedom", noise.repeats->degrees_of_freedom);
    if (noise.repeats->orientation_degrees_of_freedom > 0.0) {
      expected.number("/noise/repeats/orientation", noise.repeats->orientation);
    }
  }
  if (found.lack_of_fit) {
    expected.number("/lack_of_fit/F", found.lack_of_fit->f);
    expected.number("/lack_of_fit/degrees_of_freedom", found.lack_of_fit->degrees_of_freedom);
    expected.number("/lack_of_fit/repeat_degrees_of_freedom", found.lack_of_fit->repeat_degrees_of_freedom);
    expected.number("/lack_of_fit/p_value", found.lack_of_fit->p_value);
    expected.numbers("/lack_of_fit/explained_by_joint", found.lack_of_fit->explained_by_joint);
  }
}

/// What an effect's function is made of, beside its group and joint.
void expect_function(Expected& expected, const std::string& path, const EffectTerm& term) {
  const std::string axes[] = {"x", "y", "z", "slide", "own"};
  if (term.group == EffectGroup::gravity || term.group == EffectGroup::transverse) {
    expected.is(path + "/link", term.gravity.link + 1);
    expected.is(path + "/axis", axes[term.gravity.axis]);
  } else if (term.group == EffectGroup::backlash) {
    expected.number(path + "/mass", term.masses.at(0).mass);
  } else if (term.group == EffectGroup::harmonics || term.group == EffectGroup::ripple) {
    expected.is(path + "/of", term.harmonic < 0 ? "cos" : "sin");
    expected.is(path + "/times", std::abs(term.harmonic));
  } else if (term.group == EffectGroup::tables) {
    expected.is(path + "/number", term.table.number);
    expected.number(path + "/length", term.table.length);
    expected.number(path + "/lower", term.table.lower);
    expected.number(path + "/upper", term.table.upper);
    for (std::size_t i = 0; i < term.table.withheld.size(); ++i) {
      const auto& [from, to] = term.table.withheld[i];
      expected.numbers(path + "/withheld/" + std::to_string(i), std::vector<double>{from, to});
    }
    if (term.table.withheld.empty()) {
      expected.is(path + "/withheld", Json::array());
    }
  } else {
    expected.is(path, Json::object());
  }
}

void expect_effects(Expected& expected, const Case& c) {
  const Calibration& found = c.calibration;
  const JointRanges ranges = trained_ranges(c.measurements);
  const KDL::Vector& g = found.model.gravity;
  expected.numbers("/effects/gravity_direction", std::vector<double>{g.x(), g.y(), g.z()});
  for (std::size_t i = 0; i < found.model.effects.size(); ++i) {
    const EffectTerm& term = found.model.effects[i];
    const ParameterEstimate& estimate = parameter_of(found, term.name);
    const std::string path = "/effects/terms/" + std::to_string(i);
    expected.is(path + "/name", term.name);
    expected.is(path + "/joint", term.joint);
    expected.is(path + "/group", to_string(term.group));
    expected.is(path + "/about", to_string(term.axis));
    expect_function(expected, path + "/function", term);
    expected.number(path + "/mean", term.mean);
    expected.number(path + "/scale", term.scale);
    expected.number(path + "/sigma", term.sigma);
    expected.number(path + "/coefficient", estimate.value);
    expected.number(path + "/std", estimate.std);
    const auto& [lower, upper] = ranges.at(static_cast<std::size_t>(term.index));
    expected.numbers(path + "/valid_range", std::vector<double>{lower, upper});
  }
  expected.texts("/effects/findings", effect_findings(found, effect_motions(found, c.measurements)));
  if (found.model.effects.empty()) {
    expected.is("/effects/terms", Json::array());
  }
}

void expect_choices(Expected& expected, const Calibration& found) {
  const auto priors = [&](const std::string& path, const Priors& p) {
    expected.number(path + "/length", p.length);
    expected.number(path + "/angle", p.angle);
  };
  priors("/priors", found.priors);
  for (std::size_t i = 0; i < found.tried.size(); ++i) {
    const std::string path = "/tried/" + std::to_string(i);
    priors(path + "/priors", found.tried[i].priors);
    expected.texts(path + "/effects", found.tried[i].effects);
    expected.is(path + "/sized", found.tried[i].sized);
    expected.number(path + "/held_out_rms", found.tried[i].held_out_rms);
    expected.number(path + "/evidence", found.tried[i].evidence);
  }
  if (found.tried.empty()) {
    expected.is("/tried", Json::array());
  }
  for (std::size_t i = 0; i < found.findings.size(); ++i) {
    const QualityFinding& finding = found.findings[i];
    const std::string path = "/findings/" + std::to_string(i);
    expected.is(path + "/kind", to_string(finding.kind));
    expected.is(path + "/configuration", finding.configuration);
    expected.is(path + "/repeat", finding.repeat);
    expected.texts(path + "/targets", finding.targets);
    expected.is(path + "/axis", finding.axis == ' ' ? Json(nullptr) : Json(std::string{finding.axis}));
    expected.number(path + "/amount", finding.amount);
    expected.is(path + "/message", finding.message);
  }
  if (found.findings.empty()) {
    expected.is("/findings", Json::array());
  }
}

void expect_predictions(Expected& expected, const Calibration& found) {
  const PredictedAccuracy& predicted = found.predicted;
  expected.statistics("/predicted_accuracy/measured", predicted.measured);
  expected.statistics("/predicted_accuracy/workspace", predicted.workspace);
  expected.number("/predicted_accuracy/cell", predicted.cell);
  expected.number("/predicted_accuracy/radius_factor", predicted.radius_factor);
  for (std::size_t i = 0; i < predicted.cells.size(); ++i) {
    const std::string path = "/predicted_accuracy/cells/" + std::to_string(i);
    expected.numbers(path + "/centre", predicted.cells[i].centre);
    expected.is(path + "/count", predicted.cells[i].count);
    expected.number(path + "/mean", predicted.cells[i].mean);
    expected.number(path + "/max", predicted.cells[i].max);
  }
  if (predicted.cells.empty()) {
    expected.is("/predicted_accuracy/cells", Json::array());
  }
  for (std::size_t i = 0; i < predicted.asked.size(); ++i) {
    const PredictedPoint& point = predicted.asked[i];
    const std::string path = "/predicted_accuracy/asked/" + std::to_string(i);
    expected.is(path + "/configuration", point.configuration);
    expected.is(path + "/target", point.target);
    expected.numbers(path + "/position", point.position);
    expected.numbers(path + "/position_measured_frame", point.position_W);
    expected.numbers(path + "/std", point.std);
    for (int axis = 0; axis < 3; ++axis) {
      const std::string interval = path + "/interval_95/" + std::to_string(axis);
      if (std::isfinite(point.std[axis])) {
        expect_interval(expected, interval, point.position_W[axis], point.std[axis], point.degrees_of_freedom);
      } else {
        expected.is(interval, nullptr);
      }
    }
    expected.is(path + "/outside", point.outside);
    expected.number(path + "/sigma", point.sigma);
    expected.number(path + "/radius_95", point.radius_95);
  }
}

void expect_influence(Expected& expected, const Case& c) {
  const Influence& influence = c.calibration.influence;
  if (influence.configurations.empty()) {
    return;
  }
  const auto add = [&](const std::string& path, const auto& entry) {
    expected.number(path + "/leverage", entry.leverage);
    expected.is(path + "/high_leverage", entry.high_leverage);
    expected.number(path + "/cook", entry.cook);
    expected.is(path + "/influential", entry.influential);
  };
  expected.number("/influence/leverage_limit", influence.leverage_limit);
  expected.number("/influence/cook_limit", influence.cook_limit);
  expected.number("/influence/point_cook_limit", influence.point_cook_limit);
  for (std::size_t i = 0; i < influence.configurations.size(); ++i) {
    const ConfigurationInfluence& entry = influence.configurations[i];
    const std::string path = "/influence/configurations/" + std::to_string(i);
    expected.is(path + "/configuration",
                c.measurements.configurations.at(static_cast<std::size_t>(entry.configuration)));
    add(path, entry);
    for (std::size_t k = 0; k < entry.points.size(); ++k) {
      const std::string at = path + "/points/" + std::to_string(k);
      expected.is(at + "/target", c.measurements.targets.at(static_cast<std::size_t>(entry.points[k].target)));
      add(at, entry.points[k]);
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
  const Eigen::Vector3d point = estimate.targets[static_cast<std::size_t>(target)].X_FT.translation();
  return to_kdl(estimate.X_WB) * (X_BF * KDL::Vector(point.x(), point.y(), point.z()));
}

void expect_held_out_points(Expected& expected, const Case& c) {
  const std::vector<HeldOutPoint>& points = c.calibration.held_out_points;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::string path = "/held_out_points/" + std::to_string(i);
    expected.is(path + "/configuration",
                c.measurements.configurations[static_cast<std::size_t>(points[i].configuration)]);
    expected.is(path + "/target", c.measurements.targets[static_cast<std::size_t>(points[i].target)]);
    for (Eigen::Index k = 0; k < 3; ++k) {
      expected.number(path + "/residual/" + std::to_string(k), points[i].residual[k]);
    }
    expected.number(path + "/distance", points[i].residual.norm());
  }
  if (points.empty()) {
    expected.is("/held_out_points", nullptr);
  }
}

/// Of every row, by KDL's prediction.
void expect_residuals(Expected& expected, const Case& c) {
  const Estimate& estimate = c.calibration.identification.estimate;
  const std::vector<KDL::Frame> poses = kdl_poses(c.calibration.model, estimate, c.measurements.joint_values);
  std::vector<double> distances;
  for (std::size_t i = 0; i < c.measurements.observations.size(); ++i) {
    const Observation& o = c.measurements.observations[i];
    const std::string path = "/residuals/rows/" + std::to_string(i);
    const KDL::Vector p = predicted_point(poses[static_cast<std::size_t>(o.configuration)], estimate, o.target);
    const Eigen::Vector3d residual = o.position - Eigen::Vector3d(p.x(), p.y(), p.z());
    distances.push_back(residual.norm());
    expected.is(path + "/configuration", c.measurements.configurations.at(static_cast<std::size_t>(o.configuration)));
    expected.is(path + "/repeat", o.repeat);
    expected.is(path + "/target", c.measurements.targets.at(static_cast<std::size_t>(o.target)));
    expected.is(path + "/split", o.split == Split::train ? "train" : "test");
    expected.numbers(path + "/residual", residual);
    expected.number(path + "/distance", distances.back());
  }
  expected.statistics("/residuals/statistics", error_statistics(distances));
}

void expect_covariance(Expected& expected, const Calibration& found) {
  const std::vector<std::string> names = found.free.names();
  expected.texts("/covariance/names", names);
  for (std::size_t r = 0; r < names.size(); ++r) {
    for (std::size_t k = 0; k <= r; ++k) {
      expected.number("/covariance/lower_triangle/" + std::to_string(r) + "/" + std::to_string(k),
                      found.covariance(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(k)));
    }
  }
}

void expect_exported(Expected& expected, const Case& c) {
  const ExportedUrdf& exported = c.calibration.exported;
  std::size_t i = 0;
  for (std::size_t p = 0; p < c.calibration.model.parameters.size(); ++p) {
    const ErrorParameter& parameter = c.calibration.model.parameters[p];
    const double error = exported.estimate.errors[static_cast<Eigen::Index>(p)];
    if (error != 0.0) {
      const std::string path = "/exported_urdf/parameters/" + std::to_string(i++);
      expected.is(path + "/name", parameter.name);
      expected.number(path + "/nominal", parameter.nominal);
      expected.number(path + "/value", parameter.nominal + error);
      expected.number(path + "/error", error);
    }
  }
  if (i == 0) {
    expected.is("/exported_urdf/parameters", Json::array());
  }
  expected.numbers("/exported_urdf/base/position", Eigen::Vector3d(exported.estimate.X_WB.translation()));
  expect_quaternion(expected, "/exported_urdf/base/quaternion_wxyz", exported.estimate.X_WB.linear());
  for (std::size_t k = 0; k < exported.estimate.targets.size(); ++k) {
    const TargetFrame& target = exported.estimate.targets[k];
    const std::string path = "/exported_urdf/targets/" + std::to_string(k);
    expected.is(path + "/name", target.name);
    expected.numbers(path + "/position", Eigen::Vector3d(target.X_FT.translation()));
    if (target.with_orientation) {
      expect_quaternion(expected, path + "/quaternion_wxyz", target.X_FT.linear());
    }
  }
  expected.statistics("/exported_urdf/position_error/train", exported.train);
  expected.statistics("/exported_urdf/position_error/test", exported.test.value_or(ErrorStatistics{}));
  expected.statistics("/exported_urdf/position_error/held_out", exported.held_out.value_or(ErrorStatistics{}));
  expected.is("/exported_urdf/nominal_kept", exported.nominal_kept);
}

Expected expected_result(const Case& c) {
  Expected expected;
  expect_input(expected, c);
  expect_fit(expected, c);
  expect_parameters(expected, c.calibration);
  expect_frames(expected, c.calibration);
  expect_reduction(expected, "/model", c.calibration.reduction);
  expect_accuracy(expected, c.calibration);
  expect_noise(expected, c.calibration);
  expect_effects(expected, c);
  expect_choices(expected, c.calibration);
  expect_predictions(expected, c.calibration);
  expect_influence(expected, c);
  expect_residuals(expected, c);
  expect_held_out_points(expected, c);
  expect_covariance(expected, c.calibration);
  expect_exported(expected, c);
  expected.is("/provenance/notes", Json::object());
  expected.is("/provenance/files_read", Json::array());
  expected.is("/provenance/files_written", Json::array());
  return expected;
}

Json exported_hash(const Case& c) {
  return c.name == "painted" ? Json(nullptr) : Json(sha256(calibrated_urdf(c.robot, c.calibration)));
}

TEST(ReportJson, EveryFieldIsThatOfTheCalibration) {
  std::vector<Case> all = cases();
  all.push_back(painted());
  for (const Case& c : all) {
    Expected expected = expected_result(c);
    const Json& result = c.result;
    expected.is("/input/sha256", sha256(c.robot.urdf));
    expected.is("/exported_urdf/sha256", exported_hash(c));
    expected.compare(result, c.name);
  }
}

// FIPS 180-4: the digest of "abc" is among its examples.
TEST(ReportJson, TheHashIsSha256OfTheUrdf) {
  EXPECT_EQ(painted().result["input"]["sha256"], "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(ReportJson, ACalibrationOfEachSortHasTheFieldsOfThatSort) {
  const auto has = [](const std::string& name, const char* pointer) {
    return case_of(name).result.contains(Json::json_pointer(pointer));
  };
  const std::vector<std::pair<const char*, std::set<std::string>>> only_in = {
      {"/convergence_factor", {"two-step"}},
      {"/weights", {"robust loss"}},
      {"/position_error/test",
       {"test rows, leave-one-out, k-fold", "noise that is stated, predictions", "repeats", "noise from repeats",
        "gravity and gains"}},
      {"/doubts/0", {"a joint that never moves"}},
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
    EXPECT_TRUE(has(c.name, "/position_error/leave_one_out")) << c.name;
    for (const char* rows : {"train", "leave_one_out"}) {
      EXPECT_EQ(has(c.name, ("/position_error/" + std::string(rows) + "/exported_urdf").c_str()),
                !c.calibration.free.effects().empty())
          << c.name;
    }
  }
}

// ---- where the calibration's own figures come from
// -------------------------------------------------------------------

std::vector<double> distances_by_hand(const ErrorModel& model, const Estimate& estimate,
                                      const Measurements& measurements, Split split) {
  const std::vector<KDL::Frame> poses = kdl_poses(model, estimate, measurements.joint_values);
  std::vector<double> distances;
  for (const Observation& o : measurements.observations) {
    if (o.split == split) {
      const KDL::Vector p = predicted_point(poses[static_cast<std::size_t>(o.configuration)], estimate, o.target);
      distances.push_back(std::hypot(o.position.x() - p.x(), o.position.y() - p.y(), o.position.z() - p.z()));
    }
  }
  return distances;
}

/// The formulas written out. The 95th percentile lies 0.95 of the way from the first to the last of the sorted values.
Json statistics_by_hand(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto n = static_cast<double>(values.size());
  double sum = 0.0;
  double squares = 0.0;
  for (const double value : values) {
    sum += value;
    squares += value * value;
  }
  double deviations = 0.0;
  for (const double value : values) {
    deviations += (value - sum / n) * (value - sum / n);
  }
  const double place = 0.95 * (n - 1.0);
  const auto below = static_cast<std::size_t>(place);
  const double above = values[std::min(below + 1, values.size() - 1)];
  return {{"count", values.size()},
          {"mean", sum / n},
          {"rms", std::sqrt(squares / n)},
          {"p95", values[below] + (place - static_cast<double>(below)) * (above - values[below])},
          {"max", values.back()},
          {"std", std::sqrt(deviations / (n - 1.0))}};
}

void expect_statistics(const Json& got, const std::vector<double>& distances, const std::string& what) {
  const Json wanted = statistics_by_hand(distances);
  ASSERT_EQ(got.size(), wanted.size()) << what << got;
  for (const auto& [key, value] : wanted.items()) {
    EXPECT_NEAR(got[key].get<double>(), value.get<double>(), 2e-11) << what << ", " << key;
  }
}

Estimate start_of(const Case& c) {
  return nominal_start(c.calibration.model, c.measurements,
                       {.known_base = c.options.known_base, .known_targets = c.options.known_targets});
}

TEST(ReportJson, PositionErrorsAreTheDistancesToKdlsPrediction) {
  for (const Case& c : cases()) {
    const ErrorModel& model = c.calibration.model;
    const Json& errors = c.result["position_error"];
    for (const auto& [key, split] : {std::pair{"train", Split::train}, std::pair{"test", Split::test}}) {
      if (errors.contains(key)) {
        const auto distances = [&, of = split](const Estimate& e) {
          return distances_by_hand(model, e, c.measurements, of);
        };
        expect_statistics(errors[key]["before"], distances(start_of(c)), c.name + ", before");
        expect_statistics(errors[key]["after"], distances(c.calibration.identification.estimate), c.name + ", after");
      }
    }
  }
}

// The rigid robot's base and targets are not part of the result, but they are the best for its errors.
TEST(ReportJson, TheExportedUrdfIsJudgedWithItsOwnBaseAndTargets) {
  for (const Case& c : cases()) {
    const Json& errors = c.result["position_error"];
    if (!errors["train"].contains("exported_urdf")) {
      continue;
    }
    const ErrorModel& model = c.calibration.model;
    Estimate start = start_of(c);
    start.errors = c.calibration.exported.estimate.errors;
    const Unknowns frames = c.calibration.free.without(UnknownGroup::geometric).without(UnknownGroup::effects);
    const Estimate rigid = identify_jointly(model, c.measurements, start, frames).estimate;
    for (const auto& [key, split] : {std::pair{"train", Split::train}, std::pair{"test", Split::test}}) {
      if (errors.contains(key)) {
        expect_statistics(errors[key]["exported_urdf"], distances_by_hand(model, rigid, c.measurements, split),
                          c.name + ", exported");
      }
    }
  }
}

/// Mean and distances of the repeats of each target in each configuration.
struct Repeated {
  std::vector<Eigen::Vector3d> positions;
  Eigen::Vector3d mean() const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& position : positions) {
      sum += position;
    }
    return sum / static_cast<double>(positions.size());
  }
};

TEST(ReportJson, FiguresOfIso9283AreThoseOfTheMeansAndTheirRepeats) {
  for (const Case& c : cases()) {
    const Json& iso = c.result["iso_9283"];
    const auto check = [&](const Json& got, const Estimate& estimate, Split split) {
      const std::vector<KDL::Frame> poses = kdl_poses(c.calibration.model, estimate, c.measurements.joint_values);
      std::map<std::pair<int, int>, Repeated> points;
      for (const Observation& o : c.measurements.observations) {
        if (o.split == split) {
          points[{o.configuration, o.target}].positions.push_back(o.position);
        }
      }
      std::vector<double> accuracies;
      std::vector<double> repeatabilities;
      for (const auto& [key, point] : points) {
        const KDL::Vector p = predicted_point(poses[static_cast<std::size_t>(key.first)], estimate, key.second);
        accuracies.push_back((point.mean() - Eigen::Vector3d(p.x(), p.y(), p.z())).norm());
        std::vector<double> distances;
        for (const Eigen::Vector3d& position : point.positions) {
          distances.push_back((position - point.mean()).norm());
        }
        if (distances.size() > 1) {
          const Json l = statistics_by_hand(distances);
          repeatabilities.push_back(l["mean"].get<double>() + 3.0 * l["std"].get<double>());
        }
      }
      expect_statistics(got["accuracy"], accuracies, c.name);
      if (repeatabilities.empty()) {
        EXPECT_TRUE(got["repeatability"].is_null()) << c.name;
      } else {
        expect_statistics(got["repeatability"], repeatabilities, c.name);
      }
    };
    check(iso["before"], start_of(c), Split::train);
    check(iso["after"], c.calibration.identification.estimate, Split::train);
    if (iso.contains("test")) {
      check(iso["test"]["before"], start_of(c), Split::test);
      check(iso["test"]["after"], c.calibration.identification.estimate, Split::test);
    }
  }
}

/// What must stand in the result of one parameter.
struct Wanted {
  std::string name;
  std::string joint;
  std::string kind;
  std::string axis;
  double nominal = 0.0;
  double error = 0.0;
  bool frame = false;  // of base or target
  double value = 0.0;
};

void want_frame(const std::string& name, const Eigen::Isometry3d& nominal, const Eigen::Isometry3d& X, bool rotations,
                std::vector<Wanted>& wanted) {
  const bool base = name == "base";
  const KDL::Vector turn = to_kdl(X).M.GetRot();
  const KDL::Vector nominal_turn = to_kdl(nominal).M.GetRot();
  for (int i = 0; i < (rotations ? 6 : 3); ++i) {
    const std::string axis(1, "xyz"[i % 3]);
    const std::string letter = i < 3 ? (base ? "T" : "") : "R";
    const double value = i < 3 ? X.translation()[i] : turn[i - 3];
    const double before = i < 3 ? nominal.translation()[i] : nominal_turn[i - 3];
    wanted.push_back({.name = name + "." + letter + axis,
                      .joint = "",
                      .kind = i < 3 ? "translation" : "rotation",
                      .axis = axis,
                      .nominal = before,
                      .error = value - before,
                      .frame = true,
                      .value = value});
  }
}

std::vector<Wanted> wanted_parameters(const Calibration& found, const Estimate& nominal) {
  const Estimate& estimate = found.identification.estimate;
  std::vector<Wanted> wanted;
  want_frame("base", nominal.X_WB, estimate.X_WB, true, wanted);
  for (std::size_t k = 0; k < estimate.targets.size(); ++k) {
    const TargetFrame& target = estimate.targets[k];
    want_frame(target.name, nominal.targets[k].X_FT, target.X_FT, target.with_orientation, wanted);
  }
  for (std::size_t p = 0; p < found.model.parameters.size(); ++p) {
    const ErrorParameter& parameter = found.model.parameters[p];
    wanted.push_back({.name = parameter.name,
                      .joint = parameter.joint,
                      .kind = parameter.kind == ParameterKind::joint_offset  ? "joint_offset"
                              : parameter.kind == ParameterKind::translation ? "translation"
                                                                             : "rotation",
                      .axis = parameter.axis == 'q' ? "" : std::string{parameter.axis},
                      .nominal = parameter.nominal,
                      .error = estimate.errors[static_cast<Eigen::Index>(p)]});
  }
  return wanted;
}

void expect_terms(const Case& c) {
  const Calibration& found = c.calibration;
  const std::vector<std::string> columns = found.free.names();
  EXPECT_EQ(c.result["effects"]["terms"].size(), found.model.effects.size()) << c.name;
  for (const Json& term : c.result["effects"]["terms"]) {
    const auto column = std::find(columns.begin(), columns.end(), term["name"].get<std::string>());
    ASSERT_NE(column, columns.end()) << c.name << ", " << term["name"];
    EXPECT_EQ(term["std"], std::sqrt(found.covariance(column - columns.begin(), column - columns.begin())));
  }
}

TEST(ReportJson, ParametersAreThoseOfTheEstimateAndItsCovariance) {
  for (const Case& c : cases()) {
    const Calibration& found = c.calibration;
    const std::vector<std::string> columns = found.free.names();
    std::set<std::string> gauge(found.fixed_by_gauge.begin(), found.fixed_by_gauge.end());
    for (const GaugeParameter& parameter : found.reduction.gauge) {
      gauge.insert(parameter.name);
    }
    const std::set<std::string> kept(found.reduction.kept.begin(), found.reduction.kept.end());
    std::map<std::string, Json> printed;
    for (const Json& parameter : c.result["parameters"]) {
      printed[parameter["name"]] = parameter;
    }
    expect_terms(c);
    for (const Wanted& wanted : wanted_parameters(found, start_of(c))) {
      const std::string what = c.name + ", " + wanted.name;
      const auto column = std::find(columns.begin(), columns.end(), wanted.name);
      const bool estimated = column != columns.end();
      const bool shown = estimated || wanted.frame || gauge.count(wanted.name) > 0 || kept.count(wanted.name) > 0;
      ASSERT_EQ(printed.count(wanted.name), shown ? 1U : 0U) << what;
      if (!shown) {
        EXPECT_EQ(wanted.error, 0.0) << what << ": not shown and not zero";
        continue;
      }
      const Json& got = printed[wanted.name];
      EXPECT_EQ(got["joint"], wanted.joint.empty() ? Json(nullptr) : Json(wanted.joint)) << what;
      EXPECT_EQ(got["kind"], wanted.kind) << what;
      EXPECT_EQ(got["axis"], wanted.axis) << what;
      EXPECT_NEAR(got["nominal"], wanted.nominal, wanted.frame ? 1e-12 : 0.0) << what;
      EXPECT_NEAR(got["error"], wanted.error, wanted.frame ? 1e-12 : 0.0) << what;
      EXPECT_NEAR(got["value"], wanted.frame ? wanted.value : wanted.nominal + wanted.error, 1e-12) << what;
      EXPECT_NEAR(got["value"], got["nominal"].get<double>() + got["error"].get<double>(), 1e-15) << what;
      EXPECT_EQ(got["gauge"], gauge.count(wanted.name) > 0) << what;
      const auto at = column - columns.begin();
      const double std = estimated                      ? std::sqrt(found.covariance(at, at))
                         : gauge.count(wanted.name) > 0 ? kInfinity
                                                        : 0.0;
      const bool of_column = !wanted.frame || (wanted.kind == "translation" && wanted.name.rfind("base.", 0) != 0);
      if (of_column || !estimated) {  // base and orientations are printed in other axes than those of their columns
        EXPECT_EQ(got["std"], std::isfinite(std) ? Json(std) : Json(nullptr)) << what;
      }
      const auto& tied = found.identifiability.tied;  // biased by what holds one of them
      const bool biased = std::any_of(tied.begin(), tied.end(), [&](const std::vector<std::string>& group) {
        return std::find(group.begin(), group.end(), wanted.name) != group.end();
      });
      EXPECT_EQ(got["identifiable"], estimated && std::isfinite(std) && !biased) << what;
      printed.erase(wanted.name);
    }
    EXPECT_TRUE(printed.empty()) << c.name << ": unexpected " << printed.begin()->first;
  }
}

/// What tables that are withheld at q may yet do to a point there [m^2] in W: what its joint's own motion does to it.
Eigen::Matrix3d covariance_of_withheld(const Case& c, const Eigen::MatrixXd& q, int target) {
  const ErrorModel& model = c.calibration.model;
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const EffectTerm& term : model.effects) {
    if (!is_withheld(term, q(term.index, 0))) {
      continue;
    }
    const auto offset = static_cast<Eigen::Index>(parameter_index(model, "dq" + std::to_string(term.index + 1)));
    constexpr double kStep = 1e-5;  // [rad or m]
    std::array<KDL::Vector, 2> moved;
    for (std::size_t side = 0; side < 2; ++side) {
      Estimate estimate = c.calibration.identification.estimate;
      estimate.errors[offset] += side == 0 ? -kStep : kStep;
      moved[side] = predicted_point(kdl_poses(model, estimate, q).front(), estimate, target);
    }
    const KDL::Vector derivative = (moved[1] - moved[0]) / (2.0 * kStep);
    const double size = term.sigma * table_value(term.table, q(term.index, 0));
    const Eigen::Vector3d motion = size * Eigen::Map<const Eigen::Vector3d>(derivative.data);
    sum += motion * motion.transpose();
  }
  return sum;
}

TEST(ReportJson, PredictionsAreThoseOfKdlAndOfThePropagatedCovariance) {
  const Case gap = table_with_a_gap();
  int withheld = 0;
  for (const Case* of : {&case_of("noise that is stated, predictions"), &case_of("odd arm"), &gap}) {
    const Case& c = *of;
    const std::string& name = c.name;
    const Estimate& estimate = c.calibration.identification.estimate;
    const Eigen::MatrixXd& q = c.options.predict_at.joint_values;
    const std::vector<KDL::Frame> poses = kdl_poses(c.calibration.model, estimate, q);
    const Json& asked = c.result["predicted_accuracy"]["asked"];
    ASSERT_EQ(asked.size(), c.options.predict_at.names.size() * estimate.targets.size()) << name;
    for (std::size_t i = 0; i < asked.size(); ++i) {
      const std::size_t configuration = i / estimate.targets.size();
      const auto target = static_cast<int>(i % estimate.targets.size());
      const Json& point = asked[i];
      EXPECT_EQ(point["configuration"], c.options.predict_at.names[configuration]);
      EXPECT_EQ(point["target"], estimate.targets[static_cast<std::size_t>(target)].name);
      const KDL::Vector p_W = predicted_point(poses[configuration], estimate, target);
      const KDL::Vector p_B = to_kdl(estimate.X_WB).Inverse() * p_W;
      const auto column = static_cast<Eigen::Index>(configuration);
      Eigen::Matrix3d C =
          predicted_covariance(PositionPredictor(c.calibration.model, estimate, c.calibration.free),
                               c.calibration.covariance, q.col(column), static_cast<std::size_t>(target));
      const Eigen::Matrix3d of_withheld = covariance_of_withheld(c, q.col(column), target);
      C += of_withheld;
      withheld += of_withheld.isZero(0.0) ? 0 : 1;
      EXPECT_TRUE(of_withheld.isZero(0.0) || point["outside"]) << name;
      for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        EXPECT_NEAR(point["position"][a], p_B[axis], 1e-12) << name;
        EXPECT_NEAR(point["position_measured_frame"][a], p_W[axis], 1e-12) << name;
        EXPECT_NEAR(point["std"][a], std::sqrt(C(axis, axis)), 1e-12) << name;
      }
      EXPECT_NEAR(point["sigma"], std::sqrt(C(0, 0) + C(1, 1) + C(2, 2)), 1e-12) << name;
      // Of a new measured point: every part of the noise on top.
      const NoiseReport& noise = c.calibration.noise;
      Eigen::Matrix3d sum = C;
      sum.diagonal() += noise.independent.cwiseAbs2() + noise.common.cwiseAbs2() +
                        Eigen::Vector3d::Constant(std::pow(noise.misfit, 2) + std::pow(noise.target_misfit, 2));
      const double s2 = sum.trace();
      const double F = std::pow(point["radius_95"].get<double>() / c.calibration.predicted.radius_factor, 2) / s2;
      const double freedom = std::min(c.calibration.predicted.asked[i].degrees_of_freedom, 1e7);
      EXPECT_NEAR(f_upper_tail(F, s2 * s2 / (sum * sum).trace(), freedom), 0.05, 1e-9) << name;
    }
  }
  EXPECT_GT(withheld, 0) << "no table was withheld anywhere";
}

TEST(ReportJson, WhatIsNotDeterminedIsNullAndTheRestIsNot) {
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

// ---- the table -----------------------------------------------------------------------------------------------------

std::string mm(double metres, int count = 3) { return decimals(metres * 1e3, count); }

std::string row(const std::string& label, const ErrorStatistics& s) {
  const bool any = s.count > 0;
  const auto number = [&](double value) { return any ? mm(value) : std::string("-"); };
  return label + " " + number(s.rms) + " " + number(s.mean) + " " + number(s.p95) + " " + number(s.max) + " " +
         std::to_string(s.count);
}

/// "0.3", "12": up to three digits that count.
std::string three_digits(double value) {
  std::array<char, 64> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, 3).ptr;
  return {text.data(), end};
}

std::string held_out_name(const Calibration& found) {
  return found.leave_one_out ? "leave-one-out" : std::to_string(found.folds) + "-fold";
}

void expect_verdict(std::vector<std::string>& lines, const Case& c) {
  const Calibration& found = c.calibration;
  std::set<int> configurations;
  for (const Observation& o : c.measurements.observations) {
    if (o.split == Split::train) {
      configurations.insert(o.configuration);
    }
  }
  const std::string sizes = std::to_string(configurations.size()) + " configurations, " +
                            std::to_string(found.train.after.count) + " points, " + std::to_string(found.free.size()) +
                            " parameters.";
  if (found.doubts.empty()) {
    lines.push_back("Calibration converged: " + sizes);
  } else {
    for (std::size_t i = 0; i < found.doubts.size(); ++i) {
      lines.push_back((i == 0 ? "NOT TO BE TRUSTED: " : "Also: ") + found.doubts[i].message + ".");
    }
    for (const QualityFinding& finding : found.findings) {
      lines.push_back("Measurements: " + finding.message + ".");
    }
    lines.insert(lines.end(), {"", "Calibration of " + sizes});
  }
  lines.push_back("Position error, rms: nominal " + mm(found.iso_before.accuracy.rms) + " mm -> calibrated " +
                  mm(found.iso_after.accuracy.rms) + " mm (fitted)");
  if (found.test) {
    lines.push_back("at the test rows " + mm(found.iso_test_after->accuracy.rms) + " mm");
  }
  lines.push_back("at unseen configurations " + mm(found.held_out()->after.rms) + " mm (" + held_out_name(found) + ")");
  if (found.held_out()->rigid) {
    lines.push_back("there by the exported URDF alone " + mm(found.held_out()->rigid->rms) + " mm");
  }
}

void expect_accuracies(std::vector<std::string>& lines, const Calibration& found) {
  lines.insert(lines.end(), {"", "position error [mm] rms mean p95 max points"});
  const auto pair = [&](const std::string& what, const ErrorStatistics& before, const ErrorStatistics& after) {
    lines.push_back(row(what + ", nominal", before));
    lines.push_back(row(what + ", calibrated", after));
  };
  pair("fitted", found.iso_before.accuracy, found.iso_after.accuracy);
  if (found.train.rigid) {
    lines.push_back(row("fitted, URDF alone", found.exported.iso.accuracy));
  }
  if (found.iso_test_before) {
    pair("test", found.iso_test_before->accuracy, found.iso_test_after->accuracy);
  }
  if (found.leave_one_out) {
    pair("left out", found.leave_one_out->before, found.leave_one_out->after);
    if (found.leave_one_out->rigid) {
      lines.push_back(row("left out, URDF alone", *found.leave_one_out->rigid));
    }
  }
  if (found.nested_leave_one_out) {
    lines.push_back(row("left out, choice anew", *found.nested_leave_one_out));
  }
  if (found.k_fold) {
    const std::string name = std::to_string(found.folds) + "-fold";
    pair(name, found.k_fold->before, found.k_fold->after);
    if (found.k_fold->rigid) {
      lines.push_back(row(name + ", URDF alone", *found.k_fold->rigid));
    }
  }
  if (found.iso_after.repeatability.count > 0) {
    lines.emplace_back("AP and RP by the formulas of ISO 9283 (not its test cycle), largest:");
    lines.push_back("AP nominal " + mm(found.iso_before.accuracy.max) + " mm, calibrated " +
                    mm(found.iso_after.accuracy.max) + " mm; RP " + mm(found.iso_after.repeatability.max) + " mm");
  }
}

std::string sigmas(const Eigen::Vector3d& s) {
  return s.x() == s.y() && s.y() == s.z() ? mm(s.x()) + " mm" : mm(s.x()) + ", " + mm(s.y()) + ", " + mm(s.z()) + " mm";
}

void expect_noise(std::vector<std::string>& lines, const NoiseReport& noise) {
  const bool stated = noise.model == "stated" || (noise.parts && !noise.parts->estimated[NoiseParts::kIndependent]);
  std::string line = "noise per coordinate: " + sigmas(noise.independent) + " per point";
  if (!noise.common.isZero(0.0)) {
    line += ", " + sigmas(noise.common) + " common to a repeat";
  }
  if (noise.misfit > 0.0) {
    line += ", " + mm(noise.misfit) + " mm common to a configuration";
  }
  if (noise.target_misfit > 0.0) {
    line += ", " + mm(noise.target_misfit) + " mm of a target in a configuration";
  }
  const bool misfits = noise.misfit > 0.0 || noise.target_misfit > 0.0;
  lines.insert(lines.end(),
               {"", line + (stated          ? misfits ? " (as stated, the misfits from the residuals)" : " (as stated)"
                            : noise.repeats ? " (from residuals and repeats)"
                                            : " (from the residuals)")});
}

void expect_choice(std::vector<std::string>& lines, const ModelOption& chosen) {
  const bool priors = chosen.priors.length > 0.0 || chosen.priors.angle > 0.0;
  std::string text = "chosen by cross-validation: ";
  text += priors ? "priors of " + three_digits(chosen.priors.length * 1e3) + " mm and " +
                       three_digits(chosen.priors.angle * 1e3) + " mrad"
                 : "no priors";
  text += ", beyond geometry ";
  for (std::size_t i = 0; i < chosen.effects.size(); ++i) {
    text += (i > 0 ? ", " : "") + chosen.effects[i];
  }
  for (const std::string& part : testing::lines_of(wrapped(text + (chosen.effects.empty() ? "nothing" : ""), 0, 2))) {
    lines.push_back(squeezed(part));
  }
}

void expect_figures(std::vector<std::string>& lines, const Calibration& found) {
  expect_noise(lines, found.noise);
  const double condition = found.identifiability.condition;
  lines.push_back("rank " + std::to_string(found.identifiability.rank) + " of " +
                  std::to_string(found.identifiability.columns) + " parameters, condition number " +
                  (std::isfinite(condition) ? decimals(condition, 0) : "inf") + ", " +
                  std::to_string(found.identification.iterations) + " iterations");
  if (found.identification.convergence_factor > 0.0) {
    lines.push_back("each round left " + decimals(found.identification.convergence_factor, 3) +
                    " of the error of the round before");
  }
  if (found.predicted.workspace.count > 0) {
    lines.emplace_back("1 sigma of a predicted point, from the uncertainty of the parameters alone:");
    lines.push_back(mm(found.predicted.measured.rms) + " mm at the measured configurations, " +
                    mm(found.predicted.workspace.rms) + " mm over the whole workspace");
  }
  if (!found.tried.empty()) {
    expect_choice(lines, found.tried[0]);
  }
}

/// Of joints and links by the joint's type in the URDF.
std::string unit_by_hand(const Case& c, const ParameterEstimate& parameter) {
  const auto slide = std::find_if(c.robot.joints.begin(), c.robot.joints.end(), [&](const MovingJoint& joint) {
    return joint.name == parameter.joint && joint.type == JointType::prismatic;
  });
  const bool of_joint = parameter.kind == "joint_offset";
  return parameter.kind == "translation" || (of_joint && slide != c.robot.joints.end()) ? "mm" : "deg";
}

std::string words_by_hand(const ParameterEstimate& parameter) {
  if (parameter.kind == "joint_offset") {
    return "zero offset of " + parameter.joint;
  }
  const std::string link = parameter.name.substr(2);  // "Tx1"
  return parameter.axis + (parameter.kind == "translation" ? " shift" : " turn") + " of link " + link + " (origin of " +
         parameter.joint + ")";
}

void expect_errors(std::vector<std::string>& lines, const Case& c) {
  lines.insert(lines.end(), {"", "geometric errors, +- half of the 95 % interval"});
  for (const ParameterEstimate& parameter : c.calibration.parameters) {
    if (parameter.name.find('.') != std::string::npos) {
      continue;  // of base, targets and effects
    }
    const std::string unit = unit_by_hand(c, parameter);
    const double factor = unit == "mm" ? 1e3 : kDegreesPerRadian;
    const int digits = unit == "mm" ? 4 : 5;
    std::string line = parameter.name + " " + words_by_hand(parameter) + " " +
                       decimals(parameter.error * factor, digits) + " " + unit + " ";
    if (parameter.identifiable) {
      line += "+- " + decimals(t_quantile(parameter.degrees_of_freedom) * parameter.std * factor, digits);
    } else {
      line += parameter.gauge       ? (parameter.error == 0.0 ? "held, gauge" : "by gauge")
              : parameter.std > 0.0 ? "not determined"
                                    : "fixed";
    }
    lines.push_back(line);
  }
}

/// The joint and how far a group moves or tilts it at most.
std::string motion_by_hand(const std::vector<MovingJoint>& joints, int joint, EffectAxis axis,
                           const Eigen::MatrixXd& moved) {
  const MovingJoint& own = joints[static_cast<std::size_t>(joint)];
  const bool tilts = axis != EffectAxis::own;
  const bool length = own.type == JointType::prismatic && !tilts;
  const auto count = static_cast<Eigen::Index>(joints.size());
  const Eigen::Index tilt = count + Eigen::Index{2} * joint + (axis == EffectAxis::across_y ? 1 : 0);
  const double most = moved.row(tilts ? tilt : joint).cwiseAbs().maxCoeff() * (length ? 1e3 : kDegreesPerRadian);
  const std::string about =
      tilts ? std::string(", ") + (axis == EffectAxis::across_x ? "x" : "y") + " across its axis" : "";
  return own.name + about + " " + decimals(most, length ? 4 : 5) + (length ? " mm" : " deg");
}

/// What a group alone makes of the joint values.
void expect_motions(std::vector<std::string>& lines, const Case& c) {
  const Calibration& found = c.calibration;
  if (found.model.effects.empty()) {
    return;
  }
  lines.insert(lines.end(), {"", "effects beyond geometry, largest motion at the measured configurations"});
  for (const std::string& group : effect_group_names()) {
    ErrorModel alone = found.model;
    alone.effects.clear();
    std::vector<double> values;
    std::set<std::pair<int, EffectAxis>> joints;
    for (std::size_t e = 0; e < found.model.effects.size(); ++e) {
      const EffectTerm& term = found.model.effects[e];
      if (term.group == effect_group(group)) {
        alone.effects.push_back(term);
        values.push_back(found.identification.estimate.effects[static_cast<Eigen::Index>(e)]);
        joints.insert({term.index, term.axis});
      }
    }
    const Eigen::VectorXd all =
        Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
    const auto count = static_cast<Eigen::Index>(c.robot.joints.size());
    Eigen::MatrixXd moved = effective_joint_values(alone, all, c.measurements.joint_values);
    moved.topRows(count) -= c.measurements.joint_values;
    for (const auto& [joint, axis] : joints) {
      lines.push_back(group + " " + motion_by_hand(c.robot.joints, joint, axis, moved));
    }
  }
  for (const std::string& finding : effect_findings(found, effect_motions(found, c.measurements))) {
    lines.push_back(finding);
  }
}

void expect_most_influential(std::vector<std::string>& lines, const Case& c) {
  std::vector<ConfigurationInfluence> left = c.calibration.influence.configurations;
  if (left.empty()) {
    return;
  }
  int influential = 0;
  int high = 0;
  for (const ConfigurationInfluence& entry : left) {
    influential += entry.influential ? 1 : 0;
    high += entry.high_leverage ? 1 : 0;
  }
  lines.insert(lines.end(), {"",
                             "most influential: " + std::to_string(influential) + " of " + std::to_string(left.size()) +
                                 " configurations have a Cook's distance above " +
                                 decimals(c.calibration.influence.cook_limit, 3) + ",",
                             std::to_string(high) + " a high leverage (*)", "configuration Cook's leverage"});
  for (int shown = 0; shown < 5 && !left.empty(); ++shown) {
    auto most = left.begin();
    for (auto entry = left.begin(); entry != left.end(); ++entry) {
      most = entry->cook > most->cook ? entry : most;
    }
    lines.push_back(c.measurements.configurations[static_cast<std::size_t>(most->configuration)] + " " +
                    (std::isfinite(most->cook) ? decimals(most->cook, 3) : "not without") + " " +
                    decimals(most->leverage, 3) + (most->high_leverage ? " *" : ""));
    left.erase(most);
  }
}

void expect_points(std::vector<std::string>& lines, const Calibration& found) {
  const auto place = [](const Eigen::Vector3d& p) { return mm(p.x()) + " " + mm(p.y()) + " " + mm(p.z()); };
  if (!found.predicted.asked.empty()) {
    lines.insert(lines.end(), {"", "predicted, in the base [mm] x y z sigma 95 %"});
  }
  for (const PredictedPoint& point : found.predicted.asked) {
    const std::string accuracy =
        std::isfinite(point.sigma) ? mm(point.sigma) + " " + mm(point.radius_95) : std::string("not determined");
    lines.push_back(point.configuration + " " + point.target + " " + place(point.position) + " " + accuracy);
  }
  const Eigen::Isometry3d& X_WB = found.identification.estimate.X_WB;
  double roll = 0.0;
  double pitch = 0.0;
  double yaw = 0.0;
  to_kdl(X_WB).M.GetRPY(roll, pitch, yaw);
  lines.insert(lines.end(), {"", "base, as measured [mm] x y z", "origin " + place(X_WB.translation())});
  std::string turn = "roll, pitch, yaw [deg]";
  for (const double angle : {roll, pitch, yaw}) {
    turn += " " + decimals(angle * kDegreesPerRadian, 5);
  }
  lines.push_back(turn);
  lines.insert(lines.end(), {"", "targets on the flange [mm] x y z"});
  for (const TargetFrame& target : found.identification.estimate.targets) {
    lines.push_back(target.name + " " + place(target.X_FT.translation()));
  }
}

std::vector<std::string> expected_table(const Case& c) {
  std::vector<std::string> lines;
  expect_verdict(lines, c);
  expect_accuracies(lines, c.calibration);
  expect_figures(lines, c.calibration);
  if (c.calibration.doubts.empty()) {
    expect_errors(lines, c);
    expect_motions(lines, c);
    expect_most_influential(lines, c);
    expect_points(lines, c.calibration);
  }
  return lines;
}

// Long lines are broken: what is expected as one line may be several.
std::string joined_lines(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) {
    text += line + " ";
  }
  return squeezed(text);
}

TEST(ReportTable, EveryLineShowsTheCalibrationsOwnNumbers) {
  std::vector<Case> all = cases();
  all.push_back(painted());
  all.push_back(painted());
  all.back().calibration.doubts.clear();
  for (const Case& c : all) {
    const std::string printed = result_table(c.measurements, c.calibration);
    EXPECT_EQ(joined_lines(testing::lines_of(printed)), joined_lines(expected_table(c))) << c.name << "\n" << printed;
  }
}

TEST(ReportTable, IsAtMostEightyColumnsWide) {
  for (const Case& c : cases()) {
    for (const std::string& line : testing::lines_of(result_table(c.measurements, c.calibration))) {
      EXPECT_LE(line.size(), 80U) << c.name << ": " << line;
    }
  }
}

TEST(ReportTable, BeginsWithTheVerdictAndWhereTheAnswerIs) {
  const Case& good = case_of("plain");
  const auto lines = testing::lines_of(result_table(good.measurements, good.calibration, {.written = {"a.urdf", "b"}}));
  EXPECT_EQ(lines.at(0), "Calibration converged: 25 configurations, 75 points, 33 parameters.");
  EXPECT_EQ(lines.at(3), "Written: a.urdf, b");
  const Case& bad = case_of("a joint that never moves");
  const std::string doubted = result_table(bad.measurements, bad.calibration);
  EXPECT_EQ(doubted.rfind("NOT TO BE TRUSTED: the measurements do not determine", 0), 0U) << doubted;
  EXPECT_EQ(doubted.find("geometric errors"), std::string::npos) << doubted;
}

TEST(ReportTable, NumbersStandBelowTheirHeadingsUpToKilometres) {
  ErrorStatistics large{.count = 1234567, .mean = 1000.0, .rms = 1000.0, .p95 = 1000.0, .max = 1000.0};
  const std::string heading = statistics_heading("position error [mm]");
  const std::string row = statistics_row("left out, choice anew", large);
  EXPECT_EQ(heading.size(), 81U);
  EXPECT_EQ(testing::word_ends(heading.substr(0, 80), 5), testing::word_ends(row.substr(0, 80), 5)) << heading << row;
  EXPECT_EQ(testing::word_ends(statistics_row("none", {}).substr(0, 80), 5), testing::word_ends(row.substr(0, 80), 5));
}

TEST(ReportTable, NamesTheChosenPriorsInMillimetresAndMilliradians) {
  Calibration found;
  found.tried.push_back({.priors = {.length = 3e-4, .angle = 1e-3}, .effects = {"gravity", "gain"}});
  const std::string table = result_table({}, found);
  EXPECT_NE(table.find("chosen by cross-validation: priors of 0.3 mm and 1 mrad, beyond geometry\n  gravity, gain\n"),
            std::string::npos)
      << table;
}

TEST(ReportTable, SaysWhatWasFixedAndWhatIsNotKnown) {
  Calibration found = case_of("plain").calibration;
  found.leave_one_out.reset();
  for (ParameterEstimate& parameter : found.parameters) {
    if (parameter.name == "dq2") {
      parameter.identifiable = false;
      parameter.std = 0.0;
    }
  }
  const std::string table = result_table(case_of("plain").measurements, found, {.fixed = "fixed by --fix"});
  EXPECT_THAT(table, ::testing::ContainsRegex("  dq2   zero offset of joint_2 .* deg  fixed by --fix\n"));
  EXPECT_THAT(table, ::testing::HasSubstr("\n                      at unseen configurations: not known\n"));
}

// q2 = -J2, q3 = J2 + J3: what is to be added to J2 is -dq2, to J3 dq3 + dq2.
TEST(ReportTable, ShowsJointOffsetsAsTheControllerCounts) {
  const Case& c = case_of("plain");
  JointConvention convention{.controller_joints = {"J1", "J2", "J3", "J4", "J5", "J6"},
                             .urdf_joints = {"joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"},
                             .matrix = Eigen::MatrixXd::Identity(6, 6),
                             .offset = Eigen::VectorXd::Zero(6)};
  convention.matrix(1, 1) = -1.0;
  convention.matrix(2, 1) = 1.0;
  const double dq2 = parameter_of(c.calibration, "dq2").error * kDegreesPerRadian;
  const double dq3 = parameter_of(c.calibration, "dq3").error * kDegreesPerRadian;
  const std::string table = result_table(c.measurements, c.calibration, {.convention = &convention});
  const auto lines = testing::lines_of(table);
  const auto heading = std::find(lines.begin(), lines.end(), "joint offsets as the controller counts, for mastering");
  ASSERT_LT(heading + 3, lines.end()) << table;
  EXPECT_EQ(squeezed(heading[2]), "J2 " + decimals(-dq2, 5) + " deg");
  EXPECT_EQ(squeezed(heading[3]), "J3 " + decimals(dq3 + dq2, 5) + " deg");
}

// ---- units of the table --------------------------------------------------------------------------------------------

/// A calibration of which nothing is known but one estimated parameter, with this error and 1 sigma.
Calibration with_one_parameter(const ErrorModel& model, const std::string& name, double error, double std) {
  Calibration calibration;
  calibration.model = model;
  calibration.identification.estimate.errors =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  const char* kind = name.rfind("dq", 0) == 0 ? "joint_offset" : name.front() == 'T' ? "translation" : "rotation";
  calibration.parameters.push_back({.name = name,
                                    .joint = "j",
                                    .kind = kind,
                                    .error = error,
                                    .std = std,
                                    .degrees_of_freedom = kInfinity,
                                    .identifiable = true});
  return calibration;
}

std::string line_of(const Calibration& calibration, const std::string& name) {
  Measurements none;
  none.joint_values.resize(static_cast<Eigen::Index>(calibration.model.joints.size()), 0);
  for (const std::string& line : testing::lines_of(result_table(none, calibration))) {
    if (squeezed(line).rfind(name + " ", 0) == 0) {
      return squeezed(line);
    }
  }
  return "no line of " + name;
}

TEST(ReportUnits, EachParameterIsPrintedInTheUnitOfItsKind) {
  const ErrorModel model = complete_model(parse_robot(kOddArm));
  const double degree = 1.0 / kDegreesPerRadian;
  struct Printed {
    const char* name;
    double per_unit;  // SI
    const char* printed;
  };
  // Joint 2 is prismatic.
  for (const Printed& c :
       {Printed{"dq1", degree, "1.25000 deg +- 0.97998"}, Printed{"dq2", 1e-3, "1.2500 mm +- 0.9800"},
        Printed{"dq3", degree, "1.25000 deg +- 0.97998"}, Printed{"Tx1", 1e-3, "1.2500 mm +- 0.9800"},
        Printed{"Ry3", degree, "1.25000 deg +- 0.97998"}}) {
    const Calibration found = with_one_parameter(model, c.name, 1.25 * c.per_unit, 0.5 * c.per_unit);
    EXPECT_THAT(line_of(found, c.name), ::testing::EndsWith(std::string(" ") + c.printed));
  }
}

// ---- the model's JSON ----------------------------------------------------------------------------------------------

TEST(ReportModel, ListsWhatIsKeptAndTheGaugeInDeclaredOrder) {
  for (const bool poses : {false, true}) {
    for (const Robot& robot : {fanuc(), parse_robot(kOddArm)}) {
      const ErrorModel model = complete_model(robot);
      const std::vector<TargetFrame> targets =
          poses ? with_orientation(generic_targets(1)) : std::vector<TargetFrame>(generic_targets(2));
      const Reduction reduction = reduced_model(model, targets);
      const std::set<std::string> kept(reduction.kept.begin(), reduction.kept.end());
      Estimate estimate{.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size())),
                        .targets = targets};
      Calibration nominal;
      nominal.model = model;
      nominal.identification.estimate = estimate;
      Expected expected;
      std::size_t i = 0;
      for (const Wanted& wanted : wanted_parameters(nominal, estimate)) {
        const bool gauge = std::any_of(reduction.gauge.begin(), reduction.gauge.end(),
                                       [&](const GaugeParameter& g) { return g.name == wanted.name; });
        if (kept.count(wanted.name) > 0 || gauge) {
          const std::string path = "/parameters/" + std::to_string(i++);
          expected.is(path + "/name", wanted.name);
          expected.is(path + "/joint", wanted.joint.empty() ? Json(nullptr) : Json(wanted.joint));
          expected.is(path + "/kind", wanted.kind);
          expected.is(path + "/axis", wanted.axis);
          expected.number(path + "/nominal", wanted.frame ? 0.0 : wanted.nominal);
          expected.is(path + "/identifiable", !gauge);
          expected.is(path + "/gauge", gauge);
        }
      }
      EXPECT_EQ(i, kept.size() + reduction.gauge.size());
      expect_reduction(expected, "", reduction);
      expected.compare(Json::parse(model_json(model, targets, reduction)), robot.name);
    }
  }
}

}  // namespace
}  // namespace kdl_calibration::report_test
