#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "kdl_calibration/experiment.hpp"

namespace kdl_calibration {

/// What the plan should make small.
enum class Criterion {
  d_optimal,  ///< the volume of the parameters' confidence ellipsoid: largest det M, which is O1
  g_optimal,  ///< the worst predicted variance of a target over the tasks
  i_optimal   ///< the mean predicted variance over the tasks
};

/// What configurations are chosen among, and for what.
struct SelectionTask {
  Eigen::MatrixXd candidates;  ///< joints x n [rad] or [m]
  Eigen::MatrixXd given;       ///< p x p: information beforehand, from priors and from what is already measured
  /// Joints x m: where predictions matter, for G and I; empty: everywhere among the candidates.
  Eigen::MatrixXd tasks = {};
};

struct SelectionOptions {
  Criterion criterion = Criterion::d_optimal;
  int count = 30;  ///< configurations to choose
  int starts = 8;  ///< from different random designs
  int depth = 3;   ///< longest excursion
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: one per core; the answer does not depend on it
  /// Called now and then with the share of the work that is done, from any thread but never from two at once.
  std::function<void(double)> progress;
};

struct Selection {
  std::vector<Eigen::Index> chosen;  ///< columns of the candidates, ascending, each once
  Eigen::MatrixXd information;       ///< p x p: what was given, and the chosen configurations'
  double objective = 0.0;            ///< log det M, or the largest or mean variance of a target [m^2]
  long exchanges = 0;                ///< of one configuration for another, over all starts
};

/// Chooses configurations.
///
/// DETMAX (Mitchell 1974): excursions that add the best candidates and take out the least useful members, or the other
/// way round, one by one and then several at once, with the rank updates of Fedorov (1972):
///   det(M + A^T A) = det(M) det(I + A M^-1 A^T).
/// Candidates are ranked to first order, tr(A M^-1 A^T), and the best of them evaluated exactly. The starts search
/// among the first 5,000 candidates, the best continue among all. The variances for G are weighted by a power of their
/// own value, which makes their mean approach the largest. Throws InputError: fewer candidates than wanted, too few
/// configurations to determine all parameters.
Selection select_configurations(const Experiment& experiment, const SelectionTask& task,
                                const SelectionOptions& options = {});

/// Which figure of a prediction is asked for.
enum class Figure { mean, p95, max };
double figure_of(const Prediction& prediction, Figure figure);

/// The smallest number of configurations, from 1 to `options.count`, whose plan promises at most `accuracy` [m] over
/// the tasks: doubled until it does, then bisected, so that the next smaller number was tried and did not do.
/// Throws InputError where `options.count` configurations do not reach it (the message says what they reach).
Selection select_for_accuracy(const Experiment& experiment, const SelectionTask& task, double accuracy, Figure figure,
                              const SelectionOptions& options);

struct RandomDesigns {
  int count = 30;  ///< configurations of each
  int draws = 1;
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: one per core; the answer does not depend on it
};
/// Information of designs of candidates drawn at random, each on top of what is given.
std::vector<Eigen::MatrixXd> random_designs(const Experiment& experiment, const SelectionTask& task,
                                            const RandomDesigns& designs);

/// A lower bound of (det M / det M*)^(1/p), where M is the information of a design of `count` candidates on top of
/// what is given, and M* the best that any weighting of the candidates could give in its place: weights by the
/// multiplicative algorithm (Titterington 1976), and since log det is concave
///   log det M* <= log det M_w + count (max d - sum w d),  d_i = tr(A_i M_w^-1 A_i^T).
double d_efficiency(const Experiment& experiment, const SelectionTask& task, const Eigen::MatrixXd& design, int count,
                    int threads = 0);

}  // namespace kdl_calibration
