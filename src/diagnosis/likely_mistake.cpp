#include "diagnosis/likely_mistake.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/parallel.hpp"
#include "base/text.hpp"
#include "diagnosis/changes_midway.hpp"
#include "diagnosis/mistake_trial.hpp"
#include "diagnosis/point_trial.hpp"
#include "diagnosis/trial_fit.hpp"
#include "measurements/readings.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kFalseAlarm = 1e-5;  // of all trials of a kind
constexpr double kRadius = 1.614;     // 95 % radius over the 3D RMS, of alike normal coordinates

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
  const auto off = [](const std::string& what) {
    return [=](const Explained& found) {
      return fmt::format("{} {} from where it was stated", what, said_length(found.estimate.head<3>().norm()));
    };
  };
  for (std::size_t station = 0; station < fit.model().stations.size(); ++station) {
    if (find_base(fit.known().bases, fit.model().stations[station]) != nullptr) {
      stated.add(explanations, explanations.sums(fit.linear().jacobian * fit.of_base(station)), [&] {
        return MistakeTrial{.cause = Cause::known_base,
                            .subject = "the known base",
                            .subjects = {{SubjectKind::station, fit.model().stations[station]}},
                            .words = off("the known base")};
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
                            .words = off("target " + shown(name))};
      });
    }
  }
  families.push_back(std::move(stated));
}

// A trial that is significant and moves predictions.
struct Found {
  MistakeTrial trial;
  Explained explained;
  double evidence = 0.0;
  double p_value = 1.0;  // of all trials of its kind
  double left = 0.0;     // [m] misfit
  double radius = 0.0;   // [m] of predictions without the mistake
};

// Whether the mistake, beside ordinary errors, explains the measurements as well as the result does. Where the effects
// of the result are doubted as well, for its own number of unknowns.
bool explains_as_well(const OrdinaryFit& fit, const Explained& explained) {
  const double of_result =
      fit.is_beside_effects() ? fit.misfit() : fit.misfit_without_effects(explained.estimate.size());
  return fit.misfit() * std::sqrt(explained.share_left) <= of_result;
}

std::optional<Found> best_of(const std::vector<MistakeFamily>& families, const Explanations& explanations,
                             const OrdinaryFit& fit, const FitToDoubt& doubted) {
  constexpr double kHopeless = -5.0;  // first evidence
  constexpr std::size_t kMostFitted = 8;
  std::vector<const MistakeFamily*> tried;
  for (const MistakeFamily& family : families) {
    if (family.best && family.evidence > kHopeless) {
      tried.push_back(&family);
    }
  }
  std::sort(tried.begin(), tried.end(),
            [](const MistakeFamily* a, const MistakeFamily* b) { return a->evidence > b->evidence; });
  tried.resize(std::min(tried.size(), kMostFitted));
  std::vector<Explained> all(tried.size());
  parallel_for(tried.size(), doubted.threads,
               [&](std::size_t i) { all[i] = explanations.explained(tried[i]->best->sums, tried[i]->best->motion); });
  std::optional<Found> result;
  const double rms = fit.misfit();
  for (std::size_t i = 0; i < tried.size(); ++i) {
    const MistakeFamily* const family = tried[i];
    const Explained& explained = all[i];
    const double left = rms * std::sqrt(std::min(explained.share_left, 1.0));  // beside ordinary sizes it is more
    const double radius = kRadius * std::hypot(doubted.uncertainty * left / rms, left);
    const Found found{.trial = *family->best,
                      .explained = explained,
                      .evidence = explained.evidence - std::log(family->trials),
                      .p_value = std::min(explained.p_value * family->trials, 1.0),
                      .left = left,
                      .radius = radius};
    const bool significant = found.p_value < kFalseAlarm && explains_as_well(fit, explained);
    const bool matters = std::min(explained.moves, explained.size) > radius &&
                         explained.estimate.norm() <= family->best->largest &&
                         explained.estimate.norm() >= family->best->least;
    if (significant && matters && found.evidence > (result ? result->evidence : 0.0)) {
      result = found;
    }
  }
  return result;
}

// Adds the length of three columns of the estimate, from `first` on, with its 1 sigma in that direction.
void add_length(const Explained& found, Index first, const std::string& name, std::vector<NamedFigure>& figures) {
  const Vector3d estimate = found.estimate.segment<3>(first);
  const Vector3d direction = estimate.stableNormalized();
  figures.push_back({name, estimate.norm()});
  figures.push_back(
      {name + "_sigma", std::sqrt(direction.dot(found.covariance.block<3, 3>(first, first) * direction))});
}

// The size of the mistake. A changed payload has none: its columns are those of several effects.
std::vector<NamedFigure> size_of(const MistakeTrial& trial, const Explained& found) {
  std::vector<NamedFigure> figures;
  if (trial.cause == Cause::payload_changed) {
    return figures;
  }
  if (found.estimate.size() < 3) {
    return {{"estimate", found.estimate[0] / trial.scale},
            {"estimate_sigma", std::sqrt(found.covariance(0, 0)) / std::abs(trial.scale)}};
  }
  add_length(found, 0, "estimate", figures);
  if (found.estimate.size() == 6) {
    add_length(found, 3, "turn", figures);
  }
  return figures;
}

