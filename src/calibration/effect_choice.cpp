#include "calibration/effect_choice.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

#include "base/parallel.hpp"
#include "base/text.hpp"
#include "calibration/counted_fits.hpp"
#include "calibration/effect_candidates.hpp"
#include "calibration/parameter_choice.hpp"
#include "calibration/ripple_search.hpp"
#include "calibration/table_certainty.hpp"
#include "calibration/tried_models.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/group_sizes.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/validation.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostConfigurations = 2000;
constexpr std::size_t kMostSingleFolds = 40;
constexpr int kFolds = 10;
constexpr double kEvidence = 2.0;        // that an effect must add
constexpr double kWorthwhile = 0.98;     // of the held-out RMS
constexpr double kRounding = 1e-9;       // [m] of the numbers in a file
constexpr double kLeastPrior = 1e-7;     // [m or rad]
constexpr double kLargestMotion = 0.02;  // [m or rad] what moves a joint by more is no effect but a mistake
constexpr double kFlatTable = 5e-6;      // [m or rad]
constexpr double kUnlimited = std::numeric_limits<double>::infinity();
constexpr Index kLeastForRipple = 100;  // configurations
constexpr Index kLeastForTables = 50;   // configurations
constexpr double kEquations = 1.1;      // for every column

// What a candidate is worth.
struct Worth {
  bool determined = false;
  GroupSizes sizes;
  Groups groups;
  MatrixXd information;  // J^T J
  double noise = 0.0;    // [m] of a coordinate of a mean
  double motion = 0.0;   // [m or rad] largest of a joint by all effects
  VectorXd squares;      // [m^2] of each held-out configuration, summed over its points
  double held_out_rms = std::numeric_limits<double>::infinity();
};

std::vector<Index> all_of(Index count) {
  std::vector<Index> columns(static_cast<std::size_t>(count));
  std::iota(columns.begin(), columns.end(), Index{0});
  return columns;
}

// The choice at one set of data.
class Chooser {
public:
  // Inside another choice nobody is told what is being tried.
  enum class Place { outermost, inside };
  Chooser(const ChoiceTask& task, Measurements means, int threads, Place place)
      : task_(task), means_(std::move(means)), threads_(threads), place_(place) {
    const std::vector<std::vector<Index>> singly = make_folds(means_, 0);
    folds_ = singly.size() < kMostSingleFolds ? singly : make_folds(means_, kFolds);
    points_ = static_cast<double>(means_.observations.size());
  }

  // `terms`: those of the choice and those whose size is zero, as the columns of `values` behind the rigid ones.
  struct Outcome {
    Choice choice;
    std::vector<EffectTerm> terms;
    VectorXd values;
  };

  Outcome choose() const {
    const CalibrationOptions& options = task_.options;
    const bool asked = !options.effects.automatic;
    Outcome outcome;
    Choice& result = outcome.choice;
    TriedModels tried;
    bool sized = false;
    std::vector<EffectTerm>& terms = outcome.terms;
    std::vector<std::string> names;
    Worth current = worth_of({}, {}, false, tried);
    if (options.automatic_priors) {
      Worth with_sizes = worth_of({}, {}, true, tried);
      sized = with_sizes.held_out_rms < current.held_out_rms;
      current = sized ? std::move(with_sizes) : std::move(current);
    }
    result.rigid_priors = priors_of(current, sized);
    if (asked) {
      add_asked(sized, terms, names, current, tried);
    } else {
      add_what_helps(sized, terms, names, current, tried);
    }
    result.priors = priors_of(current, sized);
    withhold_tables(sized, terms, current);
    result.terms = with_sigmas(terms, current);
    result.noise = current.noise;
    tried.put_first(names, sized);
    result.tried = tried.options();
    if (place_ == Place::outermost && options.effects.groups.empty()) {
      result.price = tried.price_of_choosing();
    }
    outcome.values = current.sizes.values;
    return outcome;
  }

private:
  static void append(std::vector<EffectTerm>& terms, const std::vector<EffectTerm>& more) {
    terms.insert(terms.end(), more.begin(), more.end());
  }

  std::vector<EffectTerm> allowed(std::vector<EffectTerm> terms) const {
    std::erase_if(terms, [&](const EffectTerm& term) { return fixes_effect(task_.options, term); });
    return terms;
  }

