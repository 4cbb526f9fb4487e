#include "selection/effect_selection.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

#include "base/counted_fits.hpp"
#include "base/parallel.hpp"
#include "base/text.hpp"
#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/readings.hpp"
#include "measurements/training_rows.hpp"
#include "selection/effect_candidates.hpp"
#include "selection/effect_groups.hpp"
#include "selection/parameter_selection.hpp"
#include "selection/ripple_search.hpp"
#include "selection/table_certainty.hpp"
#include "selection/tried_models.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr std::size_t kMostConfigurations = 2000;
constexpr double kFlatTable = 5e-6;  // [m or rad]

bool is_tables(const EffectOption& option) { return option.name == to_string(EffectGroup::tables); }
bool is_gravity(const EffectOption& option) { return option.name == to_string(EffectGroup::gravity); }
bool is_ripple(const EffectOption& option) { return option.name == to_string(EffectGroup::ripple); }

void append(std::vector<EffectTerm>& terms, const std::vector<EffectTerm>& more) {
  terms.insert(terms.end(), more.begin(), more.end());
}

CandidateModel extended(CandidateModel model, const EffectOption& option) {
  append(model.terms, option.terms);
  model.names.push_back(option.name);
  return model;
}

bool has_groups(const CandidateModel& model, const std::vector<std::string>& names) {
  return std::is_permutation(names.begin(), names.end(), model.names.begin(), model.names.end());
}

// A model, its score, and the remaining candidate groups.
struct Route {
  CandidateModel model;
  ModelScore score;
  std::vector<EffectOption> left;
};

// A candidate group, and the score of the model with it.
struct Step {
  std::size_t option = 0;
  ModelScore score;
};

void take(Step step, Route& route) {
  route.model = extended(std::move(route.model), route.left[step.option]);
  route.left.erase(route.left.begin() + static_cast<std::ptrdiff_t>(step.option));
  route.score = std::move(step.score);
}

// Cross-validation hardly tests a table inside a gap, because held-out configurations lie close to fitted ones.
// Evidence decides among lengths that predict equally well.
bool is_better_length(const ModelScore& shorter, const ModelScore& longer) {
  return shorter.determined && (shorter.held_out_rms < longer.held_out_rms ||
                                (is_likelier(shorter, longer) && predicts_as_well(shorter, longer)));
}

// Higher evidence and a better prediction, or an equal one within a standard error with fewer terms.
bool is_preferable(const Route& one, const Route& other) {
  const bool fewer = one.model.terms.size() < other.model.terms.size();
  return is_likelier(one.score, other.score) &&
         (one.score.held_out_rms < other.score.held_out_rms || (fewer && predicts_as_well(one.score, other.score)));
}

std::vector<EffectTerm> with_sigmas(std::vector<EffectTerm> terms, const ModelScore& score) {
  for (EffectTerm& term : terms) {
    term.sigma = size_of(score, size_name(term));
  }
  std::erase_if(terms, [](const EffectTerm& term) { return !(term.sigma > 0.0) || is_withheld_throughout(term); });
  return terms;
}

// However many points are measured of it, a configuration shows no more than the pose of the flange: six equations.
double equations_of(const Measurements& means) {
  std::vector<double> of_configuration(means.configurations.size(), 0.0);
  for (const Observation& o : means.observations) {
    of_configuration[static_cast<std::size_t>(o.configuration)] +=
        dimension(o.reading) + (has_orientation(o) ? 3.0 : 0.0);
  }
  return std::accumulate(of_configuration.begin(), of_configuration.end(), 0.0,
                         [](double sum, double coordinates) { return sum + std::min(coordinates, 6.0); });
}

// Selection for one set of measurements.
class ModelSelector {
public:
  // A selection inside another one reports no progress.
  enum class Place { outermost, inside };
  ModelSelector(const ModelSelectionTask& task, const Measurements& means, int threads, Place place)
      : task_(task),
        means_(means),
        threads_(threads),
        place_(place),
        scorer_(task, means, threads, place == Place::outermost),
        equations_(equations_of(means)) {}