AlternativeReading said(const Found& found, const OrdinaryFit& fit) {
  std::vector<NamedFigure> figures = size_of(found.trial, found.explained);
  figures.insert(figures.end(), {{"misfit", fit.misfit()},
                                 {"misfit_without", found.left},
                                 {"moves", found.explained.moves},
                                 {"radius", found.radius},
                                 {"p_value", found.p_value}});
  const std::string mistake = found.trial.words(found.explained);
  const std::string explained =
      fit.is_beside_effects()
          ? fmt::format("as read the measurements leave a misfit of {}; with {} it is {}", said_length(fit.misfit()),
                        mistake, said_length(found.left))
          : fmt::format("with effects the measurements leave a misfit of {}; without, but with {}, it is {}",
                        said_length(fit.misfit()), mistake, said_length(found.left));
  return {.cause = found.trial.cause,
          .subjects = found.trial.subjects,
          .figures = std::move(figures),
          .message = fmt::format("{}, and predictions move by {} (their radius: {}); {}", explained,
                                 said_length(found.explained.moves), said_length(found.radius), kUsedAsRead)};
}

// What was tried beside a fit: the best mistake, and what each would have shown.
struct Search {
  std::optional<Found> found;
  std::vector<DetectableMistake> detectable;
};

// `radius`: [m] of predictions. What moves them by less is no mistake that matters.
std::vector<DetectableMistake> detectable(const std::vector<MistakeFamily>& families, const Explanations& explanations,
                                          double radius) {
  constexpr double kPower = 0.8;
  constexpr double kBeyond = 1.25;  // the mistake itself adds to the noise and to the radius
  std::vector<DetectableMistake> result;
  for (const MistakeFamily& family : families) {
    for (const MistakeTrial& trial : family.listed) {
      const auto least = explanations.detectable(trial.sums, trial.motion, kFalseAlarm / family.trials, kPower);
      if (!least || !(least->moves > 0.0)) {
        continue;
      }
      const double matters = kBeyond * std::max(radius / std::min(least->moves, least->size), 1.0);
      const double estimate = *trial.unit != 0 ? std::abs(least->estimate[0]) : 0.0;
      result.push_back({.cause = trial.cause,
                        .subject = trial.subject,
                        .estimate = matters * estimate,
                        .unit = trial.unit,
                        .size = matters * least->size,
                        .moves = matters * least->moves});
    }
  }
  return result;
}

Search best_mistake(const OrdinaryFit& fit, const FitToDoubt& doubted) {
  if (!(fit.misfit() > 0.0)) {
    return {};
  }
  const Explanations explanations(fit.linear());
  std::vector<MistakeFamily> families;
  try_stated_frames(fit, explanations, families);
  if (doubted.fix.empty()) {  // errors that are held although the arm has them look like anything else
    try_lengths(fit, explanations, families);
    try_constants(fit, explanations, families);
    try_joints(fit, explanations, families);
    try_changes(fit, explanations, families);
  }
  return {.found = best_of(families, explanations, fit, doubted),
          .detectable = detectable(families, explanations, kRadius * std::hypot(doubted.uncertainty, fit.misfit()))};
}

// A configuration of its own is named by other checks. What remains without it is looked at again.
MistakeSearch likely_beside(const FitToDoubt& fit) {
  constexpr int kMostLeftOut = 3;
  MistakeSearch result;
  std::optional<Measurements> fewer;
  for (int round = 0; round <= kMostLeftOut; ++round) {
    const Measurements& rows = fewer ? *fewer : fit.measurements;
    if (rows.observations.empty()) {
      break;
    }
    const FitToDoubt rest{.model = fit.model,
                          .measurements = rows,
                          .estimate = fit.estimate,
                          .known = fit.known,
                          .uncertainty = fit.uncertainty,
                          .stated = fit.stated,
                          .scale_sigma = fit.scale_sigma,
                          .beside_effects = fit.beside_effects,
                          .threads = fit.threads};
    const OrdinaryFit ordinary(rest);
    Search search = best_mistake(ordinary, rest);
    result.detectable = std::move(search.detectable);
    if (!search.found) {
      break;
    }
    if (!search.found->trial.alone) {
      result.mistake = said(*search.found, ordinary);
      break;
    }
    Measurements without = rows;
    std::erase_if(without.observations, [&](const Observation& o) {
      return rows.configurations[static_cast<std::size_t>(o.configuration)] == *search.found->trial.alone;
    });
    fewer = std::move(without);
  }
  return result;
}

}  // namespace

MistakeSearch likely_mistake(const FitToDoubt& fit) {
  const bool any_stated = !fit.known.bases.empty() || !fit.known.targets.empty();
  if (!fit.fix.empty() && any_stated) {  // where errors are held, a stated frame alone
    const OrdinaryFit ordinary(fit);
    if (const std::optional<Found> found = best_mistake(ordinary, fit).found) {
      return {.mistake = said(*found, ordinary), .detectable = {}};
    }
  }
  MistakeSearch result = likely_beside(fit);
  if (!result.mistake && !fit.model.effects.empty()) {
    FitToDoubt instead = fit;
    instead.beside_effects = false;
    result.mistake = likely_beside(instead).mistake;
  }
  return result;
}

}  // namespace kdl_calibration
