#include "validation/fold_prediction.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include "base/decompositions.hpp"
#include "base/parallel.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "model/kinematics.hpp"
#include "uncertainty/configuration_system.hpp"
#include "uncertainty/unit_columns.hpp"
#include "validation/folds.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kAsGoodAsLinear = 0.1;       // of the noise
constexpr double kExactPrediction = 1e-10;    // [m]
constexpr double kLeftOfInformation = 1e-10;  // least eigenvalue of the rest's information relative to the whole

struct Part {
  std::vector<HeldOutPoint> points;
  bool refitted = false;
  bool converged = true;
};

// Covariance C and step dy, in columns multiplied by R, without a fold of rows B, e: C = (I - B^T B)^-1, dy = -C B^T e.
// If the fold has fewer rows than columns, with G = (I - B B^T)^-1
//   C = I + B^T G B,  dy = -B^T G e.
class WithoutFold {
public:
  WithoutFold(std::span<const ConfigurationSystem> fold, Index columns) {
    Index rows = 0;
    for (const ConfigurationSystem& system : fold) {
      rows += system.B.rows();
    }
    B_.resize(rows, columns);
    VectorXd e(rows);
    Index row = 0;
    for (const ConfigurationSystem& system : fold) {
      B_.middleRows(row, system.B.rows()) = system.B;
      e.segment(row, system.e.size()) = system.e;
      row += system.B.rows();
    }
    narrow_ = rows < columns;
    MatrixXd left = MatrixXd::Identity(narrow_ ? rows : columns, narrow_ ? rows : columns);
    if (narrow_) {
      left.noalias() -= B_ * B_.transpose();
    } else {
      left.noalias() -= B_.transpose() * B_;
    }
    const Eigen::LDLT<MatrixXd> factor(left);
    determined_ = factor.info() == Eigen::Success && factor.vectorD().minCoeff() > kLeftOfInformation;
    if (determined_) {
      inverse_ = factor.solve(MatrixXd::Identity(left.rows(), left.cols()));
    } else {  // the inverse in the directions that the rest determines
      const auto [values, vectors] = spectrum(left);
      const Index undetermined = (values.array() <= kLeftOfInformation).count();
      const auto determined = vectors.rightCols(values.size() - undetermined);
      inverse_ =
          determined * values.tail(values.size() - undetermined).cwiseInverse().asDiagonal() * determined.transpose();
      undetermined_ = narrow_ ? MatrixXd(B_.transpose() * vectors.leftCols(undetermined))
                              : MatrixXd(vectors.leftCols(undetermined));
    }
    if (rows > 0) {
      step_ = narrow_ ? VectorXd(-B_.transpose() * (inverse_ * e)) : VectorXd(-inverse_ * (B_.transpose() * e));
    }
  }

  bool is_determined() const { return determined_; }
  const VectorXd& step() const { return step_; }
  // J C J^T; infinite if the rest does not determine all of it.
  Matrix3d covariance(const MatrixXd& J) const {
    constexpr double kNone = 1e-6;  // of J
    if (undetermined_.cols() > 0 && (J * undetermined_).norm() > kNone * J.norm()) {
      return Matrix3d::Constant(std::numeric_limits<double>::infinity());
    }
    if (!narrow_) {
      return J * inverse_ * J.transpose();
    }
    const MatrixXd crossed = J * B_.transpose();
    return J * J.transpose() + crossed * inverse_ * crossed.transpose();
  }

private:
  MatrixXd B_;
  bool narrow_ = false;
  bool determined_ = false;
  MatrixXd inverse_;
  MatrixXd undetermined_;  // orthogonal directions of the unknowns, in columns
  VectorXd step_;
};

// Predicts folds with shared data of the fit. Keeps references.
class FoldPredictor {
public:
  FoldPredictor(const FoldTask& task, const std::vector<std::vector<Index>>& folds)
      : task_(task),
        problem_(task.problem),
        R_(root_of(task.sqrt_information)),
        determined_(R_.diagonal().cwiseAbs().cwiseProduct(unit_scale(R_)).minCoeff() > kSingular),
        systems_(problem_, R_) {
    std::vector<bool> is_held_out(static_cast<std::size_t>(problem_.measurements.joint_values.cols()), false);
    for (const std::vector<Index>& fold : folds) {
      for (const Index c : fold) {
        is_held_out[static_cast<std::size_t>(c)] = true;
      }
    }
    const auto keep = [&](const Observation& o) { return is_held_out[static_cast<std::size_t>(o.configuration)]; };
    for (std::size_t row = 0; row < problem_.measurements.observations.size(); ++row) {
      if (const Observation& observation = problem_.measurements.observations[row]; keep(observation)) {
        rows_[observation.configuration].push_back(row);
      }
    }
    std::vector<Index> kept;  // configuration indices of the means
    for (const auto& [configuration, rows] : rows_) {
      kept.push_back(configuration);
    }
    means_ = averaged(subset(problem_.measurements, keep));
    for (std::size_t row = 0; row < means_.observations.size(); ++row) {
      rows_of_means_[kept[static_cast<std::size_t>(means_.observations[row].configuration)]].push_back(row);
    }
  }

