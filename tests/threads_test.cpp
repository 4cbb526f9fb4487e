#include <gmock/gmock.h>

#include <barrier>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <numeric>
#include <regex>
#include <set>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "calibration/calibration_settings.hpp"
#include "estimation/residual_options.hpp"
#include "every_header.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "kdl_calibration/validation.hpp"
#include "measurements/training_rows.hpp"
#include "mistakes_support.hpp"
#include "two_step/two_step.hpp"

namespace kdl_calibration::threads_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::Measured;

template <class Value>
concept Scalar = std::is_arithmetic_v<Value> || std::is_enum_v<Value>;

double number(Scalar auto value) { return static_cast<double>(value); }
template <class Derived>
double number(const Eigen::MatrixBase<Derived>& matrix) {
  return matrix.sum();
}
double number(const std::string& text) { return std::accumulate(text.begin(), text.end(), 0.0); }
double number(const Eigen::Isometry3d& pose) { return pose.matrix().sum(); }
template <class Value>
double number(const std::vector<Value>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0,
                         [](double sum, const Value& value) { return 0.99 * sum + number(value); });
}
double number(const Estimate& estimate) {
  double sum = estimate.errors.sum() + estimate.frames.base().matrix().sum() + estimate.effects.sum();
  for (const TargetFrame& target : estimate.frames.targets) {
    sum += target.X_FT.matrix().sum();
  }
  return sum;
}
double number(const ColumnRange& range) { return static_cast<double>(100 * range.first + range.count); }
double number(const NormalEquations& equations) {
  return equations.hessian.sum() + equations.gradient.sum() + equations.cost;
}
double number(const Measurements& measurements) {
  double sum = measurements.joint_values.sum();
  for (const Observation& observation : measurements.observations) {
    sum += observation.position().sum() + observation.configuration;
  }
  return sum;
}
double number(const NoiseModel& noise) { return noise.independent.sum() + noise.common.sum() + noise.misfit; }

/// A question about objects that threads share, answered by a number that hangs on all of the answer.
struct Asked {
  template <class Ask>
  Asked(std::string what, Ask question) : name(std::move(what)), ask([question] { return number(question()); }) {}

  std::string name;
  std::function<double()> ask;
};

/// Objects of every class of the public API, made once and then constant.
struct Shared {
  Robot robot = testing::fanuc();
  Measured measured = with_test_rows(testing::measured(complete_model(robot), 1, {.configurations = 24, .repeats = 2}));
  const ErrorModel& model = measured.model;
  const Measurements& data = measured.data;
  const Unknowns& free = measured.free;
  Estimate start = nominal_start(model, data);
  CalibrationSettings options = {.threads = 1};
  CalibrationResult calibration = calibrate(model, data, options);
  Calibration found =
      kdl_calibration::calibrate(robot, data, CalibrationOptions{.diagnosis = {.try_readings = false}, .threads = 1});
  CalibratedArm calibrated = found.arm();
  Compensator compensator{found};
  const Estimate& estimate = calibration.fit.identification.estimate;
  FitProblem fit_problem{.model = model, .measurements = data, .start = estimate, .free = free};
  TrainingRows rows{data};
  TrainingProblem training{fit_problem};
  LeastSquaresProblem problem{model, data, free};
  PositionPredictor predictor{model, estimate, free};
  ChainFolder folder{model, {0, 1, 2}};
  EffectTerm gain{.name = "gain.1", .joint = model.joints.front().name, .function = JointGain{}};
  ArmKinematics arm{model, estimate.errors, {}};
  VectorXd q = data.joint_values.col(0);
  std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, data.joint_values);
  WhitenedSummary summary = problem.whitened_summary(estimate);
  MatrixXd C = covariance(summary.sqrt_information, 1e-9);
  NoiseParts parts = estimate_noise(model, data, estimate, free, {});
  ResidualOptions residuals{.row_weights = std::vector<double>(data.observations.size(), 0.5)};
  LinearSums sums{.information = summary.sqrt_information.transpose() * summary.sqrt_information,
                  .moment = VectorXd::Ones(free.size()),
                  .squares = 1e3,
                  .equations = 200.0};
  std::vector<Index> columns = all_columns(free.size());
  SizeEstimator sizes{sums, columns, {{6, 7, 8}}};
  std::vector<std::vector<Index>> folds = make_folds(data, 4);
  OptionError error{"noise", "is none", {"weights"}};
  Experiment experiment = nominal_experiment(model, estimate.frames.targets);
  Doubt doubt{.subjects = {{SubjectKind::joint, "joint_2"}}, .figures = {{"misfit", 0.5}}};
  AlternativeReading reading{.message = "they are feet"};
  TruthComparison comparison = compare_with_truth(model, estimate, start, data.joint_values);

  static Measured with_test_rows(Measured measured) {
    for (Observation& observation : measured.data.observations) {
      observation.split = observation.configuration % 6 == 0 ? Split::test : Split::train;
    }
    return measured;
  }
  static std::vector<Index> all_columns(Index count) {
    std::vector<Index> columns(static_cast<std::size_t>(count));
    std::iota(columns.begin(), columns.end(), Index{0});
    return columns;
  }
};

