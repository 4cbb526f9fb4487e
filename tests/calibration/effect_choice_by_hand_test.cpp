// The choice of effects and priors against the same written out: every model
// that was tried, what was chosen, and why.

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>

#include "calibration/effect_candidates.hpp"
#include "calibration/effect_choice.hpp"
#include "calibration/parameter_choice.hpp"
#include "calibration/ripple_search.hpp"
#include "calibration/table_certainty.hpp"
#include "calibration/tried_models.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::effect_choice_by_hand_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

using Terms = std::vector<EffectTerm>;
using Names = std::vector<std::string>;

template <class List>
List both(List first, const List& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}

/// The odd arm with these effects, measured, and fitted by its geometry alone.
struct Arm : testing::VirtualExperiment {
  Measurements measured;
  CalibrationOptions options;
  Estimate optimum;

  struct Does {
    EffectGroup group;
    double size;
  };
  struct How {
    unsigned seed = 1;
    int configurations = 60;
    std::vector<Does> effects;
    double errors = 5e-4;
    double noise = 5e-5;
    double range = 1.0;  // share of the joints' own
  };

  explicit Arm(const How& how)
      : VirtualExperiment({.model = complete_model(parse_robot(testing::kOddArm)),
                           .sizes = {.length = how.errors, .angle = how.errors},
                           .X_WB = Eigen::Isometry3d(Eigen::Translation3d(2.0, 0.5, 0.3)),
                           .random = Random(how.seed)}) {
    const MatrixXd q = how.range * configurations(how.configurations);
    std::vector<double> values;
    for (const auto& [group, size] : how.effects) {
      const Terms terms = group == EffectGroup::tables ? table_terms(model, q, 4.0 * testing::kDegree)
                          : group == EffectGroup::ripple
                              ? both(ripple_terms(model, q, 3, 60.0), ripple_terms(model, q, 4, 33.0))
                              : effect_terms(model, group, q);
      for (const EffectTerm& term : terms) {
        robot.model.effects.push_back(term);
        values.push_back(size * random.normal());
      }
    }
    robot.truth.effects = Eigen::Map<VectorXd>(values.data(), static_cast<Index>(values.size()));
    measured = testing::without_sigmas(measure(q, {.sigma = how.noise}));
    optimum = identify_jointly(model, measured, nominal_start(model, measured), free).estimate;
    options.threads = 1;
  }

  ChoiceTask task() const {
    return {.model = model, .measurements = measured, .optimum = optimum, .free = free, .options = options};
  }
};

// ---- written out
// ---------------------------------------------------------------------------------------------------

struct Worth {
  bool determined = false;
  GroupSizes sizes;
  Groups groups;
  MatrixXd information;
  double noise = 0.0;
  double motion = 0.0;
  VectorXd squares;
  double rms = kInfinity;

  double size_of(const std::string& name) const {
    for (std::size_t g = 0; g < sizes.sizes.size(); ++g) {
      if (groups.names[g] == name) {
        return sizes.sizes[g];
      }
    }
    return 0.0;
  }
};

/// How often the thresholds of the choice decided alone.
struct Decided {
  std::map<std::string, int> by;
};

class ByHand {
public:
  ByHand(const ChoiceTask& task, const Measurements& means, Decided& decided)
      : task_(task), means_(means), count_(means.joint_values.cols()), decided_(decided) {
    folds_ = make_folds(means_, count_ < 40 ? 0 : 10);
  }

  void choose() {
    Worth current = worth({}, {}, -kInfinity);
    if (task_.options.automatic_priors) {
      sized_ = true;
      Worth with = worth({}, {}, -kInfinity);
      sized_ = with.determined && with.rms <= 0.98 * current.rms;
      current = sized_ ? with : current;
    }
    rigid_priors = priors_of(current);
    task_.options.effects.automatic ? add_what_helps(current) : add_asked(current);
    finish(current);
  }

  Terms all_terms;
  VectorXd values;
  Terms terms;
  Names names;
  Priors priors;
  Priors rigid_priors;
  double noise = 0.0;
  std::vector<ModelOption> tried;
  TriedModels priced;
  bool sized() const { return sized_; }

private:
  Terms of(EffectGroup group) const { return allowed(effect_terms(task_.model, group, means_.joint_values)); }

  Terms allowed(const Terms& all) const {
    Terms result;
    for (const EffectTerm& term : all) {
      if (!fixes_effect(task_.options, term)) {
        result.push_back(term);
      }
    }
    return result;
  }

  Priors priors_of(const Worth& worth) const {
    if (!sized_ || worth.sizes.sizes.empty()) {
      return task_.options.priors;
    }
    return {.length = std::max(worth.size_of("length"), 1e-7), .angle = std::max(worth.size_of("angle"), 1e-7)};
  }

  static std::vector<Index> all_columns(const LinearRows& rows) {
    std::vector<Index> columns(static_cast<std::size_t>(rows.J.cols()));
    std::iota(columns.begin(), columns.end(), Index{0});
    return columns;
  }

  std::vector<LinearSums> of_folds(const LinearRows& rows) const {
    std::vector<LinearSums> result;
    for (const std::vector<Index>& fold : folds_) {
      result.push_back(sums_of(rows, fold));
    }
    return result;
  }