  // `terms`: selected terms and those of size zero, in the order of the columns of `values` after the rigid ones.
  struct Outcome {
    ModelSelection choice;
    std::vector<EffectTerm> terms;
    VectorXd values;
  };

  Outcome choose() const {
    const ModelSelectionOptions& options = task_.options;
    Outcome outcome;
    ModelSelection& result = outcome.choice;
    TriedModels tried;
    Route route;
    route.score = scorer_.score_of(route.model, tried);
    if (options.automatic_priors) {
      const CandidateModel sized{.terms = {}, .names = {}, .sized = true};
      ModelScore with_sizes = scorer_.score_of(sized, tried);
      if (is_clearly_better(with_sizes, route.score)) {
        route.model = sized;
        route.score = std::move(with_sizes);
      }
    }
    result.not_compared = static_cast<std::size_t>(scorer_.not_compared());
    result.rigid_priors = scorer_.priors_of(route.score, route.model.sized);
    if (options.effects.automatic) {
      add_what_helps(route, tried);
      result.not_tried = groups_not_tried(route);
    } else {
      add_asked(route, tried);
    }
    result.priors = scorer_.priors_of(route.score, route.model.sized);
    withhold_tables(route);
    result.terms = with_sigmas(route.model.terms, route.score);
    result.noise = route.score.noise;
    tried.put_first(route.model.names, route.model.sized);
    result.tried = tried.options();
    if (place_ == Place::outermost && options.effects.automatic && std::cmp_less(configurations(), kEnoughForRadii)) {
      result.plausible = with_sag(route);
    }
    if (place_ == Place::outermost && options.effects.groups.empty()) {
      result.optimism = tried.optimism();
    }
    outcome.terms = std::move(route.model.terms);
    outcome.values = route.score.sizes.values;
    return outcome;
  }

private:
  Index configurations() const { return means_.joint_values.cols(); }

  std::vector<EffectTerm> allowed(std::vector<EffectTerm> terms) const {
    std::erase_if(terms, [&](const EffectTerm& term) { return fixes_effect(task_.fix, term); });
    return terms;
  }

  EffectOption option_of(EffectGroup group) const {
    return {.name = to_string(group),
            .terms = allowed(effect_terms(task_.model, group, means_.joint_values, means_.signals))};
  }

  EffectOption option_of(const OwnEffect& own) const {
    EffectOption option{.name = "own." + own.name, .terms = own_terms(task_.model, own, means_.joint_values)};
    if (option.terms.empty()) {
      throw InputError("effects.own: " + own.name + " is the same at all configurations, expected one that varies");
    }
    option.terms = allowed(std::move(option.terms));
    return option;
  }

  // Tables get the length that predicts best; ripple is searched in the residuals of all other groups.
  void add_asked(Route& route, TriedModels& tried) const {
    const std::vector<EffectGroup>& groups = task_.options.effects.groups;
    const auto is_asked = [&](EffectGroup group) {
      return std::find(groups.begin(), groups.end(), group) != groups.end();
    };
    for (const EffectGroup group : groups) {
      if (group != EffectGroup::ripple && group != EffectGroup::tables) {
        route.model = extended(std::move(route.model), option_of(group));
      }
    }
    for (const OwnEffect& own : task_.options.effects.own) {
      route.model = extended(std::move(route.model), option_of(own));
    }
    EffectOption tables;
    if (is_asked(EffectGroup::tables)) {
      tables = option_of(EffectGroup::tables);
    }
    const CandidateModel beside = route.model;
    if (!tables.terms.empty()) {
      route.model = extended(std::move(route.model), tables);
    }
    if (!route.model.terms.empty()) {
      route.score = scorer_.score_of(route.model, tried);
      require_enough(route);
    }
    if (!tables.terms.empty() && route.score.determined && configurations() >= kLeastForTables) {
      shorten(beside, tables, route.score, tried);
      route.model = extended(beside, tables);
    }
    if (!is_asked(EffectGroup::ripple)) {
      return;
    }
    if (const EffectOption ripple = ripple_beside(route.model, route.score); !ripple.terms.empty()) {
      route.model = extended(std::move(route.model), ripple);
      route.score = scorer_.score_of(route.model, tried);
      require_enough(route);
    }
  }