  std::vector<EffectTerm> terms_of(EffectGroup group) const {
    return allowed(effect_terms(task_.model, group, means_.joint_values, means_.signals));
  }

  struct Option {
    std::string name;
    std::vector<EffectTerm> terms;
  };

  // Tables get the length that predicts best; ripple is looked for in what all others leave.
  void add_asked(bool sized, std::vector<EffectTerm>& terms, std::vector<std::string>& names, Worth& current,
                 TriedModels& tried) const {
    const std::vector<EffectGroup>& groups = task_.options.effects.groups;
    const auto is_asked = [&](EffectGroup group) {
      return std::find(groups.begin(), groups.end(), group) != groups.end();
    };
    for (const EffectGroup group : groups) {
      if (group != EffectGroup::ripple && group != EffectGroup::tables) {
        append(terms, terms_of(group));
        names.emplace_back(to_string(group));
      }
    }
    Option tables{.name = to_string(EffectGroup::tables), .terms = {}};
    if (is_asked(EffectGroup::tables)) {
      tables.terms = terms_of(EffectGroup::tables);
    }
    const std::vector<EffectTerm> all = joined(terms, tables.terms);
    if (!all.empty()) {
      const std::vector<std::string> with_tables = tables.terms.empty() ? names : extended(names, tables.name);
      current = worth_of(all, with_tables, sized, tried);
      require_enough(current, all);
      if (!tables.terms.empty() && current.determined && means_.joint_values.cols() >= kLeastForTables) {
        shorten(sized, {terms, names}, tables, current, tried);
      }
      append(terms, tables.terms);
      names = with_tables;
    }
    if (!is_asked(EffectGroup::ripple)) {
      return;
    }
    if (const Option ripple = ripple_of(sized, terms, current); !ripple.terms.empty()) {
      append(terms, ripple.terms);
      names.push_back(ripple.name);
      current = worth_of(terms, names, sized, tried);
      require_enough(current, terms);
    }
  }

  void require_enough(const Worth& worth, const std::vector<EffectTerm>& terms) const {
    if (worth.sizes.sizes.empty()) {
      throw InputError(means_.source + ": too few measurements for the effects asked for, " +
                       std::to_string(terms.size()) + " terms beside " + std::to_string(task_.free.size()) +
                       " parameters");
    }
  }

  // What joints still swing by beside a model.
  Option ripple_of(bool sized, const std::vector<EffectTerm>& terms, const Worth& worth) const {
    Option ripple{.name = to_string(EffectGroup::ripple), .terms = {}};
    if (!worth.determined) {
      return ripple;
    }
    const Candidate candidate = with_terms(task_.model, task_.free, terms, sized);
    const LinearRows rows = linear_rows(candidate, means_, task_.optimum, task_.orientation_length);
    const LinearRows joints = joint_rows(task_.model, means_, task_.optimum, task_.orientation_length);
    SizedInformation known = sized_information(worth.information, worth.groups, worth.sizes);
    RippleData data{.model = task_.model,
                    .joint_values = means_.joint_values,
                    .rows = rows,
                    .joints = joints,
                    .information = std::move(known.matrix),
                    .columns = std::move(known.columns),
                    .values = worth.sizes.values};
    ripple.terms = allowed(find_ripple(std::move(data), threads_));
    return ripple;
  }

  // Groups that the number of configurations allows; tables of the longest length.
  std::vector<Option> options() const {
    const std::map<EffectGroup, Index> least = {{EffectGroup::gravity, 12},   {EffectGroup::transverse, 60},
                                                {EffectGroup::gain, 20},      {EffectGroup::backlash, 20},
                                                {EffectGroup::harmonics, 20}, {EffectGroup::tables, kLeastForTables}};
    std::vector<Option> result;
    for (const auto& [group, configurations] : least) {
      if (means_.joint_values.cols() >= configurations) {
        result.push_back({.name = to_string(group), .terms = terms_of(group)});
      }
    }
    return result;
  }