  // Added up, but for one; what is taken away from all of them would leave their rounding.
  static LinearSums without(const std::vector<LinearSums>& folds, std::size_t left_out) {
    const Index size = folds[0].moment.size();
    LinearSums rest{.information = MatrixXd::Zero(size, size), .moment = VectorXd::Zero(size)};
    for (std::size_t f = 0; f < folds.size(); ++f) {
      if (f != left_out) {
        rest.information += folds[f].information;
        rest.moment += folds[f].moment;
        rest.squares += folds[f].squares;
        rest.equations += folds[f].equations;
      }
    }
    return rest;
  }

  Worth worth(const Terms& with, const Names& of, double wanted) {
    const Candidate candidate = with_terms(task_.model, task_.free, with, sized_);
    const LinearRows rows = linear_rows(candidate, means_, task_.optimum, task_.orientation_length);
    Worth result;
    result.groups = groups_of(candidate, task_.options.priors);
    if (static_cast<double>(rows.J.rows()) < 1.1 * static_cast<double>(rows.J.cols())) {
      ++decided_.by["equations"];
      return result;
    }
    const std::vector<Index> columns = all_columns(rows);
    const std::vector<LinearSums> of_each_fold = of_folds(rows);
    const LinearSums all = without(of_each_fold, folds_.size());
    const SizeEstimator whole(all, columns, result.groups.columns);
    if (!whole.is_determined()) {
      return result;
    }
    result.information = all.information;
    result.sizes = whole.estimate({}, result.groups.limits, 1e-9 / rows.unit);
    result.noise = result.sizes.sigma * rows.unit;
    result.motion = motion_of(candidate, result.sizes.values);
    if (result.sizes.evidence >= wanted) {
      predict(candidate, rows, of_each_fold, result);
    } else {
      ++decided_.by["evidence"];
    }
    tried.push_back({.priors = priors_of(result),
                     .effects = of,
                     .sized = sized_,
                     .held_out_rms = result.rms,
                     .evidence = result.sizes.evidence});
    priced.add(tried.back(), result.squares);
    return result;
  }

  double motion_of(const Candidate& candidate, const VectorXd& of_terms) const {
    double most = 0.0;
    const MatrixXd basis = effect_basis(candidate.model, means_.joint_values);
    for (Index c = 0; c < count_; ++c) {
      std::map<std::pair<int, EffectAxis>, double> motions;
      for (std::size_t e = 0; e < candidate.model.effects.size(); ++e) {
        const EffectTerm& term = candidate.model.effects[e];
        motions[{term.index, term.axis}] +=
            of_terms[*candidate.free.column(UnknownGroup::effects, e)] * basis(static_cast<Index>(e), c);
      }
      for (const auto& [joint, motion] : motions) {
        most = std::max(most, std::abs(motion));
      }
    }
    return most;
  }

  void predict(const Candidate& candidate, const LinearRows& rows, const std::vector<LinearSums>& of_each_fold,
               Worth& worth) {
    worth.squares = VectorXd::Zero(count_);
    for (std::size_t f = 0; f < folds_.size(); ++f) {
      const LinearSums rest = without(of_each_fold, f);
      const SizeEstimator estimator(rest, all_columns(rows), worth.groups.columns);
      if (!estimator.is_determined()) {
        return;
      }
      const GroupSizes sizes = estimator.estimate(worth.sizes.sizes, worth.groups.limits, 1e-9 / rows.unit);
      const TableCertainty certainty(candidate, rest.information, worth.groups, sizes);
      for (const Index c : folds_[f]) {
        VectorXd x = sizes.values;
        certainty.withhold(means_.joint_values.col(c), x);
        const auto at = static_cast<std::size_t>(c);
        for (Index row = rows.first[at]; row < rows.first[at + 1]; ++row) {
          worth.squares[c] += std::pow((rows.y[row] - rows.J.row(row).dot(x)) * rows.unit, 2);
        }
      }
    }
    worth.determined = true;
    worth.rms = std::sqrt(worth.squares.sum() / static_cast<double>(means_.observations.size()));
  }

  // Mean gain in held-out squares, in standard errors of it.
  double errors_gained(const Worth& with, const Worth& before) const {
    const VectorXd gain = before.squares - with.squares;
    double variance = 0.0;
    for (const double one : gain) {
      variance += std::pow(one - gain.mean(), 2) / static_cast<double>(count_ - 1);
    }
    return gain.mean() / std::sqrt(variance / static_cast<double>(count_));
  }

  bool helps(const Worth& with, const Worth& before) {
    if (!with.determined) {
      return false;
    }
    const bool moves_little = with.motion <= 0.02;
    const bool worthwhile = with.rms <= 0.98 * before.rms;
    const bool certain = errors_gained(with, before) > 1.0;
    if (!moves_little || !worthwhile || !certain) {
      ++decided_
            .by[std::string(moves_little ? "" : "motion ") + (worthwhile ? "" : "worth ") + (certain ? "" : "error")];
    }
    return moves_little && worthwhile && certain;
  }

