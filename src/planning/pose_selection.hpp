#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "planning/experiment.hpp"

namespace kdl_calibration {

/// The quantity that the plan minimises.
enum class Criterion {
  d_optimal,  ///< the volume of the parameters' confidence ellipsoid: largest det M, which is O1
  g_optimal,  ///< the worst predicted variance of a target over the tasks
  i_optimal   ///< the mean predicted variance over the tasks
};

/// Candidates, prior information and tasks of a selection.
struct SelectionTask {
  Eigen::MatrixXd candidates;  ///< joints x n [rad] or [m]
  Eigen::MatrixXd given;       ///< p x p: information from priors and existing measurements
  /// joints x m: where to predict, for G and I; empty: at the candidates.
  Eigen::MatrixXd tasks = {};
};

struct SelectionOptions {
  Criterion criterion = Criterion::d_optimal;
  int count = 30;  ///< configurations to choose
  int starts = 8;  ///< from different random designs
  int depth = 3;   ///< longest excursion
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: one per core; the answer does not depend on it
  /// Called with the completed share, from any thread but never from two at once.
  std::function<void(double)> progress;
};

struct Selection {
  std::vector<Eigen::Index> chosen;  ///< columns of the candidates, ascending, each once
  Eigen::MatrixXd information;       ///< p x p: `given` plus that of the chosen configurations
  double objective = 0.0;            ///< log det M, or the largest or mean variance of a target [m^2]
  long exchanges = 0;                ///< exchanges of two configurations, over all starts
};

/// Selects configurations for a criterion.
///
/// DETMAX (Mitchell 1974): excursions that add the best candidates and then remove the least useful members, or the
/// reverse, one or several at once. Rank updates (Fedorov 1972):
///   det(M + A^T A) = det(M) det(I + A M^-1 A^T).
/// Candidates are ranked to first order, tr(A M^-1 A^T), and the best of them evaluated exactly. The starts search
/// among the first 5,000 candidates; the best continue among all. For G the variances are weighted by a power of
/// themselves, so that their mean approaches the maximum. Throws InputError: fewer candidates than wanted, too few
/// configurations to determine all parameters.
Selection select_configurations(const Experiment& experiment, const SelectionTask& task,
                                const SelectionOptions& options = {});

/// Statistic of a prediction.
enum class Figure { mean, p95, max };
double figure_of(const Prediction& prediction, Figure figure);

/// The smallest number of configurations, from 1 to `options.count`, whose predicted figure over the tasks is at most
/// `accuracy` [m]. The number is doubled, then bisected, so that the next smaller number was tried and failed. Throws
/// InputError if `options.count` configurations are too few (the message states their accuracy).
Selection select_for_accuracy(const Experiment& experiment, const SelectionTask& task, double accuracy, Figure figure,
                              const SelectionOptions& options);

struct RandomDesigns {
  int count = 30;  ///< configurations of each design
  int draws = 1;
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: one per core; the answer does not depend on it
};
/// Information of random designs of the candidates, `given` included.
std::vector<Eigen::MatrixXd> random_designs(const Experiment& experiment, const SelectionTask& task,
                                            const RandomDesigns& designs);

/// A lower bound of (det M / det M*)^(1/p), where M is the information of `design` (`count` candidates), `given`
/// included, and M* that of the best weighting of the candidates. Weights are found by the multiplicative algorithm
/// (Titterington 1976). As log det is concave,
///   log det M* <= log det M_w + count (max d - sum w d),  d_i = tr(A_i M_w^-1 A_i^T).
double d_efficiency(const Experiment& experiment, const SelectionTask& task, const Eigen::MatrixXd& design, int count,
                    int threads = 0);

}  // namespace kdl_calibration
