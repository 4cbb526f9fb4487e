#include "diagnosis/own_alternatives.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include "base/text.hpp"
#include "effects/effect_functions.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

std::string in_options(const OwnAlternative& alternative) { return "diagnosis.alternatives: " + alternative.name; }

bool moves_joint(const OwnAlternative& alternative) { return !alternative.joint.empty(); }

// The function with its checks: the fit calls it at places of its own as well.
OwnColumns checked(const OwnAlternative& alternative) {
  return [&alternative](const MatrixXd& joint_values) {
    return checked_columns(in_options(alternative), alternative.columns, joint_values);
  };
}

// C, and the predicted points that the arm itself has beside the fit.
OrdinaryFit::EffectColumns columns_of_motion(const OrdinaryFit& fit, const OwnAlternative& alternative) {
  const std::size_t joint = joint_moved_by(in_options(alternative), alternative.joint, fit.model());
  const OwnColumns function = checked(alternative);
  const Index count = function(fit.rows().joint_values).cols();
  std::vector<EffectTerm> terms;
  for (Index column = 0; column < count; ++column) {
    terms.push_back(
        {.name = fmt::format("alternative.{}.{}", alternative.name, column),
         .joint = alternative.joint,
         .index = static_cast<int>(joint),
         .axis = alternative.axis,
         // Not the name of an effect that the fit may have.
         .function = OwnFunction{.effect = "alternative " + alternative.name, .columns = function, .column = column}});
  }
  return fit.of_effects(terms);
}

OrdinaryFit::EffectColumns columns_of_points(const OrdinaryFit& fit, const OwnAlternative& alternative) {
  const bool in_base = alternative.frame == DisplacementFrame::base;
  const OwnColumns function = checked(alternative);
  const MatrixXd values = function(fit.rows().joint_values);
  const MatrixXd at_places = in_base ? function(fit.places()) : MatrixXd();
  const Index count = values.cols() / 3;
  OrdinaryFit::EffectColumns result{.rows = MatrixXd(fit.linear().jacobian.rows(), count), .points = {}};
  if (in_base) {
    result.points = MatrixXd(fit.linear().offset.size(), count);
  }
  for (Index column = 0; column < count; ++column) {
    result.rows.col(column) = fit.disturbed([&](Observation& row, const Vector3d& predicted, double step) {
      Vector3d displacement = values.row(row.configuration).segment<3>(3 * column);
      if (in_base) {
        displacement = fit.base_of(row).linear() * displacement;
      }
      if (auto* const distance = std::get_if<Distance>(&row.reading)) {
        distance->length += step * displacement.dot((predicted - distance->anchor).stableNormalized());
      } else {
        row.position() += step * displacement;
      }
    });
    if (in_base) {
      result.points.col(column) = fit.at_points(Matrix3Xd(at_places.middleCols<3>(3 * column).transpose()));
    }
  }
  return result;
}

// Whether each combination of the columns has a part that J lacks, more than rounding.
class Span {
public:
  explicit Span(const OrdinaryFit& fit) : rows_(fit.linear().jacobian.rows()) {
    MatrixXd J = fit.linear().jacobian(Eigen::all, fit.columns_of_result());
    for (Index column = 0; column < J.cols(); ++column) {
      J.col(column) /= std::max(J.col(column).norm(), 1e-300);
    }
    decomposed_.setThreshold(kRounding);
    decomposed_.compute(J);
  }

  bool has(const MatrixXd& C) const {
    constexpr double kShows = 1e-6;  // of a column's length
    const VectorXd norms = C.colwise().norm();
    if (!(norms.minCoeff() > 0.0)) {
      return true;
    }
    MatrixXd rest = decomposed_.householderQ().adjoint() * (C * norms.cwiseInverse().asDiagonal());
    rest.topRows(std::min(decomposed_.rank(), rows_)).setZero();
    return rest.bdcSvd().singularValues().minCoeff() < kShows || rest.rows() < rest.cols();
  }

private:
  static constexpr double kRounding = 1e-10;
  Index rows_;
  Eigen::ColPivHouseholderQR<MatrixXd> decomposed_;
};

AlternativeReading remark(const OwnAlternative& alternative, const std::string& what) {
  return {.cause = Cause::own_alternative,
          .subjects = {{SubjectKind::alternative, alternative.name}},
          .message = "alternative " + alternative.name + what,
          .doubt = false};
}