const Shared& shared() {
  static const Shared instance;
  return instance;
}

std::vector<Asked> methods_of_estimation() {
  const Shared& s = shared();
  const Unknowns& free = s.free;
  const Estimate& estimate = s.estimate;
  const VectorXd step = VectorXd::Constant(free.size(), 1e-6);
  const PriorRows rows = prior_rows(free, {.priors = {.length = 1e-3, .angle = 1e-3}, .noise = {}, .row_weights = {}});
  return {
      {"Unknowns::with", [&] { return free.with(s.model, UnknownGroup::base, {1}).names(); }},
      {"Unknowns::with_group", [&] { return free.with_group(s.model, UnknownGroup::geometric).names(); }},
      {"Unknowns::without", [&] { return free.without(UnknownGroup::targets).names(); }},
      {"Unknowns::subset", [&] { return free.subset(std::vector<bool>(free.columns().size(), true)).names(); }},
      {"Unknowns::size", [&] { return free.size(); }},
      {"Unknowns::columns", [&] { return free.columns().size(); }},
      {"Unknowns::names", [&] { return free.names(); }},
      {"Unknowns::column",
       [&] { return free.column(free.names().back()).value() + free.column(UnknownGroup::base, 3).value(); }},
      {"Unknowns::columns_at_station", [&] { return free.columns_at_station(0).size(); }},
      {"Unknowns::of_station", [&] { return free.of_station(0).names(); }},
      {"Unknowns::base_columns", [&] { return free.base_columns(0)[2]; }},
      {"Unknowns::target_columns", [&] { return free.target_columns(1)[2]; }},
      {"Unknowns::range", [&] { return free.range(UnknownGroup::targets); }},
      {"Unknowns::chain", [&] { return free.chain(); }},
      {"Unknowns::of", [&] { return free.of(UnknownGroup::targets).back(); }},
      {"Unknowns::geometric", [&] { return free.geometric().back(); }},
      {"Unknowns::effects", [&] { return free.effects().size(); }},
      {"Unknowns::order_of_choice", [&] { return free.order_of_choice().back(); }},
      {"Unknowns::move",
       [&, step] {
         Estimate moved = estimate;
         free.move(estimate, step, moved);
         return moved;
       }},
      {"Unknowns::moved", [&, step] { return free.moved(estimate, step); }},
      {"Unknowns::difference", [&] { return free.difference(s.start, estimate).sum(); }},
      {"Unknowns::values", [&] { return free.values(estimate).sum(); }},
      {"PriorRows::information", [&, rows] { return rows.information().sum(); }},
      {"PriorRows::residuals", [&, rows] { return rows.residuals(free.values(estimate)).sum(); }},
      {"Unknowns::prior_information", [&] { return free.prior_information({.length = 1e-3, .angle = 1e-3}).sum(); }},
      {"ColumnRange::end", [&] { return free.chain().end(); }},
      {"ColumnRange::empty", [&] { return free.chain().empty(); }},
      {"LeastSquaresProblem::linearise",
       [&] {
         LeastSquaresProblem::Workspace own;
         NormalEquations equations;
         s.problem.linearise(estimate, own, equations);
         return number(equations) + number(s.problem.linearise(s.start));
       }},
      {"LeastSquaresProblem::cost",
       [&] {
         LeastSquaresProblem::Workspace own;
         return s.problem.cost(estimate) + s.problem.cost(s.start, own);
       }},
      {"LeastSquaresProblem::whitened", [&] { return s.problem.whitened(estimate).jacobian.sum(); }},
      {"LeastSquaresProblem::whitened_summary",
       [&] { return s.problem.whitened_summary(estimate).sqrt_information.sum(); }},
      {"LeastSquaresProblem::model", [&] { return s.problem.model().parameters.size(); }},
      {"LeastSquaresProblem::unknowns", [&] { return s.problem.unknowns().size(); }},
      {"LeastSquaresProblem::columns", [&] { return s.problem.columns(); }},
      {"LeastSquaresProblem::equations", [&] { return s.problem.equations(); }},
      {"LeastSquaresProblem::points", [&] { return s.problem.points(); }},
      {"LeastSquaresProblem::cost_of_repeats", [&] { return s.problem.cost_of_repeats(); }},
      {"LeastSquaresProblem::total_weight", [&] { return s.problem.total_weight(); }},
  };
}

