#include "diagnosis/likely_mistake.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/parallel.hpp"
#include "diagnosis/changes_midway.hpp"
#include "diagnosis/constant_mistakes.hpp"
#include "diagnosis/mistake_trial.hpp"
#include "diagnosis/own_alternatives.hpp"
#include "diagnosis/trial_fit.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Vector3d;

constexpr double kFalseAlarm = 1e-5;  // of all trials of a kind
constexpr double kRadius = 1.614;     // 95 % radius over the 3D RMS, of alike normal coordinates

// A trial, and what it explains.
struct Found {
  MistakeTrial trial;
  Explained explained;
  double evidence = 0.0;
  double p_value = 1.0;      // of all trials of its kind
  double left = 0.0;         // [m] misfit
  double radius = 0.0;       // [m] of predictions without the mistake
  bool significant = false;  // and explains the measurements as well as the result does
  bool matters = false;      // moves predictions
};

// Whether the mistake, beside ordinary errors, explains the measurements as well as the result does. Where the effects
// of the result are doubted as well, for its own number of unknowns.
bool explains_as_well(const OrdinaryFit& fit, const Explained& explained) {
  const double of_result =
      fit.is_beside_effects() ? fit.misfit() : fit.misfit_without_effects(explained.estimate.size());
  return fit.misfit() * std::sqrt(explained.share_left) <= of_result;
}