  Terms ripple(const Worth& current) {
    if (!current.determined) {
      return {};
    }
    const Candidate candidate = with_terms(task_.model, task_.free, all_terms, sized_);
    const LinearRows rows = linear_rows(candidate, means_, task_.optimum, task_.orientation_length);
    const LinearRows joints = joint_rows(task_.model, means_, task_.optimum, task_.orientation_length);
    const SizedInformation known = sized_information(current.information, current.groups, current.sizes);
    return allowed(find_ripple({.model = task_.model,
                                .joint_values = means_.joint_values,
                                .rows = rows,
                                .joints = joints,
                                .information = known.matrix,
                                .columns = known.columns,
                                .values = current.sizes.values},
                               1));
  }

  struct Model {
    Terms terms;
    Names names;
    Worth worth;
    std::map<std::string, Terms> left;
    bool has(const std::string& name) const { return std::find(names.begin(), names.end(), name) != names.end(); }
    void add(const std::string& name, const Worth& with) {
      terms = both(terms, left[name]);
      names.push_back(name);
      left.erase(name);
      worth = with;
    }
  };

  // Of what is left, what helps; tables that are likelier than all others.
  std::map<std::string, Worth> all_that_helps(Model& model) {
    std::map<std::string, Worth> helpful;
    double least = model.worth.sizes.evidence + 7.0;
    const auto look_at = [&](const std::string& name) {
      Terms& group = model.left.at(name);
      all_terms = model.terms;
      names = model.names;
      Worth with = worth(both(all_terms, group), both(names, {name}), least);
      if (name == "tables" && with.determined) {
        shorten(group, with);
      }
      if (helps(with, model.worth)) {
        helpful[name] = with;
      }
    };
    for (const auto& [name, group] : model.left) {
      if (name != "tables") {
        look_at(name);
      }
    }
    for (const auto& [name, with] : helpful) {
      least = std::max(least, with.sizes.evidence);
    }
    if (model.left.count("tables") > 0) {
      look_at("tables");
    }
    return helpful;
  }

  static std::string likeliest(const std::map<std::string, Worth>& helpful) {
    std::string best;
    for (const auto& [name, with] : helpful) {
      if (best.empty() || with.sizes.evidence > helpful.at(best).sizes.evidence) {
        best = name;
      }
    }
    return best;
  }

  // Beside all others, where it was not the last.
  bool finds_ripple_anew(Model& model) {
    if (!model.has("ripple") || model.names.back() == "ripple") {
      return false;
    }
    Model anew{.terms = {}, .names = {}, .worth = {}, .left = model.left};
    for (const EffectTerm& term : model.terms) {
      if (term.group != EffectGroup::ripple) {
        anew.terms.push_back(term);
      }
    }
    for (const std::string& name : model.names) {
      if (name != "ripple") {
        anew.names.push_back(name);
      }
    }
    all_terms = anew.terms;
    const Terms swings = ripple(worth(anew.terms, anew.names, -kInfinity));
    if (swings.empty()) {
      ++decided_.by["no ripple anew"];
      return false;
    }
    anew.terms = both(anew.terms, swings);
    anew.names.emplace_back("ripple");
    anew.worth = worth(anew.terms, anew.names, model.worth.sizes.evidence + 2.0);
    const bool better = anew.worth.rms < model.worth.rms && anew.worth.motion <= 0.02;
    ++decided_.by[better ? "ripple anew" : "ripple stays"];
    model = better ? anew : model;
    return better;
  }

  // Whether tables were taken where others would have helped as well; `others` goes on without them from there.
  bool add_one_after_the_other(Model& model, Model& others) {
    bool passed = false;
    while (model.worth.determined) {
      model.left.erase("ripple");
      all_terms = model.terms;
      if (count_ >= 100 && !model.has("ripple")) {
        if (const Terms swings = ripple(model.worth); !swings.empty()) {
          model.left["ripple"] = swings;
        }
      }
      std::map<std::string, Worth> helpful = all_that_helps(model);
      const std::string best = helpful.count("tables") > 0 ? "tables" : likeliest(helpful);
      if (best.empty()) {
        if (!finds_ripple_anew(model)) {
          return passed;
        }
        continue;
      }
      if (best == "tables" && helpful.size() > 1) {
        passed = true;
        others = model;
        others.left.erase("tables");
        std::map<std::string, Worth> rest = helpful;
        rest.erase("tables");
        others.add(likeliest(rest), rest[likeliest(rest)]);
      }
      model.add(best, helpful[best]);
    }
    return passed;
  }

  // Adds tables where they help and that is not the other model.
  bool takes_the_place_of(Model& others, const Model& model) {
    const Names all = both(others.names, {"tables"});
    if (std::set(all.begin(), all.end()) == std::set(model.names.begin(), model.names.end())) {
      const bool tables_help = helps(model.worth, others.worth);
      const bool go = !tables_help || model.worth.sizes.evidence < others.worth.sizes.evidence + 7.0;
      ++decided_.by[go ? "tables go" : "tables stay"];
      return go;
    }
    others.left = {{"tables", of(EffectGroup::tables)}};
    if (const auto helpful = all_that_helps(others); !helpful.empty()) {
      others.add("tables", helpful.at("tables"));
    }
    const bool likelier = others.worth.sizes.evidence >= model.worth.sizes.evidence + 2.0;
    const bool better = others.worth.rms < model.worth.rms;
    const bool as_well = others.terms.size() < model.terms.size() && errors_gained(others.worth, model.worth) > -1.0;
    ++decided_.by[std::string(likelier ? "likelier" : "less likely") + (better    ? ", better"
                                                                        : as_well ? ", as well"
                                                                                  : ", worse")];
    return likelier && (better || as_well);
  }