  void require_enough(const Route& route) const {
    if (route.score.sizes.sizes.empty()) {
      throw InputError(fmt::format("{}: too few measurements for the effects asked for, {} terms beside {} parameters",
                                   means_.source, route.model.terms.size(), task_.free.size()));
    }
  }

  // Ripple found in the residuals of a model.
  EffectOption ripple_beside(const CandidateModel& model, const ModelScore& score) const {
    EffectOption ripple{.name = to_string(EffectGroup::ripple), .terms = {}};
    if (!score.determined) {
      return ripple;
    }
    const Candidate candidate = with_terms(task_.model, task_.free, model.terms, model.sized);
    const LinearRows rows = linear_rows(candidate, means_, task_.optimum, task_.orientation_length);
    const LinearRows joints = joint_rows(task_.model, means_, task_.optimum, task_.orientation_length);
    std::vector<Index> all(static_cast<std::size_t>(configurations()));
    std::iota(all.begin(), all.end(), Index{0});
    SizedInformation known = sized_information(sums_of(rows, all).information, score.groups, score.sizes);
    RippleData data{.model = task_.model,
                    .joint_values = means_.joint_values,
                    .rows = rows,
                    .joints = joints,
                    .information = std::move(known.matrix),
                    .columns = std::move(known.columns),
                    .values = score.sizes.values};
    ripple.terms = with_progress(place_ == Place::outermost ? task_.progress : nullptr, "looking for ripple",
                                 [&] { return allowed(find_ripple(std::move(data), threads_)); });
    return ripple;
  }

  // How many configurations like the measured ones carry a model with one more group: others could hide a mistake in
  // its terms. Every arm sags, so that gravity needs fewer equations; tables are one smooth function of a joint however
  // many terms they have.
  Index configurations_for(const CandidateModel& model, const EffectOption& option) const {
    constexpr double kEquations = 1.5;  // of each unknown
    constexpr double kEquationsOfGravity = 1.1;
    if (is_tables(option) || is_ripple(option)) {
      return 0;
    }
    const double unknowns =
        static_cast<double>(task_.free.size()) + static_cast<double>(model.terms.size() + option.terms.size());
    return static_cast<Index>(std::ceil((is_gravity(option) ? kEquationsOfGravity : kEquations) * unknowns *
                                        static_cast<double>(configurations()) / equations_));
  }

  std::vector<NotTried> groups_not_tried(const Route& route) const {
    std::vector<NotTried> result = groups_not_allowed(configurations(), means_.signals);
    for (const EffectOption& option : route.left) {
      if (const Index needed = configurations_for(route.model, option); needed > configurations()) {
        const std::vector<std::string>& names = route.model.names;
        result.push_back({.what = option.name,
                          .why = fmt::format("{} configurations needed beside {}", needed,
                                             names.empty() ? "the geometry" : comma_separated(names))});
      }
    }
    return result;
  }

  // Tables can imitate nearly every other effect. If they were added before other helpful groups, a second route adds
  // those first and tables last.
  void add_what_helps(Route& route, TriedModels& tried) const {
    for (const EffectGroup group : groups_allowed(configurations(), means_.signals)) {
      if (EffectOption option = option_of(group); !option.terms.empty()) {
        route.left.push_back(std::move(option));
      }
    }
    for (const OwnEffect& own : task_.options.effects.own) {
      route.left.push_back(option_of(own));
    }
    std::optional<Route> other = follow(route, tried);
    if (!other) {
      return;
    }
    follow(*other, tried);
    if (takes_the_place(*other, route, tried)) {
      route = std::move(*other);
    }
  }

  // Repeatedly adds the helpful group of highest evidence. If that is tables while other groups help too, also returns
  // a second route, which continues with the best of those instead.
  std::optional<Route> follow(Route& route, TriedModels& tried) const {
    std::optional<Route> without_tables;
    while (route.score.determined) {
      look_for_ripple(route);
      const double wanted = evidence_to_accept(route.score);
      std::optional<Step> other = likeliest(route, tried, std::not_fn(is_tables), wanted);
      const double of_tables = other ? std::max(wanted, other->score.sizes.evidence) : wanted;
      std::optional<Step> tables = likeliest(route, tried, is_tables, of_tables);
      if (tables && other) {
        without_tables = route;
        take(std::move(*other), *without_tables);
        std::erase_if(without_tables->left, is_tables);
      }
      std::optional<Step>& best = tables ? tables : other;
      if (best) {
        take(std::move(*best), route);
      } else if (!renew_ripple(route, tried)) {
        break;
      }
    }
    return without_tables;
  }