  // Folds are predicted only where the evidence is at least `wanted`.
  Worth worth_of(const std::vector<EffectTerm>& terms, const std::vector<std::string>& names, bool sized,
                 TriedModels& tried, double wanted = -kUnlimited) const {
    const Candidate candidate = with_terms(task_.model, task_.free, terms, sized);
    Worth worth;
    worth.groups = groups_of(candidate, task_.options.priors);
    const LinearRows rows = linear_rows(candidate, means_, task_.optimum, task_.orientation_length);
    if (static_cast<double>(rows.J.rows()) < kEquations * static_cast<double>(rows.J.cols())) {
      return worth;
    }
    const Index configurations = static_cast<Index>(rows.first.size()) - 1;
    const std::vector<Index> columns = all_of(rows.J.cols());
    LinearSums all = sums_of(rows, all_of(configurations));
    const double rounding = kRounding / rows.unit;
    const SizeEstimator whole(all, columns, worth.groups.columns);
    if (!whole.is_determined()) {
      return worth;
    }
    worth.sizes = whole.estimate({}, worth.groups.limits, rounding);
    worth.noise = worth.sizes.sigma * rows.unit;
    worth.motion = motion_of(candidate, worth.sizes.values);
    if (worth.sizes.evidence >= wanted) {
      const std::string what = in_words(names, terms, sized);
      predict_folds(candidate, rows, all, worth,
                    place_ == Place::outermost ? counted_fits(task_.options, what, folds_.size()) : nullptr);
    }
    tried.add({.priors = priors_of(worth, sized),
               .effects = names,
               .sized = sized,
               .held_out_rms = worth.held_out_rms,
               .evidence = worth.sizes.evidence},
              worth.squares);
    worth.information = std::move(all.information);
    return worth;
  }

  // Tables are tried in several lengths.
  static std::string in_words(const std::vector<std::string>& names, const std::vector<EffectTerm>& terms, bool sized) {
    double length = 0.0;
    for (const EffectTerm& term : terms) {
      length = std::max(length, term.table.length);
    }
    const long degrees = std::lround(length * 180.0 / std::numbers::pi);
    return "trying " + (names.empty() ? "geometry alone" : comma_separated(names)) +
           (degrees > 0 ? " of " + std::to_string(degrees) + " degrees" : "") + (sized ? " with priors" : "");
  }

  double motion_of(const Candidate& candidate, const VectorXd& values) const {
    if (candidate.model.effects.empty()) {
      return 0.0;
    }
    const ColumnRange effects = candidate.free.range(UnknownGroup::effects);
    MatrixXd moved = effective_joint_values(candidate.model, values.segment(effects.first, effects.count),
                                            means_.joint_values, means_.signals);
    moved.topRows(means_.joint_values.rows()) -= means_.joint_values;
    return moved.cwiseAbs().maxCoeff();
  }

  void predict_folds(const Candidate& candidate, const LinearRows& rows, const LinearSums& all, Worth& worth,
                     const std::function<void()>& after_fold) const {
    const std::vector<Index> columns = all_of(rows.J.cols());
    const double rounding = kRounding / rows.unit;
    worth.squares = VectorXd::Zero(static_cast<Index>(rows.first.size()) - 1);
    std::vector<int> predicted(folds_.size(), 0);
    parallel_for(folds_.size(), threads_, [&](std::size_t f) {
      LinearSums without = all;
      without -= sums_of(rows, folds_[f]);
      const SizeEstimator rest(without, columns, worth.groups.columns);
      if (!rest.is_determined()) {
        return;
      }
      const GroupSizes sizes = rest.estimate(worth.sizes.sizes, worth.groups.limits, rounding);
      const TableCertainty certainty(candidate, without.information, worth.groups, sizes);
      for (const Index c : folds_[f]) {
        VectorXd x = sizes.values;
        certainty.withhold(means_.joint_values.col(c), x);
        const Index first = rows.first[static_cast<std::size_t>(c)];
        const Index count = rows.first[static_cast<std::size_t>(c) + 1] - first;
        worth.squares[c] = (rows.y.segment(first, count) - rows.J.middleRows(first, count) * x).squaredNorm();
      }
      predicted[f] = 1;
      if (after_fold) {
        after_fold();
      }
    });
    worth.squares *= rows.unit * rows.unit;
    worth.determined = std::all_of(predicted.begin(), predicted.end(), [](int p) { return p == 1; });
    if (worth.determined) {
      worth.held_out_rms = std::sqrt(worth.squares.sum() / points_);
    }
  }

