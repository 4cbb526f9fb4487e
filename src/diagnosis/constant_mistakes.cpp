#include "diagnosis/constant_mistakes.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "base/degree.hpp"
#include "base/text.hpp"
#include "diagnosis/point_trial.hpp"
#include "measurements/readings.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Factors on lengths are linear near 1; larger ones are other units, or nothing but noise.
MistakeTrial scale_trial(const std::string& which, const std::vector<Subject>& subjects, double sigma) {
  constexpr double kLargest = 0.2;
  constexpr double kBeyond = 3.0;  // sigma
  return {.cause = Cause::scale,
          .subject = which,
          .subjects = subjects,
          .unit = "%",
          .words =
              [which](const Explained& found) {
                const double factor = 1.0 + found.estimate[0];
                const std::string units = units_of_factor(factor);
                return fmt::format("{} {:.5g} times as long ({})", which, factor,
                                   units.empty() ? "unit, temperature or instrument set wrong" : units);
              },
          .largest = kLargest,
          .least = kBeyond * sigma};
}

void make_longer(Observation& row, const Vector3d& predicted, double step) {
  if (auto* const distance = std::get_if<Distance>(&row.reading)) {
    distance->length += step * (predicted - distance->anchor).norm();
    distance->anchor *= 1.0 + step;
  } else {
    row.position() += step * predicted;
  }
}

// Whether distances were measured from places that another instrument stated: as anchors, or as bases of stations.
bool has_stated_anchors(const OrdinaryFit& fit) {
  const std::vector<Observation>& rows = fit.rows().observations;
  const bool any_base = !fit.known().bases.empty();
  return std::any_of(rows.begin(), rows.end(), [&](const Observation& row) {
    return is_distance(row) && (any_base || !row.position().isZero(0.0));
  });
}

// A factor on the distances alone, whose anchors stay where they were stated. The zero of the instrument took a part of
// it in the fit, so it is free here.
MatrixXd distance_factor(const OrdinaryFit& fit) {
  const auto longer = [&](bool by_factor) {
    return fit.disturbed([by_factor](Observation& o, const Vector3d& predicted, double step) {
      if (auto* const distance = std::get_if<Distance>(&o.reading)) {
        distance->length += step * (by_factor ? (predicted - distance->anchor).norm() : 1.0);
      }
    });
  };
  MatrixXd C = longer(true);
  if (rows_of_stated_distances(fit.rows()).empty()) {
    C.conservativeResize(Eigen::NoChange, 2);
    C.col(1) = longer(false);
  }
  return C;
}

}  // namespace

void try_lengths(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families) {
  const MatrixXd C = fit.disturbed(make_longer);
  MistakeFamily all;
  all.add(explanations, explanations.sums(C),
          [&] { return scale_trial("all measured lengths", {}, fit.scale_sigma()); });
  if (has_stated_anchors(fit)) {
    constexpr bool kListed = false;  // among all lengths
    all.add(
        explanations, explanations.sums(distance_factor(fit)),
        [&] { return scale_trial("all measured distances", {}, fit.scale_sigma()); }, kListed);
  }
  families.push_back(std::move(all));

  const std::vector<std::string>& stations = fit.rows().stations;
  MistakeFamily of_stations;
  for (std::size_t station = 0; station < stations.size() && stations.size() > 1; ++station) {
    MatrixXd own = C;
    for (Index c = 0; c < fit.rows().joint_values.cols(); ++c) {
      const auto [first, count] = fit.rows_of(c);
      own.middleRows(first, count) *= fit.station(c) == station ? 1.0 : 0.0;
    }
    of_stations.add(explanations, explanations.sums(own), [&] {
      return scale_trial("lengths of station " + shown(stations[station]), {{SubjectKind::station, stations[station]}},
                         fit.scale_sigma());
    });
  }
  families.push_back(std::move(of_stations));

  MistakeFamily of_axes;
  for (Index axis = 0; axis < 3; ++axis) {
    const MatrixXd along = fit.disturbed([&](Observation& o, const Vector3d& predicted, double step) {
      o.position()[axis] += is_distance(o) ? 0.0 : step * predicted[axis];
    });
    const std::string name(1, "xyz"[axis]);
    of_axes.add(explanations, explanations.sums(along), [&] {
      return scale_trial("coordinates " + name, {{SubjectKind::coordinate, name}}, 0.0);
    });
  }
  families.push_back(std::move(of_axes));
}