  void add_what_helps(Worth& current) {
    Model model{.terms = {}, .names = {}, .worth = current, .left = {}};
    for (const auto& [group, least] : {std::pair{EffectGroup::gravity, 12}, std::pair{EffectGroup::transverse, 60},
                                       std::pair{EffectGroup::gain, 20}, std::pair{EffectGroup::backlash, 20},
                                       std::pair{EffectGroup::harmonics, 20}, std::pair{EffectGroup::tables, 50}}) {
      if (count_ >= least) {
        model.left[to_string(group)] = of(group);
      }
    }
    Model others;
    Model none;
    if (add_one_after_the_other(model, others)) {
      add_one_after_the_other(others, none);
      model = takes_the_place_of(others, model) ? others : model;
    }
    all_terms = model.terms;
    names = model.names;
    current = model.worth;
  }

  void shorten(Terms& tables, Worth& best) {
    for (const double degrees : {10.0, 4.0}) {
      Terms shorter;
      for (const EffectTerm& term :
           allowed(table_terms(task_.model, means_.joint_values, degrees * testing::kDegree))) {
        if (best.size_of(size_name(term)) >= 5e-6) {
          shorter.push_back(term);
        } else {
          ++decided_.by["flat"];
        }
      }
      if (shorter.empty()) {
        return;
      }
      const Worth with = worth(both(all_terms, shorter), both(names, {"tables"}), -kInfinity);
      decided_.by["too few equations"] += with.squares.size() == 0 ? 1 : 0;
      const bool predicts_better = with.rms < best.rms;
      const bool as_good_and_likelier =
          with.determined && with.sizes.evidence >= best.sizes.evidence + 2.0 && errors_gained(with, best) > -1.0;
      if (!predicts_better && !as_good_and_likelier) {
        ++decided_.by["longer"];
        return;
      }
      ++decided_.by[predicts_better ? "shorter" : "likelier"];
      tables = shorter;
      best = with;
    }
  }

  void add_asked(Worth& current) {
    const std::vector<EffectGroup>& groups = task_.options.effects.groups;
    const std::set<EffectGroup> asked(groups.begin(), groups.end());
    for (const EffectGroup group : groups) {
      if (group != EffectGroup::ripple && group != EffectGroup::tables) {
        all_terms = both(all_terms, of(group));
        names.emplace_back(to_string(group));
      }
    }
    if (asked.count(EffectGroup::tables) > 0) {
      Terms tables = of(EffectGroup::tables);
      current = worth(both(all_terms, tables), both(names, {"tables"}), -kInfinity);
      if (count_ >= 50) {
        shorten(tables, current);
      }
      all_terms = both(all_terms, tables);
      names.emplace_back("tables");
    } else if (!all_terms.empty()) {
      current = worth(all_terms, names, -kInfinity);
    }
    if (asked.count(EffectGroup::ripple) > 0) {
      const Terms swings = ripple(current);
      if (!swings.empty()) {
        all_terms = both(all_terms, swings);
        names.emplace_back("ripple");
        current = worth(all_terms, names, -kInfinity);
      }
    }
  }

  void finish(const Worth& current) {
    priors = priors_of(current);
    noise = current.noise;
    values = current.sizes.values;
    const Candidate candidate = with_terms(task_.model, task_.free, all_terms, sized_);
    const TableCertainty certainty(candidate, current.information, current.groups, current.sizes);
    for (EffectTerm& term : all_terms) {
      bool somewhere = true;
      if (term.group == EffectGroup::tables) {
        term.table.withheld = certainty.gaps(term.index);
        somewhere = term.table.withheld.empty() || term.table.withheld[0].first > term.table.lower ||
                    term.table.withheld[0].second < term.table.upper;
      }
      const double sigma = current.size_of(size_name(term));
      if (sigma > 0.0 && somewhere) {
        terms.push_back(term);
        terms.back().sigma = sigma;
      } else {
        ++decided_.by[sigma > 0.0 ? "withheld" : "switched off"];
      }
    }
    priced.put_first(names, sized_);
  }

  const ChoiceTask& task_;
  const Measurements& means_;
  Index count_;
  Decided& decided_;
  bool sized_ = false;
  std::vector<std::vector<Index>> folds_;
};

void expect_near(double got, double wanted, const std::string& what) {
  if (std::isfinite(wanted)) {
    EXPECT_NEAR(got, wanted, 1e-6 * std::abs(wanted) + 1e-15) << what;
  } else {
    EXPECT_EQ(got, wanted) << what;
  }
}

std::string name_of(const ModelOption& option) {
  return ::testing::PrintToString(option.effects) + (option.sized ? " sized" : "");
}

/// What was tried, by its name and its evidence.
std::vector<ModelOption> in_order(std::vector<ModelOption> tried) {
  std::sort(tried.begin(), tried.end(), [](const ModelOption& a, const ModelOption& b) {
    return std::pair(name_of(a), a.evidence) < std::pair(name_of(b), b.evidence);
  });
  return tried;
}