std::vector<Asked> other_methods() {
  const Shared& s = shared();
  return {
      {"ArmKinematics::joints", [&] { return s.arm.joints(); }},
      {"ArmKinematics::flange_pose",
       [&] {
         Matrix6Xd jacobian;
         return s.arm.flange_pose(s.q, jacobian).matrix().sum() + s.arm.flange_pose(s.q).matrix().sum() +
                jacobian.sum();
       }},
      {"EffectTerm::group", [&] { return s.gain.group(); }},
      {"ChainFolder::shape", [&] { return s.folder.shape().links.size(); }},
      {"ChainFolder::fold",
       [&] {
         FoldedChain chain = s.folder.shape();
         std::vector<ParameterTwist> twists(3);
         s.folder.fold(s.estimate.errors, chain, twists, 0);
         return flange_pose(chain, s.q).matrix().sum();
       }},
      {"PositionPredictor::jacobians", [&] { return s.predictor.jacobians(s.q).back().sum(); }},
      {"Observation::position", [&] { return (*s.rows).observations.back().position().sum(); }},
      {"Observation::orientation", [&] { return (*s.rows).observations.back().orientation() == nullptr; }},
      {"TrainingRows::all", [&] { return number(s.rows.all().observations.size()); }},
      {"TrainingRows::has_others", [&] { return s.rows.has_others(); }},
      {"TrainingRows::values_of", [&] { return s.rows.values_of(s.residuals.row_weights); }},
      {"TrainingRows::values_among_all",
       [&] { return s.rows.values_among_all(std::vector<double>((*s.rows).observations.size(), 2.0), 1.0); }},
      {"TrainingProblem::rows", [&] { return number(*s.training.rows()) + number((*s.training).start); }},
      {"NoiseModel::is_absolute", [&] { return s.options.noise.stated.is_absolute(); }},
      {"NoiseModel::has_misfit", [&] { return s.options.noise.stated.has_misfit(); }},
      {"NoiseModel::is_isotropic", [&] { return s.options.noise.stated.is_isotropic(); }},
      {"NoiseModel::is_alike_in_every_direction", [&] { return s.options.noise.stated.is_alike_in_every_direction(); }},
      {"ResidualOptions::row_weight", [&] { return s.residuals.row_weight(3); }},
      {"NoiseParts::estimates_misfit", [&] { return s.parts.estimates_misfit(); }},
      {"NoiseParts::misfit", [&] { return s.parts.misfit(); }},
      {"NoiseParts::target_misfit", [&] { return s.parts.target_misfit(); }},
      {"NoiseParts::common", [&] { return s.parts.common().sum(); }},
      {"NoiseParts::independent", [&] { return s.parts.independent().sum(); }},
      {"NoiseParts::model", [&] { return s.parts.model({}); }},
      {"NoiseParts::point", [&] { return s.parts.point().sum(); }},
      {"NoiseParts::freedom", [&] { return s.parts.freedom(1e-9, NoiseParts::Variances::Ones()); }},
      {"NoiseParts::freedom_of_point", [&] { return s.parts.freedom_of_point(); }},
      {"ResidualNoise::total", [&] { return noise_from_residuals(s.summary, 30, 1.0).total(); }},
      {"NoiseReport::freedom_of_covariance", [&] { return s.calibration.noise.freedom_of_covariance(); }},
      {"CalibrationResult::trusted", [&] { return s.calibration.trusted(); }},
      {"CalibrationResult::verdict", [&] { return s.calibration.verdict(); }},
      {"MeasuredRegion::holds",
       [&] { return s.calibration.uncertainty.predicted.region.holds(s.q, Eigen::Matrix3d::Zero()); }},
      {"Freedom::left", [&] { return registered_errors(s.X_BF, s.data, s.data, {}).freedom.left(); }},
      {"Freedom::spent", [&] { return registered_errors(s.X_BF, s.data, s.data, {}).freedom.spent(); }},
      {"Freedom::upper_95", [&] { return registered_errors(s.X_BF, s.data, s.data, {}).freedom.upper_95(); }},
      {"Freedom::correction", [&] { return registered_errors(s.X_BF, s.data, s.data, {}).freedom.correction(); }},
      {"Calibration::verdict", [&] { return s.found.verdict(); }},
      {"Calibration::doubts", [&] { return s.found.doubts().size(); }},
      {"Calibration::warnings", [&] { return s.found.warnings(); }},
      {"Calibration::remarks", [&] { return messages_of(s.found.remarks()); }},
      {"Doubt::names", [&] { return s.doubt.names(SubjectKind::joint); }},
      {"Doubt::figure", [&] { return s.doubt.figure("misfit").value(); }},
      {"AlternativeReading::as_doubt", [&] { return s.reading.as_doubt().message; }},
      {"Calibration::accuracy", [&] { return s.found.accuracy().train.after.rms; }},
      {"Calibration::parameters", [&] { return s.found.parameters().size(); }},
      {"Calibration::parameter", [&] { return s.found.parameter("Tx1").value; }},
      {"Calibration::error", [&] { return s.found.error("Tx1"); }},
      {"Calibration::std", [&] { return s.found.std("Tx1"); }},
      {"Calibration::estimated", [&] { return s.found.estimated(); }},
      {"Calibration::covariance", [&] { return s.found.covariance().sum(); }},
      {"Calibration::arm", [&] { return s.found.arm().flange_pose(s.q).matrix().sum(); }},
      {"Calibration::at", [&] { return s.found.at({}).parameters().size(); }},
      {"NoiseReport::sigma_at", [&] { return s.calibration.noise.sigma_at(0); }},
      {"Compensator::calibrated_pose", [&] { return s.compensator.calibrated_pose(s.q).matrix().sum(); }},
      {"Compensator::nominal_joint_values",
       [&] { return s.compensator.nominal_joint_values(s.X_BF[1], s.q).has_value(); }},
      {"Calibration::urdf_chain", [&] { return s.found.urdf_chain().getNrOfSegments(); }},
      {"Calibration::parts", [&] { return s.found.parts().urdf_errors.sum(); }},
      {"CalibratedArm::joints", [&] { return s.calibrated.joints(); }},
      {"CalibratedArm::targets", [&] { return s.calibrated.targets(); }},
      {"CalibratedArm::stations", [&] { return s.calibrated.stations().size(); }},
      {"CalibratedArm::measured_ranges", [&] { return s.calibrated.measured_ranges().front().second; }},
      {"CalibratedArm::undetermined_motion", [&] { return s.calibrated.undetermined_motion(s.q); }},
      {"CalibratedArm::base", [&] { return s.calibrated.base().matrix().sum(); }},
      {"CalibratedArm::flange_pose", [&] { return s.calibrated.flange_pose(s.q).matrix().sum(); }},
      {"CalibratedArm::predict", [&] { return s.calibrated.predict(s.q, "A").radius_95; }},
      {"Compensator::nominal_pose", [&] { return s.compensator.nominal_pose(s.q).matrix().sum(); }},
      {"Compensator::spread_of_ways", [&] { return s.compensator.spread_of_ways(s.X_BF[1]); }},
      {"Compensator::solve",
       [&] {
         return s.compensator.solve(s.q).joint_values.sum() + s.compensator.solve(s.X_BF[1], s.q).position_error;
       }},
      {"Accuracy::held_out", [&] { return s.calibration.accuracy.held_out()->after.rms; }},
      {"SizeEstimator::is_determined", [&] { return s.sizes.is_determined(); }},
      {"SizeEstimator::estimate", [&] { return s.sizes.estimate({}, {}, 1e-9).values.sum(); }},
      {"Comparison::has_changed", [] { return Comparison{.p_value = 1e-4}.has_changed(); }},
      {"TruthComparison::comparable", [&] { return s.comparison.comparable(); }},
      {"OptionError::option", [&] { return s.error.option(); }},
      {"OptionError::fault", [&] { return s.error.fault(); }},
      {"OptionError::remedies", [&] { return s.error.remedies(); }},
  };
}

