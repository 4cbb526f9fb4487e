#include "calibration/tried_models.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

using Eigen::VectorXd;

constexpr Eigen::Index kConfigurations = 24;

ModelOption option_of(const VectorXd& squares, const std::string& effect) {
  return {
      .priors = {}, .effects = {effect}, .sized = false, .held_out_rms = std::sqrt(squares.mean()), .evidence = 0.0};
}

VectorXd squared_normals(Random& random) {
  VectorXd squares(kConfigurations);
  for (double& square : squares) {
    const double error = random.normal();
    square = error * error;
  }
  return squares;
}

TEST(TriedModels, ChoosingAmongEquallyGoodModelsCostsWhatTheBestHasByLuck) {
  constexpr int kRuns = 300;
  constexpr int kModels = 6;
  Random random(4);
  double claimed = 0.0;  // mean square of the best, as it seems
  double priced = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    TriedModels tried;
    double best = std::numeric_limits<double>::infinity();
    std::string name;
    for (int model = 0; model < kModels; ++model) {
      const VectorXd squares = squared_normals(random);
      tried.add(option_of(squares, std::to_string(model)), squares);
      if (squares.mean() < best) {
        best = squares.mean();
        name = std::to_string(model);
      }
    }
    tried.put_first({name}, false);
    const double price = tried.price_of_choosing();
    EXPECT_GE(price, 1.0);
    claimed += best / kRuns;
    priced += price * price * best / kRuns;
  }
  EXPECT_LT(claimed, 0.75);  // of the 1 that each of them has at new configurations
  EXPECT_NEAR(priced, 1.0, 0.06);
}

TEST(TriedModels, AModelThatIsBestEverywhereCostsNothing) {
  Random random(5);
  const VectorXd best = squared_normals(random);
  const VectorXd worse = 1.5 * best;
  TriedModels tried;
  tried.add(option_of(worse, "worse"), worse);
  tried.add(option_of(best, "best"), best);
  tried.put_first({"best"}, false);
  EXPECT_EQ(tried.price_of_choosing(), 1.0);
}

TEST(TriedModels, WhatCannotPredictEveryFoldIsNoRival) {
  Random random(6);
  const VectorXd squares = squared_normals(random);
  ModelOption undetermined = option_of(squares, "undetermined");
  undetermined.held_out_rms = std::numeric_limits<double>::infinity();
  TriedModels tried;
  tried.add(option_of(squares, "chosen"), squares);
  tried.add(undetermined, VectorXd::Zero(kConfigurations));
  tried.add(undetermined, VectorXd());
  tried.put_first({"chosen"}, false);
  EXPECT_EQ(tried.price_of_choosing(), 1.0);
}

TEST(TriedModels, TheChosenOneComesFirstAndTheOthersByWhatTheyPredict) {
  TriedModels tried;
  for (const double square : {3.0, 1.0, 2.0}) {
    const VectorXd squares = VectorXd::Constant(kConfigurations, square);
    tried.add(option_of(squares, std::to_string(static_cast<int>(square))), squares);
  }
  tried.put_first({"3"}, false);
  std::vector<std::string> order;
  for (const ModelOption& option : tried.options()) {
    order.push_back(option.effects.front());
  }
  EXPECT_EQ(order, (std::vector<std::string>{"3", "1", "2"}));
}

}  // namespace
}  // namespace kdl_calibration