void expect_tried(const std::vector<ModelOption>& tried, const ByHand& by_hand, const std::string& what) {
  ASSERT_EQ(tried.size(), by_hand.tried.size()) << what;
  ASSERT_FALSE(tried.empty()) << what;
  EXPECT_EQ(tried.front().effects, by_hand.names) << what;
  EXPECT_EQ(tried.front().sized, by_hand.sized()) << what;
  EXPECT_TRUE(std::is_sorted(tried.begin() + 1, tried.end(), [](const ModelOption& a, const ModelOption& b) {
    return a.held_out_rms < b.held_out_rms;
  })) << what;
  const std::vector<ModelOption> got = in_order(tried);
  const std::vector<ModelOption> wanted = in_order(by_hand.tried);
  for (std::size_t i = 0; i < got.size(); ++i) {
    const std::string which = what + ", " + name_of(wanted[i]);
    EXPECT_EQ(name_of(got[i]), name_of(wanted[i])) << what;
    expect_near(got[i].held_out_rms, wanted[i].held_out_rms, which + ", held out");
    expect_near(got[i].evidence, wanted[i].evidence, which + ", evidence");
    expect_near(got[i].priors.length, wanted[i].priors.length, which + ", lengths");
    expect_near(got[i].priors.angle, wanted[i].priors.angle, which + ", angles");
  }
}

void expect_terms(const Terms& got, const Terms& wanted, const std::string& what) {
  ASSERT_EQ(got.size(), wanted.size()) << what;
  for (std::size_t e = 0; e < got.size(); ++e) {
    EXPECT_EQ(got[e].name, wanted[e].name) << what;
    expect_near(got[e].sigma, wanted[e].sigma, what + ", " + wanted[e].name);
    EXPECT_EQ(got[e].table.length, wanted[e].table.length) << what;
    ASSERT_EQ(got[e].table.withheld.size(), wanted[e].table.withheld.size()) << what << got[e].name;
    for (std::size_t g = 0; g < got[e].table.withheld.size(); ++g) {
      expect_near(got[e].table.withheld[g].first, wanted[e].table.withheld[g].first, what);
      expect_near(got[e].table.withheld[g].second, wanted[e].table.withheld[g].second, what);
    }
  }
}

/// What was chosen, which is as by hand.
Choice expect_as_by_hand(const Arm& arm, Decided& decided, const std::string& what) {
  const ChoiceTask task = arm.task();
  Choice choice = choose_effects(task);
  const Measurements means = averaged(training_sample(arm.measured, 2000));
  ByHand by_hand(task, means, decided);
  by_hand.choose();
  expect_tried(choice.tried, by_hand, what);
  expect_terms(choice.terms, by_hand.terms, what);
  expect_near(choice.noise, by_hand.noise, what + ", noise");
  for (const auto& [got, wanted] :
       {std::pair{choice.priors, by_hand.priors}, std::pair{choice.rigid_priors, by_hand.rigid_priors}}) {
    expect_near(got.length, wanted.length, what);
    expect_near(got.angle, wanted.angle, what);
  }
  expect_near(choice.price, arm.options.effects.groups.empty() ? by_hand.priced.price_of_choosing() : 1.0, what);
  return choice;
}

TEST(EffectChoiceByHand, EffectsOfEverySizeAreChosenAsWritten) {
  Decided decided;
  bool least_prior = false;
  for (unsigned step = 0; step < 12; ++step) {
    const double size = 1e-5 * std::pow(2.2, step);
    const EffectGroup group = std::array{EffectGroup::gravity, EffectGroup::gain, EffectGroup::harmonics}[step % 3];
    Arm arm({.seed = step + 1,
             .configurations = 20 + static_cast<int>(step),
             .effects = {{group, size}},
             .errors = step % 4 == 0 ? 0.0 : 5e-4});
    arm.options.automatic_priors = step % 2 == 0;
    arm.options.effects.automatic = true;
    arm.options.priors = {.length = 3e-3, .angle = step % 5 == 0 ? 0.0 : 3e-3};
    const Choice choice =
        expect_as_by_hand(arm, decided, std::string(to_string(group)) + " of " + std::to_string(size));
    least_prior = least_prior || choice.priors.length == 1e-7 || choice.priors.angle == 1e-7;
  }
  // Arms of which some effect helps for sure, but too little.
  for (const auto& [seed, size, group] :
       {std::tuple{2U, 1.4e-5, EffectGroup::harmonics}, std::tuple{16U, 1.2e-5, EffectGroup::gain},
        std::tuple{81U, 2.2e-5, EffectGroup::gravity}}) {
    Arm arm({.seed = seed, .configurations = 60 + static_cast<int>(seed % 10), .effects = {{group, size}}});
    arm.options.effects.automatic = true;
    arm.options.fix = {"tables.*", "transverse.*"};
    expect_as_by_hand(arm, decided, "seed " + std::to_string(seed));
  }
  EXPECT_TRUE(least_prior);
  for (const char* alone : {"evidence", "motion ", "worth ", "error"}) {
    EXPECT_GT(decided.by[alone], 0) << alone << " never decided alone";
  }
}