std::vector<Asked> functions_up_to_estimation() {
  const Shared& s = shared();
  const FitProblem& fit_problem = s.fit_problem;
  return {
      {"complete_model", [&] { return complete_model(s.robot).parameters.size(); }},
      {"error_chain", [&] { return difference_to_kdl(s.model, s.estimate.errors, s.data.joint_values); }},
      {"flange_poses", [&] { return flange_poses(s.model, s.estimate, s.data.joint_values); }},
      {"reduced_model", [&] { return reduced_model(s.model, s.estimate.frames.targets).kept; }},
      {"subset", [&] { return subset(s.data, [](const Observation& row) { return row.target == 1; }); }},
      {"averaged", [&] { return averaged(s.data); }},
      {"training_sample", [&] { return training_sample(s.data, 5); }},
      {"trained_ranges", [&] { return trained_ranges(s.data).front().first; }},
      {"joined", [&] { return joined(s.data, s.data); }},
      {"register_base_and_targets", [&] { return register_base_and_targets(s.X_BF, s.data).rms; }},
      {"identify_jointly", [&] { return identify_jointly(s.model, s.data, s.start, s.free).estimate; }},
      {"identify_robustly", [&] { return identify_robustly(fit_problem).weights; }},
      {"identify_in_two_steps",
       [&] {
         const std::function<Measurements(int)> same = [&](int) { return s.data; };
         return identify_in_two_steps(s.model, same, s.start, s.free.geometric(), {.rounds = 2}).estimate;
       }},
      {"identification_jacobian", [&] { return identification_jacobian(s.model, s.estimate, s.free, s.q).sum(); }},
  };
}