  // Mean gain of a configuration's squares, over its standard error.
  static double certainty_of_gain(const Worth& with, const Worth& without) {
    const VectorXd gain = without.squares - with.squares;
    const auto n = static_cast<double>(gain.size());
    const double mean = gain.mean();
    return mean / std::sqrt((gain.array() - mean).square().sum() / (n * (n - 1.0)));
  }

  static bool helps(const Worth& with, const Worth& without) {
    return with.determined && with.motion <= kLargestMotion &&
           with.held_out_rms <= kWorthwhile * without.held_out_rms && certainty_of_gain(with, without) > 1.0;
  }

  // What is left out lies next to what is not: of how far tables reach into gaps the evidence knows more.
  static bool is_better_length(const Worth& shorter, const Worth& longer) {
    if (!shorter.determined) {
      return false;
    }
    const bool likelier = shorter.sizes.evidence >= longer.sizes.evidence + kEvidence;
    return shorter.held_out_rms < longer.held_out_rms || (likelier && certainty_of_gain(shorter, longer) > -1.0);
  }

  // A model and the groups that may still be added to it.
  struct Route {
    std::vector<EffectTerm> terms;
    std::vector<std::string> names;
    Worth worth;
    std::vector<Option> left;
  };

  // One of the groups that may be added, and what the model is worth with it.
  struct Step {
    std::size_t option = 0;
    Worth worth;
  };

  static bool is_tables(const Option& option) { return option.name == to_string(EffectGroup::tables); }
  static bool is_ripple(const Option& option) { return option.name == to_string(EffectGroup::ripple); }

  static void take(Step step, Route& route) {
    Option& option = route.left[step.option];
    append(route.terms, option.terms);
    route.names.push_back(option.name);
    route.left.erase(route.left.begin() + static_cast<std::ptrdiff_t>(step.option));
    route.worth = std::move(step.worth);
  }

  void look_for_ripple(bool sized, Route& route) const {
    std::erase_if(route.left, is_ripple);
    const bool known =
        std::find(route.names.begin(), route.names.end(), to_string(EffectGroup::ripple)) != route.names.end();
    if (known || means_.joint_values.cols() < kLeastForRipple) {
      return;
    }
    if (Option ripple = ripple_of(sized, route.terms, route.worth); !ripple.terms.empty()) {
      route.left.push_back(std::move(ripple));
    }
  }

  // The likeliest of those options that help.
  template <class Filter>
  std::optional<Step> likeliest(bool sized, Route& route, TriedModels& tried, Filter is_asked) const {
    std::optional<Step> best;
    for (std::size_t i = 0; i < route.left.size(); ++i) {
      Option& option = route.left[i];
      if (!is_asked(option)) {
        continue;
      }
      const double wanted = route.worth.sizes.evidence + kEvidence;
      Worth with =
          worth_of(joined(route.terms, option.terms), extended(route.names, option.name), sized, tried, wanted);
      if (is_tables(option) && with.determined) {
        shorten(sized, {route.terms, route.names}, option, with, tried);
      }
      if (helps(with, route.worth) && (!best || with.sizes.evidence > best->worth.sizes.evidence)) {
        best = Step{.option = i, .worth = std::move(with)};
      }
    }
    return best;
  }

  // The likeliest of what helps, again and again. Where it is tables while others help as well, the model goes on from
  // the likeliest of these, without tables, is returned too.
  std::optional<Route> follow(bool sized, Route& route, TriedModels& tried) const {
    std::optional<Route> without_tables;
    while (route.worth.determined) {
      look_for_ripple(sized, route);
      std::optional<Step> other = likeliest(sized, route, tried, std::not_fn(is_tables));
      std::optional<Step> tables = likeliest(sized, route, tried, is_tables);
      const bool tables_first = tables && (!other || tables->worth.sizes.evidence > other->worth.sizes.evidence);
      if (tables_first && other) {
        without_tables = route;
        take(std::move(*other), *without_tables);
        std::erase_if(without_tables->left, is_tables);
      }
      std::optional<Step>& best = tables_first ? tables : other;
      if (best) {
        take(std::move(*best), route);
      } else if (!renew_ripple(sized, route, tried)) {
        break;
      }
    }
    return without_tables;
  }

