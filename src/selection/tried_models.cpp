#include "selection/tried_models.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/random.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kDrawings = 2000;

// Number of draws of each configuration, with replacement.
VectorXd drawn(Index configurations, Random& random) {
  VectorXd times = VectorXd::Zero(configurations);
  for (Index i = 0; i < configurations; ++i) {
    times[std::min(static_cast<Index>(random.uniform(0.0, static_cast<double>(configurations))), configurations - 1)] +=
        1.0;
  }
  return times;
}

}  // namespace

void TriedModels::add(ModelOption option, VectorXd squares) {
  tried_.push_back({std::move(option), std::move(squares)});
}

void TriedModels::put_first(const std::vector<std::string>& effects, bool sized) {
  std::stable_sort(tried_.begin(), tried_.end(),
                   [](const Tried& a, const Tried& b) { return a.option.held_out_rms < b.option.held_out_rms; });
  const auto chosen = std::find_if(tried_.begin(), tried_.end(), [&](const Tried& tried) {
    return tried.option.effects == effects && tried.option.sized == sized;
  });
  if (chosen != tried_.end()) {
    std::rotate(tried_.begin(), chosen, chosen + 1);
  }
}

double TriedModels::optimism() const {
  std::vector<const VectorXd*> comparable;
  for (const Tried& tried : tried_) {
    if (std::isfinite(tried.option.held_out_rms)) {
      comparable.push_back(&tried.squares);
    }
  }
  if (comparable.size() < 2 || !std::isfinite(tried_.front().option.held_out_rms)) {
    return 1.0;
  }
  MatrixXd squares(comparable.front()->size(), static_cast<Index>(comparable.size()));
  for (std::size_t i = 0; i < comparable.size(); ++i) {
    squares.col(static_cast<Index>(i)) = *comparable[i];
  }
  Random random(1);
  double of_first = 0.0;
  double of_best = 0.0;
  for (int drawing = 0; drawing < kDrawings; ++drawing) {
    const VectorXd times = drawn(squares.rows(), random);
    Index best = 0;
    (times.transpose() * squares).minCoeff(&best);
    const VectorXd judges = (times.array() == 0.0).cast<double>();
    of_first += judges.dot(squares.col(0));
    of_best += judges.dot(squares.col(best));
  }
  return of_best > of_first ? std::sqrt(of_best / of_first) : 1.0;
}

std::vector<ModelOption> TriedModels::options() const {
  std::vector<ModelOption> result;
  for (const Tried& tried : tried_) {
    result.push_back(tried.option);
  }
  return result;
}

}  // namespace kdl_calibration