void try_constants(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families) {
  constexpr double kLargestReflector = 0.05;  // [m] its radius, or that of another one
  const auto constant = [](const std::string& which) {
    return MistakeTrial{.cause = Cause::distance_zero,
                        .subject = which + " by the same length",
                        .unit = "mm",
                        .words = [which](const Explained& found) {
                          return fmt::format("{} {} too {} (zero of the instrument)", which,
                                             said_length(std::abs(found.estimate[0])),
                                             found.estimate[0] > 0.0 ? "long" : "short");
                        }};
  };
  MistakeFamily constants;
  if (std::any_of(fit.rows().observations.begin(), fit.rows().observations.end(), is_distance)) {
    const MatrixXd zero = fit.disturbed([](Observation& o, const Vector3d& /*predicted*/, double step) {
      if (auto* const distance = std::get_if<Distance>(&o.reading)) {
        distance->length += step;
      }
    });
    constants.add(explanations, explanations.sums(zero), [&] { return constant("all distances"); });
  } else if (fit.has_tracker() || fit.is_seen_from_outside()) {  // from the origin of W
    const MatrixXd sight = fit.disturbed([](Observation& o, const Vector3d& predicted, double step) {
      o.position() += step * predicted.stableNormalized();
    });
    constants.add(explanations, explanations.sums(sight), [&] {
      MistakeTrial trial =
          constant(fit.has_tracker() ? "distances from the tracker" : "distances from the origin of the coordinates");
      trial.largest = kLargestReflector;
      return trial;
    });
  }
  families.push_back(std::move(constants));
}

namespace {

// Sums of the columns M of J, each configuration's rows times a weight.
AlternativeSums weighted(const OrdinaryFit& fit, const Explanations& explanations, const VectorXd& weights,
                         const MatrixXd& M) {
  MatrixXd C = fit.linear().jacobian * M;
  for (Index c = 0; c < weights.size(); ++c) {
    const auto [first, count] = fit.rows_of(c);
    C.middleRows(first, count) *= weights[c];
  }
  return explanations.sums(C);
}

}  // namespace

void try_joints(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families) {
  MistakeFamily gains;
  for (const std::size_t d : fit.effects_of(EffectGroup::gain)) {
    const MatrixXd M = fit.unit_columns(UnknownGroup::effects, {d});
    const auto trial = [&, d] {
      const EffectTerm& term = fit.model().effects[d];
      const MovingJoint& joint = fit.model().joints[static_cast<std::size_t>(term.index)];
      return MistakeTrial{.cause = Cause::joint_gain,
                          .subjects = {{SubjectKind::joint, joint.name}},
                          .scale = term.scale,
                          .motion = {.of_robot = M},
                          .words = [&joint, scale = term.scale](const Explained& found) {
                            return fmt::format(
                                "{}{}{:.4g} times as far as its values say (unit, gear ratio or encoder set wrong)",
                                joint.name, joint.type != JointType::prismatic ? " turning " : " moving ",
                                1.0 + found.estimate[0] / scale);
                          }};
    };
    // An ordinary gain is fitted and hides nothing, so that none is listed.
    gains.add(explanations, explanations.sums(fit.linear().jacobian * M), trial, false);
  }
  families.push_back(std::move(gains));

  MistakeFamily couplings;
  for (std::size_t joint = 1; joint < fit.model().joints.size(); ++joint) {
    if (const std::optional<MatrixXd> M = fit.of_zero(joint)) {
      const VectorXd before = fit.rows().joint_values.row(static_cast<Index>(joint) - 1);
      couplings.add(explanations, weighted(fit, explanations, before, *M), [&, joint] {
        const std::string& name = fit.model().joints[joint].name;
        const std::string& leader = fit.model().joints[joint - 1].name;
        return MistakeTrial{.cause = Cause::joint_gain,
                            .subject = name + " coupled with " + leader,
                            .subjects = subjects_named(SubjectKind::joint, {name, leader}),
                            .unit = "%",
                            .words = [&fit, joint](const Explained& found) {
                              return fmt::format("{} moving by {:.3g} of the motion of {} (coupled gears)",
                                                 fit.model().joints[joint].name, found.estimate[0],
                                                 fit.model().joints[joint - 1].name);
                            }};
      });
    }
  }
  families.push_back(std::move(couplings));
}

void try_stated_frames(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families) {
  MistakeFamily stated;
  const std::vector<std::string>& stations = fit.model().stations;
  for (std::size_t station = 0; station < stations.size(); ++station) {
    if (find_base(fit.known().bases, stations[station]) != nullptr) {
      stated.add(explanations, explanations.sums(fit.linear().jacobian * fit.of_base(station)), [&] {
        const std::string of_station = stations.size() > 1 ? " of station " + shown(stations[station]) : "";
        return MistakeTrial{.cause = Cause::known_base,
                            .subject = "the known base" + of_station,
                            .subjects = {{SubjectKind::station, stations[station]}},
                            .words = [of_station](const Explained& found) {
                              return fmt::format("the known base{} {} and {:.3g} degrees from where it was stated",
                                                 of_station, said_length(found.estimate.head<3>().norm()),
                                                 found.estimate.tail<3>().norm() / kDegree);
                            }};
      });
    }
  }
  for (std::size_t k = 0; k < fit.targets().size(); ++k) {
    const std::string& name = fit.targets()[k].name;
    if (find_target(fit.known().targets, name) != nullptr) {
      stated.add(explanations, explanations.sums(fit.linear().jacobian * fit.of_target(k)), [&] {
        return MistakeTrial{.cause = Cause::known_target,
                            .subject = "stated target " + shown(name),
                            .subjects = {{SubjectKind::target, name}},
                            .words = [&name](const Explained& found) {
                              return fmt::format("target {} {} from where it was stated", shown(name),
                                                 said_length(found.estimate.norm()));
                            }};
      });
    }
  }
  families.push_back(std::move(stated));
}

}  // namespace kdl_calibration