  void look_for_ripple(Route& route) const {
    std::erase_if(route.left, is_ripple);
    const std::vector<std::string>& names = route.model.names;
    const bool known = std::find(names.begin(), names.end(), to_string(EffectGroup::ripple)) != names.end();
    if (known || configurations() < kLeastForRipple) {
      return;
    }
    if (EffectOption ripple = ripple_beside(route.model, route.score); !ripple.terms.empty()) {
      route.left.push_back(std::move(ripple));
    }
  }

  // Every arm sags, so that a better prediction need not be proved of gravity.
  static bool is_helpful(const EffectOption& option, const ModelScore& with, const ModelScore& without) {
    const bool is_better = with.held_out_rms < without.held_out_rms && with.motion <= kLargestMotion;
    return helps(with, without) || (is_gravity(option) && is_better);
  }

  // Every arm sags. What else explains as much where it was measured, such as harmonics, does not elsewhere.
  static double evidence_beforehand(const EffectOption& option) {
    constexpr double kOfGravity = 7.0;  // as much as a group must gain
    return is_gravity(option) ? kOfGravity : 0.0;
  }

  // The option of highest evidence among those that help and reach this evidence; tables with the longest length.
  template <class Filter>
  std::optional<Step> likeliest(Route& route, TriedModels& tried, Filter is_asked, double wanted) const {
    std::optional<Step> best;
    double most = 0.0;
    for (std::size_t i = 0; i < route.left.size(); ++i) {
      EffectOption& option = route.left[i];
      if (!is_asked(option)) {
        continue;
      }
      if (is_gravity(option) && configurations_for(route.model, option) > configurations()) {
        option = main_of(option);
      }
      if (configurations_for(route.model, option) > configurations()) {
        continue;
      }
      ModelScore with = scorer_.score_of(extended(route.model, option), tried, wanted);
      if (is_gravity(option)) {
        reduce(route.model, option, with, tried, wanted);
      }
      if (is_tables(option) && with.determined) {
        shorten(route.model, option, with, tried);
      }
      const double evidence = with.sizes.evidence + evidence_beforehand(option);
      if (is_helpful(option, with, route.score) && (!best || evidence > most)) {
        best = Step{.option = i, .score = std::move(with)};
        most = evidence;
      }
    }
    return best;
  }

  EffectOption main_of(const EffectOption& gravity) const {
    return {.name = gravity.name, .terms = main_gravity_terms(task_.model, gravity.terms)};
  }

  // Gravity's main terms alone, where they are likelier and predict as well: many terms of one size hide the few that
  // are large.
  void reduce(const CandidateModel& beside, EffectOption& gravity, ModelScore& all, TriedModels& tried,
              double wanted) const {
    EffectOption fewer = main_of(gravity);
    if (fewer.terms.size() == gravity.terms.size()) {
      return;
    }
    ModelScore with = scorer_.score_of(extended(beside, fewer), tried, std::max(wanted, all.sizes.evidence));
    if (with.determined && (!all.determined || predicts_as_well(with, all))) {
      gravity = std::move(fewer);
      all = std::move(with);
    }
  }

  // Shortens the correlation length while the prediction improves, or stays equal with higher evidence.
  void shorten(const CandidateModel& beside, EffectOption& tables, ModelScore& best, TriedModels& tried) const {
    for (const double degrees : {10.0, 4.0}) {
      const double length = degrees * std::numbers::pi / 180.0;
      EffectOption shorter{.name = tables.name,
                           .terms = allowed(table_terms(task_.model, means_.joint_values, length))};
      std::erase_if(shorter.terms, [&](const EffectTerm& term) {  // flat tables are not shortened
        return size_of(best, size_name(term)) < kFlatTable;
      });
      if (shorter.terms.empty()) {
        return;
      }
      ModelScore with = scorer_.score_of(extended(beside, shorter), tried);
      if (!is_better_length(with, best)) {
        return;
      }
      tables = std::move(shorter);
      best = std::move(with);
    }
  }