  // Ripple that was found beside less than what is known now is looked for again. Whether that is likelier and predicts
  // better; it is the last group then.
  bool renew_ripple(bool sized, Route& route, TriedModels& tried) const {
    const auto is_one = [](const EffectTerm& term) { return term.group == EffectGroup::ripple; };
    Route renewed{.terms = route.terms, .names = route.names, .worth = {}, .left = {}};
    if (std::erase(renewed.names, to_string(EffectGroup::ripple)) == 0 || is_one(route.terms.back())) {
      return false;
    }
    std::erase_if(renewed.terms, is_one);
    Option ripple = ripple_of(sized, renewed.terms, worth_of(renewed.terms, renewed.names, sized, tried));
    if (ripple.terms.empty()) {
      return false;
    }
    append(renewed.terms, ripple.terms);
    renewed.names.push_back(ripple.name);
    renewed.worth = worth_of(renewed.terms, renewed.names, sized, tried, route.worth.sizes.evidence + kEvidence);
    if (!(renewed.worth.held_out_rms < route.worth.held_out_rms) || renewed.worth.motion > kLargestMotion) {
      return false;
    }
    renewed.left = std::move(route.left);
    route = std::move(renewed);
    return true;
  }

  // Likelier, and predicts better, or as well within a standard error with fewer terms.
  static bool is_preferable(const Route& one, const Route& other) {
    const bool likelier = one.worth.sizes.evidence >= other.worth.sizes.evidence + kEvidence;
    const bool as_well = one.terms.size() < other.terms.size() && certainty_of_gain(one.worth, other.worth) > -1.0;
    return likelier && (as_well || one.worth.held_out_rms < other.worth.held_out_rms);
  }

  // Tables can be nearly what every other effect is. Where they came before others that help as well, those are taken
  // first, too, and tables behind them.
  void add_what_helps(bool sized, std::vector<EffectTerm>& terms, std::vector<std::string>& names, Worth& current,
                      TriedModels& tried) const {
    Route route{.terms = std::move(terms), .names = std::move(names), .worth = std::move(current), .left = options()};
    if (std::optional<Route> other = follow(sized, route, tried)) {
      follow(sized, *other, tried);
      if (takes_the_place(sized, *other, route, tried)) {
        route = std::move(*other);
      }
    }
    terms = std::move(route.terms);
    names = std::move(route.names);
    current = std::move(route.worth);
  }

  // Whether the other model, with tables where they help, is the better one.
  bool takes_the_place(bool sized, Route& other, const Route& route, TriedModels& tried) const {
    const std::vector<std::string> with_tables = extended(other.names, to_string(EffectGroup::tables));
    if (std::is_permutation(with_tables.begin(), with_tables.end(), route.names.begin(), route.names.end())) {
      return !(helps(route.worth, other.worth) && route.worth.sizes.evidence >= other.worth.sizes.evidence + kEvidence);
    }
    other.left = {{.name = with_tables.back(), .terms = terms_of(EffectGroup::tables)}};
    if (std::optional<Step> tables = likeliest(sized, other, tried, is_tables)) {
      take(std::move(*tables), other);
    }
    return is_preferable(other, route);
  }

  // What the model has beside an option.
  struct Beside {
    const std::vector<EffectTerm>& terms;
    const std::vector<std::string>& names;
  };

  // Tables that forget themselves sooner, as long as they predict better, or as well and are likelier.
  void shorten(bool sized, const Beside& beside, Option& tables, Worth& best, TriedModels& tried) const {
    for (const double degrees : {10.0, 4.0}) {
      const double length = degrees * std::numbers::pi / 180.0;
      Option shorter{.name = tables.name, .terms = allowed(table_terms(task_.model, means_.joint_values, length))};
      std::erase_if(shorter.terms, [&](const EffectTerm& term) {  // what is flat already is not bent more
        return size_of(best, size_name(term)) < kFlatTable;
      });
      if (shorter.terms.empty()) {
        return;
      }
      Worth with = worth_of(joined(beside.terms, shorter.terms), extended(beside.names, shorter.name), sized, tried);
      if (!is_better_length(with, best)) {
        return;
      }
      tables = std::move(shorter);
      best = std::move(with);
    }
  }

  static std::vector<EffectTerm> joined(std::vector<EffectTerm> terms, const std::vector<EffectTerm>& more) {
    append(terms, more);
    return terms;
  }