std::vector<Asked> functions_of_assessment() {
  const Shared& s = shared();
  const FitProblem& fit_problem = s.fit_problem;
  return {
      {"identifiability", [&] { return identifiability(s.summary.sqrt_information, s.free.names()).condition; }},
      {"covariance", [&] { return covariance(s.summary, noise_from_residuals(s.summary, 30, 1.0), 1.0).sum(); }},
      {"PositionPredictor", [&] { return s.predictor.jacobians(s.q)[1].sum(); }},
      {"noise_from_repeats", [&] { return noise_from_repeats(s.data).total.sum(); }},
      {"estimate_noise", [&] { return estimate_noise(s.model, s.data, s.estimate, s.free, {}).variances.sum(); }},
      {"test_lack_of_fit", [&] { return test_lack_of_fit(s.model, s.data, s.estimate, s.free).has_value(); }},
      {"explained_by_joints", [&] { return explained_by_joints(s.model, s.estimate, s.data); }},
      {"influence",
       [&] {
         return influence(s.problem, s.data, {}, s.estimate, s.summary.sqrt_information).configurations.back().cook;
       }},
      {"pseudo_values",
       [&] {
         const std::vector<double>& weights = s.residuals.row_weights;
         return pseudo_values(s.model, s.data, s.estimate, Loss::huber, weights).measurements;
       }},
      {"position_errors", [&] { return position_errors(s.model, s.estimate, s.data); }},
      {"iso_9283", [&] { return iso_9283(s.model, s.estimate, s.data).repeatability.rms; }},
      {"make_folds", [&] { return make_folds(s.data, 4).back().back(); }},
      {"can_be_left_out", [&] { return can_be_left_out(s.data, s.folds, s.free.size()); }},
      {"cross_validate", [&] { return cross_validate(fit_problem, s.folds, 2).distances; }},
      {"cross_validate_by_sums", [&] { return cross_validate_by_sums(fit_problem, s.folds, 3e-5, 2).distances; }},
      {"predict_folds",
       [&] {
         const FoldTask task{.problem = fit_problem, .sqrt_information = s.summary.sqrt_information, .noise = 3e-5};
         return distances_of(predict_folds(task, s.folds, 2));
       }},
      {"check_measurements", [&] { return check_measurements(s.model, s.data, s.estimate).size(); }},
      {"try_conventions", [&] { return try_conventions(s.model, s.data, s.free, {.threads = 2}).front().rms; }},
      {"alternative_readings",
       [&] { return alternative_readings(s.model, s.data, s.estimate, s.free, {.threads = 2}).size(); }},
  };
}