  // Repeats the ripple search with the present model. Returns whether evidence and prediction improve; ripple is then
  // the last group.
  bool renew_ripple(Route& route, TriedModels& tried) const {
    const auto is_one = [](const EffectTerm& term) { return term.group() == EffectGroup::ripple; };
    CandidateModel model = route.model;
    if (std::erase(model.names, to_string(EffectGroup::ripple)) == 0 || is_one(model.terms.back())) {
      return false;
    }
    std::erase_if(model.terms, is_one);
    const EffectOption ripple = ripple_beside(model, scorer_.score_of(model, tried));
    if (ripple.terms.empty()) {
      return false;
    }
    model = extended(std::move(model), ripple);
    ModelScore renewed = scorer_.score_of(model, tried, evidence_to_prefer(route.score));
    if (!(renewed.held_out_rms < route.score.held_out_rms) || renewed.motion > kLargestMotion) {
      return false;
    }
    route.model = std::move(model);
    route.score = std::move(renewed);
    return true;
  }

  // Whether `other`, with tables added if they help, is preferable.
  bool takes_the_place(Route& other, const Route& route, TriedModels& tried) const {
    std::vector<std::string> names = other.model.names;
    names.emplace_back(to_string(EffectGroup::tables));
    if (has_groups(route.model, names)) {
      return !helps(route.score, other.score) || route.score.sizes.evidence < evidence_to_accept(other.score);
    }
    other.left = {option_of(EffectGroup::tables)};
    const double wanted = evidence_to_accept(other.score);
    if (std::optional<Step> step = likeliest(other, tried, is_tables, wanted)) {
      take(std::move(*step), other);
    }
    return is_preferable(other, route);
  }

  // The chosen model, and those with the sag that it lacks. Every arm sags, also where too few configurations show it.
  std::vector<PlausibleModel> with_sag(const Route& route) const {
    constexpr double kLeastOdds = 0.01;
    constexpr double kCertain = 30.0;
    const EffectOption gravity = option_of(EffectGroup::gravity);
    const std::vector<std::string>& names = route.model.names;
    const bool is_chosen = std::find(names.begin(), names.end(), gravity.name) != names.end();
    if (is_chosen || gravity.terms.empty() || route.score.sizes.values.size() == 0) {
      return {};
    }
    std::vector<PlausibleModel> result = {plausible(route.model, route.score, 1.0)};
    TriedModels none;
    for (const EffectOption& sag : {gravity, main_of(gravity)}) {
      const CandidateModel model = extended(route.model, sag);
      const ModelScore score = scorer_.score_of(model, none, std::numeric_limits<double>::infinity());
      const double odds = std::exp(std::min(score.sizes.evidence - route.score.sizes.evidence, kCertain));
      if (score.sizes.values.size() > 0 && odds > kLeastOdds) {
        result.push_back(plausible(model, score, odds));
      }
    }
    return result;
  }

  PlausibleModel plausible(const CandidateModel& model, const ModelScore& score, double odds) const {
    Candidate candidate = with_terms(task_.model, task_.free, model.terms, model.sized);
    Estimate start = task_.optimum;
    start.effects = VectorXd::Zero(std::ssize(model.terms));
    Estimate estimate = candidate.free.moved(start, score.sizes.values);
    return {.model = std::move(candidate.model), .estimate = std::move(estimate), .odds = odds};
  }

  // Withholds tables where the measurements tell too little about them.
  void withhold_tables(Route& route) const {
    std::vector<EffectTerm>& terms = route.model.terms;
    if (route.score.sizes.sizes.empty() || std::none_of(terms.begin(), terms.end(), is_of_table)) {
      return;
    }
    const Candidate candidate = with_terms(task_.model, task_.free, terms, route.model.sized);
    TableCertainty(candidate, route.score.groups, route.score.sizes).withhold_gaps(terms);
  }