  static std::vector<std::string> extended(std::vector<std::string> names, const std::string& name) {
    names.push_back(name);
    return names;
  }

  static double size_of(const Worth& worth, const std::string& name) {
    const auto found = std::find(worth.groups.names.begin(), worth.groups.names.end(), name);
    const auto number = static_cast<std::size_t>(found - worth.groups.names.begin());
    return number < worth.sizes.sizes.size() ? worth.sizes.sizes[number] : 0.0;
  }

  Priors priors_of(const Worth& worth, bool sized) const {
    if (!sized || worth.sizes.sizes.empty()) {
      return task_.options.priors;
    }
    return {.length = std::max(size_of(worth, "length"), kLeastPrior),
            .angle = std::max(size_of(worth, "angle"), kLeastPrior)};
  }

  // Where the measurements tell too little of them.
  void withhold_tables(bool sized, std::vector<EffectTerm>& terms, const Worth& worth) const {
    const Candidate candidate = with_terms(task_.model, task_.free, terms, sized);
    if (worth.sizes.sizes.empty() || std::none_of(terms.begin(), terms.end(), is_of_table)) {
      return;
    }
    const TableCertainty certainty(candidate, worth.information, worth.groups, worth.sizes);
    std::map<int, std::vector<std::pair<double, double>>> gaps;
    for (EffectTerm& term : terms) {
      if (!is_of_table(term)) {
        continue;
      }
      const auto [own, is_new] = gaps.try_emplace(term.index);
      if (is_new) {
        own->second = certainty.gaps(term.index);
      }
      term.table.withheld = own->second;
    }
  }

  // Nothing is known of it anywhere.
  static bool is_withheld_throughout(const EffectTerm& term) {
    return is_of_table(term) && !term.table.withheld.empty() &&
           term.table.withheld.front() == std::pair(term.table.lower, term.table.upper);
  }

  static std::vector<EffectTerm> with_sigmas(std::vector<EffectTerm> terms, const Worth& worth) {
    for (EffectTerm& term : terms) {
      term.sigma = size_of(worth, size_name(term));
    }
    std::erase_if(terms, [](const EffectTerm& term) { return !(term.sigma > 0.0) || is_withheld_throughout(term); });
    return terms;
  }

  const ChoiceTask& task_;
  Measurements means_;
  int threads_;
  Place place_;
  std::vector<std::vector<Index>> folds_;
  double points_ = 0.0;
};

Measurements means_of(const ChoiceTask& task) {
  return averaged(training_sample(task.measurements, kMostConfigurations));
}

}  // namespace

bool choice_is_open(const CalibrationOptions& options) {
  return options.automatic_priors || options.effects.automatic || !options.effects.groups.empty();
}

Choice choose_effects(const ChoiceTask& task) {
  return Chooser(task, means_of(task), task.options.threads, Chooser::Place::outermost).choose().choice;
}

std::vector<double> nested_distances(const ChoiceTask& task, const std::function<void()>& after_fold) {
  const Measurements means = means_of(task);
  const std::vector<std::vector<Index>> folds = make_folds(means, 0);
  std::vector<std::vector<double>> distances(folds.size());
  parallel_for(folds.size(), task.options.threads, [&](std::size_t f) {
    const auto is_left_out = [&](const Observation& o) {
      return std::find(folds[f].begin(), folds[f].end(), o.configuration) != folds[f].end();
    };
    const Measurements rest = subset(means, [&](const Observation& o) { return !is_left_out(o); });
    const Chooser::Outcome chosen = Chooser(task, rest, 1, Chooser::Place::inside).choose();
    const Candidate candidate = with_terms(task.model, task.free, chosen.terms, false);
    const Measurements fold = subset(means, is_left_out);
    const LinearRows left = linear_rows(candidate, fold, task.optimum, task.orientation_length);
    if (chosen.values.size() == left.J.cols()) {
      const VectorXd error = (left.y - left.J * chosen.values) * left.unit;
      std::vector<Index> next(left.first.begin(), left.first.end());  // position rows come first
      for (const Observation& o : fold.observations) {
        Index& row = next[static_cast<std::size_t>(o.configuration)];
        distances[f].push_back(error.segment<3>(row).norm());
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