  // Systems of the configurations of these folds, in their order.
  std::vector<ConfigurationSystem> systems_of(std::span<const std::vector<Index>> folds) const {
    std::vector<std::vector<std::size_t>> rows;
    for (const std::vector<Index>& fold : folds) {
      for (const Index c : fold) {
        rows.push_back(rows_.at(c));
      }
    }
    return determined_ ? systems_.of(rows) : std::vector<ConfigurationSystem>(rows.size());
  }

  // `systems`: those of the fold's configurations.
  Part predict(const std::vector<Index>& fold, std::span<const ConfigurationSystem> systems) const {
    Part part;
    std::optional<WithoutFold> without;
    if (determined_) {
      without.emplace(systems, R_.cols());
      for (std::size_t i = 0; i < fold.size(); ++i) {
        add_points(systems[i], fold[i], *without, part.points);
      }
      if (without->is_determined() && as_good_as_linear(fold, *without, part.points)) {
        if (problem_.options.after_fit) {
          problem_.options.after_fit();
        }
        return part;
      }
    }
    take_refitted(refit_without(problem_, fold), without.has_value(), part);
    return part;
  }

  // Sets the measured mean and the number of repeats of a held-out point.
  void take_mean(HeldOutPoint& point) const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    point.repeats = 0.0;
    for (const std::size_t row : rows_.at(point.configuration)) {
      const Observation& observation = problem_.measurements.observations[row];
      if (observation.target == point.target) {
        point.repeats += 1.0;
        point.noise = observation.noise;
        sum += observation.position();
      }
    }
    point.measured = sum / point.repeats;
  }

private:
  static MatrixXd root_of(const MatrixXd& sqrt_information) {
    const Index columns = sqrt_information.cols();
    return sqrt_information.rows() < columns ? MatrixXd(MatrixXd::Zero(columns, columns))
                                             : triangular_factor(sqrt_information);
  }

  // Adds the configuration's points: residual after the step and covariance, in metres.
  void add_points(const ConfigurationSystem& system, Index configuration, const WithoutFold& without,
                  std::vector<HeldOutPoint>& points) const {
    const VectorXd left = system.in_metres(system.e - system.B * without.step());
    const MatrixXd J = system.in_metres(system.B);
    const Measurements& measurements = problem_.measurements;
    const auto X_BF = flange_poses(problem_.model, problem_.start, measurements.joint_values.col(configuration),
                                   column(measurements.signals, configuration));
    const std::size_t station = station_of(measurements.observations[rows_.at(configuration).front()]);
    const Matrix3d R_WF = problem_.start.frames.base(station).linear() * X_BF.front().linear();
    for (std::size_t i = 0; i < system.targets.size(); ++i) {
      const auto first = static_cast<Index>(3 * i);
      const Matrix3d in_flange = without.covariance(J.middleRows(first, 3));
      points.push_back(
          {.configuration = static_cast<std::int32_t>(configuration),
           .target = system.targets[i],
           .residual = R_WF * left.segment<3>(first),
           .covariance = in_flange.allFinite() ? Matrix3d(R_WF * in_flange * R_WF.transpose()) : in_flange});
    }
  }

  // Whether the fold's points, predicted at the moved estimate, agree with the linear prediction.
  bool as_good_as_linear(const std::vector<Index>& fold, const WithoutFold& without,
                         const std::vector<HeldOutPoint>& points) const {
    Measurements held_out;
    held_out.targets = means_.targets;
    held_out.stations = means_.stations;
    held_out.joint_values = problem_.measurements.joint_values(Eigen::all, fold);
    held_out.signals = columns(problem_.measurements.signals, fold);
    for (std::size_t i = 0; i < fold.size(); ++i) {
      held_out.configurations.push_back(problem_.measurements.configurations[static_cast<std::size_t>(fold[i])]);
      for (const std::size_t row : rows_of_means_.at(fold[i])) {
        held_out.observations.push_back(means_.observations[row]);
        held_out.observations.back().configuration = static_cast<std::int32_t>(i);
      }
    }
    const Estimate moved = problem_.free.moved(problem_.start, R_.triangularView<Eigen::Upper>().solve(without.step()));
    const std::vector<Eigen::Isometry3d> X_BF = flange_poses(problem_.model, moved, held_out);
    const std::vector<double> exact = position_errors(X_BF, moved, held_out);
    const double tolerance = std::max(kAsGoodAsLinear * task_.noise, kExactPrediction);
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!(std::abs(exact[i] - points[i].residual.norm()) <= tolerance)) {
        return false;
      }
    }
    return true;
  }

  // Replaces residuals by those of the refit; keeps the linear covariance if there is one.
  static void take_refitted(const RefittedFold& refitted, bool with_covariance, Part& part) {
    part.refitted = true;
    part.converged = refitted.converged;
    if (!with_covariance) {
      const Matrix3d unknown = Matrix3d::Constant(std::numeric_limits<double>::infinity());
      part.points.assign(refitted.residuals.size(), {.covariance = unknown});
    }
    for (std::size_t i = 0; i < refitted.residuals.size(); ++i) {
      part.points[i].configuration = refitted.configurations[i];
      part.points[i].target = refitted.targets[i];
      part.points[i].residual = refitted.residuals[i];
    }
  }

  const FoldTask& task_;
  const FitProblem& problem_;
  MatrixXd R_;
  bool determined_;
  ConfigurationSystems systems_;
  Measurements means_;                              // of the held-out configurations
  std::map<Index, std::vector<std::size_t>> rows_;  // rows of these configurations
  std::map<Index, std::vector<std::size_t>> rows_of_means_;
};

}  // namespace