std::vector<Found> judged(const std::vector<const MistakeFamily*>& tried, const Explanations& explanations,
                          const OrdinaryFit& fit, const FitToDoubt& doubted) {
  std::vector<Explained> all(tried.size());
  parallel_for(tried.size(), doubted.threads,
               [&](std::size_t i) { all[i] = explanations.explained(tried[i]->best->sums, tried[i]->best->motion); });
  std::vector<Found> result;
  const double rms = fit.misfit();
  for (std::size_t i = 0; i < tried.size(); ++i) {
    const MistakeFamily* const family = tried[i];
    const Explained& explained = all[i];
    const double left = rms * std::sqrt(std::min(explained.share_left, 1.0));  // beside ordinary sizes it is more
    const double radius = kRadius * std::hypot(doubted.uncertainty * left / rms, left);
    Found found{.trial = *family->best,
                .explained = explained,
                .evidence = explained.evidence - std::log(family->trials),
                .p_value = std::min(explained.p_value * family->trials, 1.0),
                .left = left,
                .radius = radius};
    found.significant = found.p_value < kFalseAlarm && explains_as_well(fit, explained);
    found.matters = std::min(explained.moves, explained.size) > radius &&
                    explained.estimate.norm() <= family->best->largest &&
                    explained.estimate.norm() >= family->best->least;
    result.push_back(std::move(found));
  }
  return result;
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
  std::optional<Found> result;
  for (Found& found : judged(tried, explanations, fit, doubted)) {
    const bool counts = !found.trial.is_mistake || (found.significant && found.matters);
    if (counts && found.evidence > (result ? result->evidence : 0.0)) {
      result = std::move(found);
    }
  }
  return result && result->trial.is_mistake ? std::move(result) : std::nullopt;
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
  if (trial.cause == Cause::own_alternative) {
    return figures_of_columns(found);
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

std::vector<NamedFigure> figures_of(const Found& found, const OrdinaryFit& fit) {
  std::vector<NamedFigure> figures = size_of(found.trial, found.explained);
  figures.insert(figures.end(), {{"misfit", fit.misfit()},
                                 {"misfit_without", found.left},
                                 {"moves", found.explained.moves},
                                 {"radius", found.radius},
                                 {"p_value", found.p_value}});
  return figures;
}

AlternativeReading said(const Found& found, const OrdinaryFit& fit) {
  const std::string mistake = found.trial.words(found.explained);
  const std::string explained =
      fit.is_beside_effects()
          ? fmt::format("as read the measurements leave a misfit of {}; with {} it is {}", said_length(fit.misfit()),
                        mistake, said_length(found.left))
          : fmt::format("with effects the measurements leave a misfit of {}; without, but with {}, it is {}",
                        said_length(fit.misfit()), mistake, said_length(found.left));
  return {.cause = found.trial.cause,
          .subjects = found.trial.subjects,
          .figures = figures_of(found, fit),
          .message = fmt::format("{}, and predictions move by {} (their radius: {}); {}", explained,
                                 said_length(found.explained.moves), said_length(found.radius), kUsedAsRead)};
}

// Why an alternative of the caller's own is no doubt.
AlternativeReading said_in_passing(const Found& found, const OrdinaryFit& fit) {
  const char* why = !(found.p_value < kFalseAlarm) ? "it is not significant"
                    : !found.significant           ? "the calibration explains the measurements better"
                    : !found.matters               ? "it does not matter for predictions"
                                                   : "another mistake explains more";
  return {.cause = found.trial.cause,
          .subjects = found.trial.subjects,
          .figures = figures_of(found, fit),
          .message = fmt::format("{}: {} (p = {:.2g}; predictions would move by {}, their radius is {})",
                                 found.trial.words(found.explained), why, found.p_value,
                                 said_length(found.explained.moves), said_length(found.radius)),
          .doubt = false};
}

// What was tried beside a fit: the best mistake, the alternatives of the caller's own, and what each would have shown.
struct Search {
  std::optional<Found> found = std::nullopt;
  std::vector<AlternativeReading> own = {};
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

// Each by itself. Of it and the best mistake, the one that explains less is no doubt.
void judge_alternatives(OwnTrials& own, const Explanations& explanations, const OrdinaryFit& fit,
                        const FitToDoubt& doubted, Search& search) {
  std::vector<const MistakeFamily*> tried;
  std::transform(own.families.begin(), own.families.end(), std::back_inserter(tried),
                 [](const MistakeFamily& family) { return &family; });
  const std::vector<Found> all = judged(tried, explanations, fit, doubted);
  const double of_mistake = search.found ? search.found->evidence : -std::numeric_limits<double>::infinity();
  for (const Found& found : all) {
    const bool doubt = found.significant && found.matters && found.evidence > of_mistake;
    search.own.push_back(doubt ? said(found, fit) : said_in_passing(found, fit));
    if (doubt) {
      search.found.reset();
    }
  }
  std::move(own.hidden.begin(), own.hidden.end(), std::back_inserter(search.own));
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
  Search search{.found = best_of(families, explanations, fit, doubted)};
  OwnTrials own = try_alternatives(fit, explanations, doubted.alternatives);
  judge_alternatives(own, explanations, fit, doubted, search);
  std::move(own.families.begin(), own.families.end(), std::back_inserter(families));
  search.detectable = detectable(families, explanations, kRadius * std::hypot(doubted.uncertainty, fit.misfit()));
  return search;
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
                          .unknowns = fit.unknowns,
                          .alternatives = fit.alternatives,
                          .beside_effects = fit.beside_effects,
                          .threads = fit.threads};
    const OrdinaryFit ordinary(rest);
    Search search = best_mistake(ordinary, rest);
    result.detectable = std::move(search.detectable);
    result.own = std::move(search.own);
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
  const auto is_doubt = [](const AlternativeReading& reading) { return reading.doubt; };
  MistakeSearch result = likely_beside(fit);
  const bool explained = result.mistake || std::any_of(result.own.begin(), result.own.end(), is_doubt);
  if (!explained && !fit.model.effects.empty()) {
    FitToDoubt instead = fit;
    instead.beside_effects = false;
    MistakeSearch of_instead = likely_beside(instead);
    result.mistake = std::move(of_instead.mistake);
    for (AlternativeReading& own : of_instead.own) {
      const auto same = std::find_if(result.own.begin(), result.own.end(),
                                     [&](const AlternativeReading& other) { return other.subjects == own.subjects; });
      if (own.doubt && same != result.own.end()) {
        *same = std::move(own);
      }
    }
  }
  return result;
}

}  // namespace kdl_calibration