  const ModelSelectionTask& task_;
  const Measurements& means_;
  int threads_;
  Place place_;
  ModelScorer scorer_;
  double equations_ = 0.0;  // see equations_of()
};

Measurements means_of(const ModelSelectionTask& task) {
  return averaged(training_sample(task.measurements, kMostConfigurations));
}

}  // namespace

ModelSelection select_effects(const ModelSelectionTask& task) {
  const Measurements means = means_of(task);
  return ModelSelector(task, means, task.threads, ModelSelector::Place::outermost).choose().choice;
}

ModelSelection select_model(const ModelSelectionTask& task, const Identification& rigid, bool determined,
                            Method method) {
  constexpr double kNothingToLearn = 1e-10;  // [m] smaller misfits differ only by rounding
  ModelSelection as_stated{.priors = task.options.priors, .rigid_priors = task.options.priors};
  if (!needs_selection(task.options) || method != Method::joint || !(rigid.rms > kNothingToLearn)) {
    return as_stated;
  }
  const bool automatic = task.options.automatic_priors || task.options.effects.automatic;
  if (!has_converged(rigid)) {
    as_stated.not_tried = {{"priors and effects", "the fit of the geometry alone did not converge"}};
  } else if (automatic && task.measurements.stations.size() > 1 &&
             !can_be_left_out(task.measurements, make_folds(task.measurements, 0), 0)) {
    as_stated.not_tried = {
        {"priors and effects", "no configuration can be left out: each station needs all of its own"}};
  } else {
    ModelSelectionOptions options = task.options;
    options.automatic_priors = options.automatic_priors && determined;
    ModelSelection selection = select_effects({task.model, task.measurements, task.optimum, task.free, options,
                                               task.fix, task.orientation_length, task.threads, task.progress});
    if (task.options.automatic_priors && !determined) {
      selection.not_tried.push_back({"priors", "they would hide what the measurements do not determine"});
    }
    return selection;
  }
  return as_stated;
}

std::vector<double> nested_distances(const ModelSelectionTask& task, const std::function<void()>& after_fold) {
  const Measurements means = means_of(task);
  const std::vector<std::vector<Index>> folds = make_folds(means, 0);
  std::vector<std::vector<double>> distances(folds.size());
  parallel_for(folds.size(), task.threads, [&](std::size_t f) {
    const auto is_left_out = [&](const Observation& o) {
      return std::find(folds[f].begin(), folds[f].end(), o.configuration) != folds[f].end();
    };
    const Measurements rest = subset(means, [&](const Observation& o) { return !is_left_out(o); });
    const ModelSelector::Outcome chosen = ModelSelector(task, rest, 1, ModelSelector::Place::inside).choose();
    const Candidate candidate = with_terms(task.model, task.free, chosen.terms, false);
    const Measurements fold = subset(means, is_left_out);
    const LinearRows left = linear_rows(candidate, fold, task.optimum, task.orientation_length);
    std::vector<bool> known(means.targets.size(), false);  // determined by the other folds or stated by the user
    for (const Observation& o : rest.observations) {
      known[static_cast<std::size_t>(o.target)] = true;
    }
    for (std::size_t k = 0; k < known.size(); ++k) {
      const std::array<int, 6> columns = task.free.target_columns(k);
      known[k] = known[k] || std::all_of(columns.begin(), columns.end(), [](int column) { return column < 0; });
    }
    if (chosen.values.size() == left.columns()) {
      const VectorXd error = left.residual(left.y, chosen.values) * left.unit;
      std::vector<Index> next(left.first.begin(), left.first.end());  // position rows come first
      for (const Observation& o : fold.observations) {
        Index& row = next[static_cast<std::size_t>(o.configuration)];
        if (known[static_cast<std::size_t>(o.target)]) {
          distances[f].push_back(error.segment<3>(row).norm());
        }
        row += 3;
      }
    }
    if (after_fold) {
      after_fold();
    }
  });
  std::vector<double> result;
  for (const std::vector<double>& fold : distances) {
    result.insert(result.end(), fold.begin(), fold.end());
  }
  return result;
}

}  // namespace kdl_calibration