TEST(EffectChoiceByHand, TablesAreAsShortAsPredictsBestOrAsWellAndIsLikelier) {
  Decided decided;
  for (const auto& [size, automatic, configurations, range] :
       {std::tuple{3e-4, true, 60, 0.15}, std::tuple{2e-3, false, 50, 0.15}, std::tuple{3e-4, false, 49, 0.15},
        std::tuple{2e-5, false, 60, 0.15}, std::tuple{3e-4, false, 60, 0.6}}) {
    Arm arm({.seed = 5,
             .configurations = configurations,
             .effects = {{EffectGroup::tables, size}},
             .noise = 2e-5,
             .range = range});
    arm.options.effects = {.groups = automatic ? std::vector<EffectGroup>() : std::vector{EffectGroup::tables},
                           .automatic = automatic};
    arm.options.fix = {"tables.1.*", "tables.2.*", "transverse.*"};
    const Choice choice = expect_as_by_hand(arm, decided, "tables of " + std::to_string(size));
    for (const EffectTerm& term : choice.terms) {
      EXPECT_TRUE(term.group != EffectGroup::tables || term.index > 1) << term.name;
    }
  }
  for (const char* what : {"flat", "longer", "shorter", "likelier"}) {
    EXPECT_GT(decided.by[what], 0) << what;
  }
}

/// With four effects at once, which tables can nearly be; of 1 mrad or, where the seed is even, 0.3 mrad.
Arm of_four_effects(unsigned seed) {
  const double size = seed % 2 == 1 ? 1e-3 : 3e-4;
  Arm arm({.seed = seed,
           .configurations = 60,
           .effects = {{EffectGroup::gravity, size},
                       {EffectGroup::gain, size},
                       {EffectGroup::backlash, size},
                       {EffectGroup::harmonics, size}},
           .noise = seed % 4 < 2 ? 2e-5 : 2e-4,
           .range = seed % 3 == 0 ? 1.0 : 0.4});
  arm.options.effects.automatic = true;
  arm.options.fix = {"tables.1.*", "transverse.*"};
  return arm;
}

void expect_decided(Decided& decided, const std::vector<std::string>& by) {
  for (const std::string& what : by) {
    EXPECT_GT(decided.by[what], 0) << what;
  }
}

// Where tables come first, what else helps is tried without them, and tables behind it.
TEST(EffectChoiceByHand, TablesGiveWayToWhatIsLikelierWithoutThem) {
  Decided decided;
  for (const unsigned seed : {1U, 2U, 35U, 40U}) {
    expect_as_by_hand(of_four_effects(seed), decided, "seed " + std::to_string(seed));
  }
  expect_decided(decided, {"likelier, better", "likelier, as well", "less likely, better", "tables go"});
  // They stand for what is held.
  Arm arm({.seed = 3,
           .configurations = 50,
           .effects = {{EffectGroup::gravity, 3e-4},
                       {EffectGroup::gain, 3e-4},
                       {EffectGroup::backlash, 3e-4},
                       {EffectGroup::harmonics, 3e-4}},
           .noise = 5e-5,
           .range = 0.4});
  arm.options.effects.automatic = true;
  arm.options.fix = {"tables.1.*", "tables.2.*", "tables.3.*", "harmonics.*", "transverse.*"};
  expect_as_by_hand(arm, decided, "effects that are held");
  expect_decided(decided, {"tables stay"});
}

// Swings are the largest part and are found first: beside gravity and harmonics others are.
TEST(EffectChoiceByHand, RippleIsLookedForAgainBesideWhatCameAfterIt) {
  Decided decided;
  for (const unsigned seed : {2U, 4U}) {
    Arm arm({.seed = seed,
             .configurations = 100,
             .effects = {{EffectGroup::ripple, 2e-3}, {EffectGroup::gravity, 4e-4}, {EffectGroup::harmonics, 4e-4}},
             .range = 0.5});
    arm.options.effects.automatic = true;
    arm.options.fix = {"tables.*", "transverse.*"};
    const Choice choice = expect_as_by_hand(arm, decided, "seed " + std::to_string(seed));
    EXPECT_THAT(choice.tried.front().effects, ::testing::UnorderedElementsAre("ripple", "gravity", "harmonics"));
  }
  expect_decided(decided, {"ripple anew", "ripple stays"});
}

TEST(EffectChoiceByHandLongRun, FourEffectsAreFoundBesideTables) {
  Decided decided;
  const std::set<std::string> truth = {"gravity", "gain", "backlash", "harmonics"};
  int found = 0;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    const Names names =
        expect_as_by_hand(of_four_effects(seed), decided, "seed " + std::to_string(seed)).tried.front().effects;
    found += std::set(names.begin(), names.end()) == truth ? 1 : 0;
  }
  EXPECT_GE(found, 34);
  expect_decided(decided, {"likelier, better", "likelier, as well", "likelier, worse", "less likely, better",
                           "less likely, as well", "tables go"});
}