std::vector<Asked> functions_of_whole_jobs() {
  const Shared& s = shared();
  return {
      {"calibrate", [&] { return calibrate(s.model, s.data, {.threads = 2}).fit.identification.estimate; }},
      {"calibrated_urdf", [&] { return calibrated_urdf(s.robot, s.calibration); }},
      {"result_json", [&] { return result_json(s.robot, s.data, s.calibration); }},
      {"result_table", [&] { return result_table(s.data, s.calibration); }},
      {"residuals_csv", [&] { return residuals_csv(s.data, s.calibration); }},
      {"parse_calibration",
       [&] {
         const std::string json = result_json(s.robot, s.data, s.calibration);
         return parse_calibration(json, s.robot, "the result").estimate;
       }},
      {"information", [&] { return information(s.experiment, s.data).sum(); }},
      {"predicted",
       [&] {
         const MatrixXd sum = information(s.experiment, s.data.joint_values);
         return predicted(s.experiment, sum, s.data.joint_values, 2).sigma.rms;
       }},
      {"compare_with_truth",
       [&] { return compare_with_truth(s.model, s.estimate, s.start, s.data.joint_values).gauge_misfit; }},
  };
}

void expect_the_same_from_two_threads(const std::vector<Asked>& questions) {
  for (const Asked& asked : questions) {
    const double expected = asked.ask();
    std::vector<double> found(2);
    std::barrier together(2);
    const auto answer = [&](double& own) {
      together.arrive_and_wait();
      own = asked.ask();
    };
    std::thread other(answer, std::ref(found[1]));
    answer(found[0]);
    other.join();
    EXPECT_EQ(found, std::vector<double>(2, expected)) << asked.name;
  }
}

TEST(Threads, MayCallConstMethodsOfOneEstimation) { expect_the_same_from_two_threads(methods_of_estimation()); }

TEST(Threads, MayCallConstMethodsOfOneObject) { expect_the_same_from_two_threads(other_methods()); }

TEST(Threads, MayEstimateFromTheSameMeasurements) { expect_the_same_from_two_threads(functions_up_to_estimation()); }

TEST(Threads, MayAssessTheSameFit) { expect_the_same_from_two_threads(functions_of_assessment()); }

TEST(Threads, MayDoTheWholeJobOnTheSameMeasurements) { expect_the_same_from_two_threads(functions_of_whole_jobs()); }

// The names of const methods in the public headers and those of every wing; operators are asked beside the others of
// their class.
std::set<std::string> const_methods() {
  const std::regex declaration(R"((\w+)\(([^;{}()]|\([^()]*\))*\)\s*const\s*[;{])");
  const std::set<std::string> of_nobody_else = {"all_values", "gamma"};  // private
  std::set<std::string> names;
  std::vector<std::filesystem::path> headers;
  for (const auto& header :
       std::filesystem::directory_iterator(std::string(PROJECT_DIR) + "/include/kdl_calibration")) {
    headers.push_back(header.path());
  }
  std::ifstream list(std::string(PROJECT_DIR) + "/tests/every_header.hpp");
  for (std::string line; std::getline(list, line);) {
    if (const std::size_t name = line.find('"'); name != std::string::npos) {
      headers.push_back(std::string(PROJECT_DIR) + "/src/" + line.substr(name + 1, line.size() - name - 2));
    }
  }
  for (const auto& header : headers) {
    std::ifstream file(header);
    const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    for (std::sregex_iterator found(text.begin(), text.end(), declaration); found != std::sregex_iterator(); ++found) {
      if (of_nobody_else.count((*found)[1]) == 0) {
        names.insert((*found)[1]);
      }
    }
  }
  return names;
}

TEST(Threads, AreTriedOnEveryConstMethodOfTheHeaders) {
  std::set<std::string> asked;
  for (const std::vector<Asked>& questions : {methods_of_estimation(), other_methods()}) {
    for (const Asked& question : questions) {
      asked.insert(question.name.substr(question.name.find("::") + 2));
    }
  }
  EXPECT_THAT(asked, ::testing::IsSupersetOf(const_methods()));
  EXPECT_GT(const_methods().size(), 50U);
}

}  // namespace
}  // namespace kdl_calibration::threads_test
