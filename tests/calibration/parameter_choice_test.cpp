#include "calibration/parameter_choice.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <set>

#include "base/name_pattern.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/simulation.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::parameter_choice_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::refusal;

std::vector<TargetFrame> a_point_and_a_frame() {
  std::vector<TargetFrame> targets = published_targets(2);
  targets[1].with_orientation = true;
  return targets;
}

std::vector<std::string> names_of(const ErrorModel& model, const std::vector<TargetFrame>& targets) {
  std::vector<std::string> names = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"};
  for (const TargetFrame& target : targets) {
    for (const char* coordinate : {"x", "y", "z", "Rx", "Ry", "Rz"}) {
      if (target.with_orientation || coordinate[0] != 'R') {
        names.push_back(target.name + "." + coordinate);
      }
    }
  }
  for (const ErrorParameter& parameter : model.parameters) {
    names.push_back(parameter.name);
  }
  return names;
}

bool matches_any(const std::vector<std::string>& patterns, const std::string& name) {
  return std::any_of(patterns.begin(), patterns.end(),
                     [&](const std::string& pattern) { return matches_pattern(pattern, name); });
}

// `held`: coordinates of known frames that nobody frees, or that are fixed.
void expect_choice(const ErrorModel& model, const CalibrationOptions& options, const std::vector<std::string>& held) {
  const std::vector<TargetFrame> targets = a_point_and_a_frame();
  constexpr int kConfigurations = 15;
  const ParameterChoice found = choose_parameters(model, targets, options, {.configurations = kConfigurations});
  const Reduction reduction = reduced_model(model, targets, {.fixed = held, .configurations = kConfigurations});
  EXPECT_EQ(found.reduction.kept, reduction.kept);
  EXPECT_EQ(found.reduction.rank, reduction.rank);
  std::vector<std::string> free;
  std::vector<std::string> complete;
  for (const std::string& name : names_of(model, targets)) {
    const bool kept = std::find(reduction.kept.begin(), reduction.kept.end(), name) != reduction.kept.end();
    const bool gauge = std::any_of(reduction.gauge.begin(), reduction.gauge.end(),
                                   [&](const GaugeParameter& parameter) { return parameter.name == name; });
    const bool is_held = matches_any(options.fix, name) || std::find(held.begin(), held.end(), name) != held.end();
    const bool wanted = options.model == ModelChoice::complete || kept || matches_any(options.free, name);
    if (!is_held && wanted) {
      free.push_back(name);
    }
    if (!is_held && (wanted || (name.find('.') == std::string::npos && !gauge))) {
      complete.push_back(name);
    }
  }
  EXPECT_EQ(found.free, free);
  EXPECT_EQ(found.complete, complete);
}

TEST(ParameterChoice, IsWhatIsKeptAndFreedLessWhatIsFixedAndKnown) {
  const ErrorModel model = complete_model(testing::fanuc());
  expect_choice(model, {}, {});
  expect_choice(model, {.model = ModelChoice::complete}, {});
  expect_choice(model, {.fix = {"*4", "Rz?", "dq2"}}, {});
  expect_choice(model, {.free = {"dq1", "T?6"}}, {});
  expect_choice(model, {.model = ModelChoice::complete, .fix = {"Tx*"}, .free = {"dq1"}}, {});
  const std::vector<std::string> base = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"};
  CalibrationOptions known{.known_base = Eigen::Isometry3d::Identity()};
  expect_choice(model, known, base);
  known.free = {"base.T?"};
  expect_choice(model, known, {"base.Rx", "base.Ry", "base.Rz"});
  known.fix = {"base.Tx", "base.Rz"};
  expect_choice(model, known, {"base.Tx", "base.Rx", "base.Ry", "base.Rz"});
  CalibrationOptions frame{.known_targets = {a_point_and_a_frame()[1]}};
  expect_choice(model, frame, {"B.x", "B.y", "B.z", "B.Rx", "B.Ry", "B.Rz"});
  frame.free = {"B.?"};
  expect_choice(model, frame, {"B.Rx", "B.Ry", "B.Rz"});
  frame.known_targets.push_back(a_point_and_a_frame()[0]);
  frame.free = {};
  expect_choice(model, frame, {"A.x", "A.y", "A.z", "B.x", "B.y", "B.z", "B.Rx", "B.Ry", "B.Rz"});
}