std::vector<double> distances_of(const FoldPrediction& prediction) {
  std::vector<double> result;
  for (const HeldOutPoint& point : prediction.points) {
    result.push_back(point.residual.norm());
  }
  return result;
}

FoldPrediction predict_folds(const FoldTask& task, const std::vector<std::vector<Index>>& folds, int threads) {
  const TrainingProblem training(task.problem);
  const FoldTask task_of_training{.problem = *training, .sqrt_information = task.sqrt_information, .noise = task.noise};
  const FoldPredictor predictor(task_of_training, folds);
  std::vector<std::vector<Index>> sorted = folds;
  std::vector<std::pair<std::size_t, std::size_t>> some{{0, 0}};  // first fold and one past the last
  std::size_t together = 0;
  for (std::size_t f = 0; f < sorted.size(); ++f) {
    std::sort(sorted[f].begin(), sorted[f].end());
    together += sorted[f].size();
    some.back().second = f + 1;
    if (together >= ConfigurationSystems::kTogether && f + 1 < sorted.size()) {
      some.emplace_back(f + 1, f + 1);
      together = 0;
    }
  }
  std::vector<Part> parts(sorted.size());
  parallel_for(some.size(), threads, [&](std::size_t s) {
    const auto [first, last] = some[s];
    const std::vector<ConfigurationSystem> systems =
        predictor.systems_of(std::span(sorted).subspan(first, last - first));
    std::size_t place = 0;
    for (std::size_t f = first; f < last; ++f) {
      parts[f] = predictor.predict(sorted[f], std::span(systems).subspan(place, sorted[f].size()));
      place += sorted[f].size();
    }
  });
  FoldPrediction result;
  for (Part& part : parts) {
    for (HeldOutPoint& point : part.points) {
      predictor.take_mean(point);
    }
    result.points.insert(result.points.end(), part.points.begin(), part.points.end());
    result.refits += part.refitted ? 1 : 0;
    result.not_converged += part.converged ? 0 : 1;
  }
  return result;
}

std::vector<double> fold_distances(const FitProblem& problem, const std::vector<std::vector<Index>>& folds,
                                   double noise, int threads) {
  const MatrixXd sqrt_information =
      LeastSquaresProblem(problem.model, problem.measurements, problem.free, problem.options.joint.residuals)
          .whitened_summary(problem.start)
          .sqrt_information;
  return distances_of(
      predict_folds({.problem = problem, .sqrt_information = sqrt_information, .noise = noise}, folds, threads));
}

}  // namespace kdl_calibration