// Of what the equations do not suffice for nothing is known; where sigmas are stated its evidence, zero, would be
// large.
TEST(EffectChoiceByHand, TablesAreNoShorterThanTheEquationsSufficeFor) {
  Decided decided;
  for (const double sigma : {0.0, 2e-5}) {
    Arm arm({.seed = 1, .configurations = 50, .effects = {{EffectGroup::tables, 2e-3}}, .noise = 2e-5, .range = 0.2});
    arm.measured = subset(arm.measured, [](const Observation& o) { return o.target == 0 || o.configuration < 4; });
    for (Observation& o : arm.measured.observations) {
      o.sigma = sigma;
    }
    arm.options.effects.groups = {EffectGroup::tables};
    const Choice choice = expect_as_by_hand(arm, decided, "sigma " + std::to_string(sigma));
    EXPECT_EQ(choice.tried.front().evidence < 0.0, (sigma > 0.0));
  }
  EXPECT_EQ(decided.by["too few equations"], 2);
}

TEST(EffectChoiceByHand, SaysWhatIsTried) {
  Arm arm({.seed = 5, .configurations = 50, .effects = {{EffectGroup::tables, 1e-3}}, .range = 0.15});
  arm.options.effects.groups = {EffectGroup::gain, EffectGroup::tables};
  arm.options.automatic_priors = true;
  arm.options.fix = {"tables.1.*", "tables.2.*", "tables.4.*"};
  std::vector<std::string> said;
  arm.options.progress = [&](const std::string& what, std::size_t done, std::size_t of) {
    EXPECT_EQ(of, 10U);
    if (done == of) {
      said.push_back(what);
    }
  };
  const Choice choice = choose_effects(arm.task());
  const std::string with = choice.tried.front().sized ? " with priors" : "";
  double longest = 0.0;  // half of what a joint moves
  for (const EffectTerm& term : effect_terms(arm.model, EffectGroup::tables, arm.measured.joint_values)) {
    longest = std::max(longest, term.index == 2 || term.index == 4 ? term.table.length : 0.0);
  }
  const std::string degrees = std::to_string(std::lround(longest / testing::kDegree));
  ASSERT_GE(said.size(), 4U);
  EXPECT_EQ(said[0], "trying geometry alone");
  EXPECT_EQ(said[1], "trying geometry alone with priors");
  EXPECT_EQ(said[2], "trying gain, tables of " + degrees + " degrees" + with);
  EXPECT_EQ(said[3], "trying gain, tables of 10 degrees" + with);
}

TEST(EffectChoiceByHand, RippleIsLookedForFrom100ConfigurationsOn) {
  Decided decided;
  for (const int configurations : {99, 100}) {
    Arm arm({.seed = 2, .configurations = configurations, .effects = {{EffectGroup::ripple, 4e-4}}, .range = 0.5});
    arm.options.effects.automatic = true;
    arm.options.fix = {"tables.*", "transverse.*", "gravity.*"};
    const Choice choice = expect_as_by_hand(arm, decided, std::to_string(configurations));
    EXPECT_EQ(choice.tried.front().effects, configurations < 100 ? Names() : Names{"ripple"});
  }
}

TEST(EffectChoiceByHand, WhatIsAskedForIsTaken) {
  Decided decided;
  Arm arm({.seed = 3, .configurations = 40, .effects = {{EffectGroup::ripple, 4e-4}, {EffectGroup::gain, 2e-4}}});
  for (const auto& groups : std::vector<std::vector<EffectGroup>>{
           {EffectGroup::gain}, {EffectGroup::ripple}, {EffectGroup::ripple, EffectGroup::gain}, {}}) {
    arm.options.effects.groups = groups;
    arm.options.automatic_priors = groups.size() != 1;
    expect_as_by_hand(arm, decided, "asked for " + std::to_string(groups.size()));
  }
  arm.options.fix = {"gain.2", "ripple.4.*"};
  arm.options.effects.groups = {EffectGroup::gain, EffectGroup::ripple};
  expect_as_by_hand(arm, decided, "some held");
}

TEST(EffectChoiceByHand, WhatAnArmDoesNotDoIsSwitchedOff) {
  Decided decided;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    Arm arm({.seed = seed, .configurations = 20});
    arm.options.effects.groups = {EffectGroup::gain, EffectGroup::harmonics};
    expect_as_by_hand(arm, decided, "seed " + std::to_string(seed));
  }
  EXPECT_GT(decided.by["switched off"], 0);
}

/// Names of all effects that were tried.
std::set<std::string> tried_of(int configurations) {
  Arm arm({.configurations = configurations});
  arm.options.effects.automatic = true;
  arm.options.fix = {"transverse.*", "tables.*"};  // tried all the same
  std::set<std::string> result;
  for (const ModelOption& option : choose_effects(arm.task()).tried) {
    result.insert(option.effects.begin(), option.effects.end());
  }
  return result;
}

TEST(EffectChoiceByHand, GroupsAreTriedFromSoManyConfigurationsOn) {
  std::set<std::string> wanted;
  EXPECT_EQ(tried_of(11), wanted);
  EXPECT_EQ(tried_of(12), wanted = {"gravity"});
  EXPECT_EQ(tried_of(19), wanted);
  wanted.insert({"gain", "backlash", "harmonics"});
  EXPECT_EQ(tried_of(20), wanted);
  EXPECT_EQ(tried_of(49), wanted);
  wanted.insert("tables");
  EXPECT_EQ(tried_of(50), wanted);
  EXPECT_EQ(tried_of(59), wanted);
  wanted.insert("transverse");
  EXPECT_EQ(tried_of(60), wanted);
}