TEST(ParameterChoice, IsMadeAtTheGeometryThatIsStated) {
  const ErrorModel model = complete_model(testing::fanuc());
  Random random(2);
  const ReductionOptions bent{.configurations = 15, .errors = testing::random_errors(model, random, 0.01, 0.1)};
  const ParameterChoice found = choose_parameters(model, a_point_and_a_frame(), {}, bent);
  EXPECT_EQ(found.reduction.kept, reduced_model(model, a_point_and_a_frame(), bent).kept);
  EXPECT_NE(found.free, choose_parameters(model, a_point_and_a_frame(), {}, {.configurations = 15}).free);
}

TEST(ParameterChoice, RefusesPatternsThatNothingMatches) {
  const ErrorModel model = complete_model(testing::fanuc());
  const auto refused = [&](const CalibrationOptions& options) {
    return refusal([&] { choose_parameters(model, a_point_and_a_frame(), options); });
  };
  EXPECT_THAT(refused({.fix = {"dq2", "dq7"}}), HasSubstr("fix: 'dq7' matches no parameter; there are base.Tx, base"));
  EXPECT_THAT(refused({.free = {"Tz9"}}), HasSubstr("free: 'Tz9' matches no parameter; there are base.Tx"));
  EXPECT_THAT(refused({.free = {"gravity.*"}}), HasSubstr("free: 'gravity.*' matches no parameter"));
  EXPECT_THAT(refused({.fix = {"A.Rx"}}), HasSubstr("'A.Rx' matches no parameter"));
  EXPECT_EQ(refused({.fix = {"gravity.*", "tables", "gain.2", "backlash?2"}}), "nothing was refused");
}

TEST(ParameterChoice, RefusesToFixFramesThatAreNotKnown) {
  const ErrorModel model = complete_model(testing::fanuc());
  const auto refused = [&](const CalibrationOptions& options) -> std::vector<std::string> {
    try {
      choose_parameters(model, a_point_and_a_frame(), options);
    } catch (const OptionError& error) {
      std::vector<std::string> told = {error.option(), error.fault()};
      told.insert(told.end(), error.remedies().begin(), error.remedies().end());
      return told;
    }
    return {};
  };
  EXPECT_THAT(refused({.fix = {"base.Rx"}}),
              ElementsAre("fix", "base.Rx can only be fixed where its value is known", "known_base"));
  EXPECT_THAT(refused({.fix = {"A.y"}, .known_targets = {a_point_and_a_frame()[1]}}),
              ElementsAre("fix", "A.y can only be fixed where its value is known", "known_targets"));
  EXPECT_THAT(refused({.fix = {"A.y"}, .known_targets = {a_point_and_a_frame()[0]}}), ElementsAre());
}

TEST(ParameterChoice, PatternsOfEffectsLeaveOutTheTermsThatTheyMatch) {
  const ErrorModel model = complete_model(testing::fanuc());
  const std::vector<EffectTerm> gains = gain_terms(model);
  const auto fixed = [&](const std::vector<std::string>& patterns) {
    std::vector<std::string> names;
    for (const EffectTerm& term : gains) {
      if (fixes_effect({.fix = patterns}, term)) {
        names.push_back(term.name);
      }
    }
    return names;
  };
  EXPECT_THAT(fixed({}), ElementsAre());
  EXPECT_THAT(fixed({"gain.2", "dq1", "gravity.*"}), ElementsAre("gain.2"));
  EXPECT_THAT(fixed({"dq1", "gain.?"}), ElementsAre("gain.1", "gain.2", "gain.3", "gain.4", "gain.5", "gain.6"));
  EXPECT_THAT(fixed({"g*"}), ElementsAre()) << "no group's name, so of parameters";
  EXPECT_THAT(fixed({"*"}), ElementsAre());
}

}  // namespace
}  // namespace kdl_calibration::parameter_choice_test