void require_columns(const OwnAlternative& alternative, const ErrorModel& model, const Measurements& measurements) {
  const std::string what = in_options(alternative);
  const MatrixXd& q = measurements.joint_values;
  if (q.cols() == 0 || static_cast<std::size_t>(q.rows()) != model.joints.size()) {
    return;  // which other checks refuse
  }
  const MatrixXd columns = columns_by_row(what, alternative.columns, q);
  if (!moves_joint(alternative) && columns.cols() % 3 != 0) {
    throw InputError(
        fmt::format("{} gives {} numbers for each configuration, expected x, y and z of each column, or a "
                    "joint that moves",
                    what, columns.cols()));
  }
}

}  // namespace

void require_alternatives(const DiagnosisOptions& options, const ErrorModel& model, const Measurements& measurements) {
  constexpr const char* kOption = "diagnosis.alternatives";
  if (!options.alternatives.empty() && !options.try_readings) {
    throw OptionError(kOption, "are other readings of the data, which are not tried, expected one of the two",
                      {"diagnosis.try_readings"});
  }
  std::set<std::string> names;
  for (const OwnAlternative& alternative : options.alternatives) {
    require_named(kOption, alternative.name, alternative.columns, names);
    if (moves_joint(alternative)) {
      joint_moved_by(in_options(alternative), alternative.joint, model);
    }
    require_columns(alternative, model, measurements);
  }
}

OwnTrials try_alternatives(const OrdinaryFit& fit, const Explanations& explanations,
                           std::span<const OwnAlternative> alternatives) {
  OwnTrials result;
  if (alternatives.empty()) {
    return result;
  }
  const Span span(fit);
  for (const OwnAlternative& alternative : alternatives) {
    OrdinaryFit::EffectColumns columns =
        moves_joint(alternative) ? columns_of_motion(fit, alternative) : columns_of_points(fit, alternative);
    if (span.has(columns.rows)) {
      result.hidden.push_back(
          remark(alternative, columns.rows.cols() == 1
                                  ? " cannot be seen: the calibration explains its column as well"
                                  : " cannot be seen: the calibration explains some of its columns as well, or one "
                                    "column another"));
      result.hidden.back().figures = {{"columns", static_cast<double>(columns.rows.cols())}};
      continue;
    }
    const std::string subject = "alternative " + alternative.name;
    result.families.emplace_back().add(explanations, explanations.sums(columns.rows), [&] {
      return MistakeTrial{.cause = Cause::own_alternative,
                          .subject = subject,
                          .subjects = {{SubjectKind::alternative, alternative.name}},
                          .motion = {.of_points = columns.points},
                          .words = [subject](const Explained& found) { return said_estimate(subject, found); }};
    });
  }
  return result;
}

std::string said_estimate(const std::string& subject, const Explained& found) {
  constexpr Index kShown = 3;
  std::string text = subject + (found.estimate.size() == 1 ? "" : fmt::format(" of {} columns", found.estimate.size()));
  for (Index i = 0; i < std::min(found.estimate.size(), kShown); ++i) {
    text +=
        fmt::format("{}{:.4g} ± {:.2g}", i == 0 ? ", " : " and ", found.estimate[i], std::sqrt(found.covariance(i, i)));
  }
  return text + (found.estimate.size() > kShown ? " …" : "") + " times its function";
}

std::vector<NamedFigure> figures_of_columns(const Explained& found) {
  std::vector<NamedFigure> figures;
  const bool several = found.estimate.size() > 1;
  for (Index i = 0; i < found.estimate.size(); ++i) {
    const std::string name = "estimate" + (several ? "_" + std::to_string(i + 1) : "");
    figures.push_back({name, found.estimate[i]});
    figures.push_back({name + "_sigma", std::sqrt(found.covariance(i, i))});
  }
  figures.push_back({"columns", static_cast<double>(found.estimate.size())});
  return figures;
}

std::vector<AlternativeReading> untried(std::span<const OwnAlternative> alternatives,
                                        const std::vector<AlternativeReading>& readings) {
  std::vector<AlternativeReading> result;
  for (const OwnAlternative& alternative : alternatives) {
    const Subject subject{SubjectKind::alternative, alternative.name};
    const bool is_said = std::any_of(readings.begin(), readings.end(), [&](const AlternativeReading& reading) {
      return reading.cause == Cause::own_alternative && reading.subjects == std::vector{subject};
    });
    if (!is_said) {
      result.push_back(remark(alternative, readings.empty() ? " was not tried, as no fit leaves a misfit to explain"
                                                            : " was not tried, as the input seems to be wrong"));
    }
  }
  return result;
}

}  // namespace kdl_calibration