// Of four configurations three do not determine the geometry without priors;
// three are too few for anything.
TEST(EffectChoiceByHand, WhatAFoldDoesNotDetermineIsNotComparedAndChoosesNothing) {
  Decided decided;
  Arm arm({.seed = 11, .configurations = 5});
  for (const bool priors : {false, true}) {
    arm.options.effects.automatic = true;
    arm.options.automatic_priors = priors;
    const Choice choice = expect_as_by_hand(arm, decided, priors ? "with priors" : "without");
    ASSERT_FALSE(choice.tried.empty());
    EXPECT_EQ(std::isfinite(choice.tried.front().held_out_rms), priors);
  }
  arm.options.automatic_priors = false;
  arm.options.effects = {.groups = {EffectGroup::ripple}};
  arm.measured = subset(arm.measured, [](const Observation& o) { return o.configuration < 3; });
  const Choice choice = choose_effects(arm.task());
  EXPECT_TRUE(choice.terms.empty());
  EXPECT_TRUE(choice.tried.empty());
}

TEST(EffectChoiceByHand, RepeatsAreOneAndTestRowsNone) {
  Decided decided;
  Arm arm({.seed = 6, .configurations = 24, .effects = {{EffectGroup::gravity, 3e-4}}});
  const Measurements before = arm.measured;
  arm.options.effects.automatic = true;
  Measurements again = before;
  for (Observation& o : again.observations) {
    o.repeat = 2;
    o.position.x() += 1e-4;
    o.split = o.configuration > 20 ? Split::test : Split::train;
  }
  arm.measured.observations.insert(arm.measured.observations.end(), again.observations.begin(),
                                   again.observations.end());
  expect_as_by_hand(arm, decided, "repeats");
}

TEST(EffectChoiceByHand, ExactDataHasTheNoiseOfItsRounding) {
  Arm arm({.seed = 7, .configurations = 30, .noise = 0.0});
  arm.options.effects.groups = {EffectGroup::gain};
  arm.optimum = arm.robot.truth;
  EXPECT_NEAR(choose_effects(arm.task()).noise, 1e-9, 1e-12);
}

TEST(EffectChoiceByHand, AtMostTwoThousandConfigurationsTakePart) {
  Decided decided;
  Arm arm({.seed = 8, .configurations = 2100});
  arm.options.effects.groups = {EffectGroup::gain};
  expect_as_by_hand(arm, decided, "many");
}

// 1.1 equations for every column.
TEST(EffectChoiceByHand, TooFewEquationsAreRefused) {
  Arm arm({.seed = 9, .configurations = 30});
  arm.options.effects.groups = {EffectGroup::gravity};
  const std::vector<Observation> all = arm.measured.observations;
  std::vector<bool> refused;
  for (std::size_t rows = 13; rows < 19; ++rows) {
    arm.measured.observations.assign(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(rows));
    const Measurements means = averaged(training_sample(arm.measured, 2000));
    const std::size_t terms = effect_terms(arm.model, EffectGroup::gravity, means.joint_values).size();
    const std::size_t columns = static_cast<std::size_t>(arm.free.size()) + terms;
    refused.push_back(30 * rows < 11 * columns);
    const std::string too_few = "simulation: too few measurements for the effects asked for, " + std::to_string(terms) +
                                " terms beside " + std::to_string(arm.free.size()) + " parameters";
    EXPECT_EQ(testing::refusal([&] { choose_effects(arm.task()); }), refused.back() ? too_few : "nothing was refused")
        << rows;
  }
  EXPECT_TRUE(refused.front());
  EXPECT_FALSE(refused.back());
}

TEST(EffectChoiceByHand, NestedDistancesAreOfTheChoiceWithoutTheConfiguration) {
  Decided decided;
  Arm arm({.seed = 10, .configurations = 14, .effects = {{EffectGroup::gravity, 5e-4}}});
  arm.options.effects.automatic = true;
  arm.options.automatic_priors = true;
  const ChoiceTask task = arm.task();
  int fits = 0;
  int told = 0;  // of what is tried inside
  arm.options.progress = [&](const std::string&, std::size_t, std::size_t) { ++told; };
  const std::vector<double> distances = nested_distances(task, [&] { ++fits; });
  EXPECT_EQ(fits, 14);
  EXPECT_EQ(told, 0);
  std::vector<double> expected;
  for (const std::vector<Index>& fold : make_folds(arm.measured, 0)) {
    const auto left_out = [&](const Observation& o) { return o.configuration == fold[0]; };
    const Measurements rest = subset(arm.measured, [&](const Observation& o) { return !left_out(o); });
    ByHand by_hand(task, rest, decided);
    by_hand.choose();
    const Candidate candidate = with_terms(arm.model, arm.free, by_hand.all_terms, false);
    const LinearRows rows = linear_rows(candidate, subset(arm.measured, left_out), arm.optimum, 0.3);
    const VectorXd error = (rows.y - rows.J * by_hand.values) * rows.unit;
    ASSERT_EQ(error.size(), 9);
    for (Index k = 0; k < 9; k += 3) {
      expected.push_back(error.segment(k, 3).norm());
    }
  }
  ASSERT_EQ(distances.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(distances[i], expected[i], 1e-6 * expected[i]) << i;
  }
}

}  // namespace
}  // namespace kdl_calibration::effect_choice_by_hand_test
