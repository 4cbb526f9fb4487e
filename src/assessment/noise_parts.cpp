#include "kdl_calibration/noise_parts.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Variances = NoiseParts::Variances;

constexpr Index kMisfit = 0;
constexpr Index kTargetMisfit = 1;
constexpr Index kCommon = 2;       // first of three axes
constexpr Index kIndependent = 5;  // first of three axes
constexpr Index kOrientation = 8;

// Combinations of measured coordinates that are independent of each other and have one variance
//   lambda = known + coefficients . variances,
// with J of these combinations: information J^T J, gradient J^T e and squares e^T e. Without information they are
// deviations that no parameter moves.
struct Stratum {
  MatrixXd information;
  VectorXd gradient;
  double squares = 0.0;
  double count = 0.0;
  Variances coefficients = Variances::Zero();
  double known = 0.0;
  double summed = 0.0;  // configurations that coefficients and known are sums over, until they are means

  void add_row(const Eigen::RowVectorXd& row, double residual, double factor) {
    if (information.size() == 0) {
      information = MatrixXd::Zero(row.size(), row.size());
      gradient = VectorXd::Zero(row.size());
    }
    information.selfadjointView<Eigen::Lower>().rankUpdate(row.transpose(), factor);
    gradient += factor * residual * row.transpose();
    squares += factor * residual * residual;
  }
};

// The rows of one target in one configuration.
struct Cell {
  std::int32_t target = 0;
  double weight = 0.0;  // of its rows, as many as there are repeats where nothing is down-weighted
  Vector3d mean = Vector3d::Zero();
  Vector3d known = Vector3d::Zero();  // stated variances of its mean
  double orientations = 0.0;
  std::vector<std::size_t> rows;
};

// Of one configuration's targets.
struct Means {
  std::vector<Matrix3Xd> jacobians;
  std::vector<Vector3d> residuals;  // [m] in W
  double inverse_weight = 0.0;      // mean over the targets
  Vector3d known = Vector3d::Zero();
};

bool is_stated(const Measurements& measurements, const NoiseModel& noise) {
  const bool every_row = std::all_of(measurements.observations.begin(), measurements.observations.end(),
                                     [](const Observation& o) { return o.split == Split::test || o.sigma > 0.0; });
  return every_row || noise.tracker || !noise.independent.isZero(0.0);
}

// Sums the strata configuration by configuration.
class Strata {
public:
  Strata(const Measurements& measurements, const ResidualOptions& options)
      : measurements_(measurements), options_(options), stated_(is_stated(measurements, options.noise)) {
    std::map<std::pair<std::int32_t, std::int32_t>, Cell> cells;
    for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
      const Observation& o = measurements.observations[row];
      if (o.split == Split::train && weight(row) > kLeastWeight) {
        Cell& cell = cells[{o.configuration, o.target}];
        cell.target = o.target;
        cell.weight += weight(row);
        cell.mean += weight(row) * o.position;
        cell.rows.push_back(row);
        const bool point = measurements.orientations.empty() || is_point(measurements.orientations[row]);
        cell.orientations += point ? 0.0 : weight(row);
      }
    }
    for (auto& [key, cell] : cells) {
      cell.mean /= cell.weight;
      for (const std::size_t row : cell.rows) {
        const Vector3d own = point_covariance(options.noise, measurements.observations[row]).diagonal();
        cell.known += stated_ ? Vector3d(own * weight(row) / (cell.weight * cell.weight)) : Vector3d(Vector3d::Zero());
      }
      configurations_[key.first].push_back(std::move(cell));
    }
    for (const auto& [c, of_configuration] : configurations_) {
      add_repeats(of_configuration);
      several_targets_ = several_targets_ || of_configuration.size() > 1;
    }
  }

  // Residuals of the means and their Jacobians at one estimate.
  void add_means(const ErrorModel& model, const Estimate& estimate, const Unknowns& free) {
    const PositionPredictor predictor(model, estimate, free);
    const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements_.joint_values);
    for (const auto& [c, cells] : configurations_) {
      const std::vector<Matrix3Xd> jacobians = predictor.jacobians(measurements_.joint_values.col(c));
      const Eigen::Isometry3d X_WF = estimate.X_WB * X_BF[static_cast<std::size_t>(c)];
      Means means;
      for (const Cell& cell : cells) {
        const auto k = static_cast<std::size_t>(cell.target);
        means.jacobians.push_back(jacobians[k]);
        means.residuals.emplace_back(cell.mean - X_WF * estimate.targets[k].X_FT.translation());
        means.inverse_weight += 1.0 / cell.weight / static_cast<double>(cells.size());
        means.known += cell.known / static_cast<double>(cells.size());
      }
      add_means(means);
    }
  }

  // Rows of orientations stand behind those of the configuration's points, times the root of their weight.
  void add_orientations(const WhitenedSystem& system) {
    std::size_t block = 0;
    for (const auto& [c, cells] : configurations_) {
      Index row = system.blocks[block++] + 3 * static_cast<Index>(cells.size());
      for (const Cell& cell : cells) {
        if (cell.orientations > 0.0) {
          Stratum& stratum = means_[{-1, 0, 0}];
          const double factor = 1.0 / cell.orientations;
          for (Index i = 0; i < 3; ++i, ++row) {
            stratum.add_row(system.jacobian.row(row), system.residual[row], factor);
          }
          stratum.count += 3.0;
          stratum.coefficients[kOrientation] += factor;
          stratum.summed += 1.0;
        }
      }
    }
  }

  std::vector<Stratum> finished() const {
    std::vector<Stratum> result;
    for (const auto& strata : {means_, deviations_, repeats_}) {
      for (const auto& [key, stratum] : strata) {
        if (stratum.count > 0.0) {
          Stratum& mean = result.emplace_back(stratum);
          mean.coefficients /= mean.summed;
          mean.known /= mean.summed;
          mean.information = MatrixXd(mean.information.selfadjointView<Eigen::Lower>());
        }
      }
    }
    return result;
  }

  bool stated() const { return stated_; }
  bool several_targets() const { return several_targets_; }
  // Per axis; 0 without repeats.
  double repeat_freedom() const { return repeat_freedom_; }
  // Whether repeats hold several targets, so that what these share can be told from what is their own.
  bool separates_common() const { return several_in_a_repeat_; }
  Vector3d mean_known() const { return known_rows_ > 0.0 ? Vector3d(known_sum_ / known_rows_) : Vector3d::Zero(); }

private:
  static constexpr double kLeastWeight = 1e-6;
  using Key = std::array<long, 3>;

  double weight(std::size_t row) const { return options_.row_weights.empty() ? 1.0 : options_.row_weights[row]; }

  // Deviations from the means over the repeats: their sums over the targets of a repeat, and the rest.
  void add_repeats(const std::vector<Cell>& cells) {
    std::map<std::int32_t, std::pair<Vector3d, double>> of_repeat;
    Vector3d squares = Vector3d::Zero();
    Vector3d known = Vector3d::Zero();
    double freedom = 0.0;
    double rows = 0.0;
    for (const Cell& cell : cells) {
      freedom += static_cast<double>(cell.rows.size()) - 1.0;
      for (const std::size_t row : cell.rows) {
        const Observation& o = measurements_.observations[row];
        const Vector3d deviation = std::sqrt(weight(row)) * (o.position - cell.mean);
        squares += deviation.cwiseAbs2();
        auto& [sum, count] = of_repeat.try_emplace(o.repeat, Vector3d::Zero(), 0.0).first->second;
        sum += deviation;
        count += 1.0;
        rows += 1.0;
        known += stated_ ? Vector3d(point_covariance(options_.noise, o).diagonal()) : Vector3d(Vector3d::Zero());
      }
    }
    known_sum_ += known;
    known_rows_ += rows;
    if (!(freedom > 0.0)) {
      return;
    }
    repeat_freedom_ += freedom;
    const double together = rows / static_cast<double>(of_repeat.size());  // targets in a repeat, on average
    const bool separate = together > 1.5;
    several_in_a_repeat_ = several_in_a_repeat_ || separate;
    const double shared_freedom = separate ? std::min(static_cast<double>(of_repeat.size()) - 1.0, freedom) : 0.0;
    Vector3d shared = Vector3d::Zero();
    for (const auto& [repeat, sum] : of_repeat) {
      shared += separate ? Vector3d(sum.first.cwiseAbs2() / sum.second) : Vector3d(Vector3d::Zero());
    }
    for (Index axis = 0; axis < 3; ++axis) {
      const auto add = [&](long kind, double sum, double count, double of_common) {
        Stratum& stratum = repeats_[{kind, std::lround(together), axis}];
        stratum.squares += sum;
        stratum.count += count;
        stratum.coefficients[kCommon + axis] += of_common;
        stratum.coefficients[kIndependent + axis] += 1.0;
        stratum.known += known[axis] / rows;
        stratum.summed += 1.0;
      };
      if (separate) {
        add(0, shared[axis], shared_freedom, together);
        add(1, squares[axis] - shared[axis], freedom - shared_freedom, 0.0);
      } else {
        add(2, squares[axis], freedom, 1.0);
      }
    }
  }

  void add_means(const Means& means) {
    const auto targets = static_cast<long>(means.residuals.size());
    const auto T = static_cast<double>(targets);
    const long repeats = std::lround(1.0 / means.inverse_weight);
    for (Index axis = 0; axis < 3; ++axis) {
      Stratum& mean = means_[{targets, repeats, axis}];
      Stratum& deviation = deviations_[{targets, repeats, axis}];
      Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(means.jacobians.front().cols());
      double residuals = 0.0;
      for (std::size_t t = 0; t < means.residuals.size(); ++t) {
        const Eigen::RowVectorXd row = means.jacobians[t].row(axis);
        deviation.add_row(row, means.residuals[t][axis], 1.0);
        sum += row;
        residuals += means.residuals[t][axis];
      }
      deviation.add_row(sum, residuals, -1.0 / T);
      mean.add_row(sum, residuals, 1.0 / T);
      mean.count += 1.0;
      deviation.count += T - 1.0;
      mean.coefficients[kMisfit] += T;
      mean.coefficients[kCommon + axis] += T * means.inverse_weight;
      for (Stratum* stratum : {&mean, &deviation}) {
        stratum->coefficients[kTargetMisfit] += 1.0;
        stratum->coefficients[kIndependent + axis] += means.inverse_weight;
        stratum->known += means.known[axis];
        stratum->summed += 1.0;
      }
    }
  }

  const Measurements& measurements_;
  const ResidualOptions& options_;
  const bool stated_;
  std::map<std::int32_t, std::vector<Cell>> configurations_;
  std::map<Key, Stratum> means_;
  std::map<Key, Stratum> deviations_;
  std::map<Key, Stratum> repeats_;
  Vector3d known_sum_ = Vector3d::Zero();
  double known_rows_ = 0.0;
  double repeat_freedom_ = 0.0;
  bool several_targets_ = false;
  bool several_in_a_repeat_ = false;
};

// x >= 0 that minimises sum w (z - C x)^2 (Lawson and Hanson 1974, chapter 23), for a few unknowns.
VectorXd nonnegative_least_squares(const MatrixXd& C, const VectorXd& z, const VectorXd& w) {
  const MatrixXd normal = C.transpose() * w.asDiagonal() * C;
  const VectorXd right = C.transpose() * w.cwiseProduct(z);
  const Index n = C.cols();
  VectorXd x = VectorXd::Zero(n);
  std::vector<bool> active(static_cast<std::size_t>(n), false);
  const double small = 1e-12 * right.cwiseAbs().maxCoeff();
  for (Index round = 0; round < 3 * n; ++round) {
    const VectorXd slope = right - normal * x;
    Index best = -1;
    for (Index i = 0; i < n; ++i) {
      if (!active[static_cast<std::size_t>(i)] && slope[i] > small && (best < 0 || slope[i] > slope[best])) {
        best = i;
      }
    }
    if (best < 0) {
      break;
    }
    active[static_cast<std::size_t>(best)] = true;
    for (;;) {
      std::vector<Index> chosen;
      for (Index i = 0; i < n; ++i) {
        if (active[static_cast<std::size_t>(i)]) {
          chosen.push_back(i);
        }
      }
      const MatrixXd part = normal(chosen, chosen);
      const VectorXd solution = part.completeOrthogonalDecomposition().solve(VectorXd(right(chosen)));
      if (solution.minCoeff() > 0.0) {
        x.setZero();
        x(chosen) = solution;
        break;
      }
      double step = 1.0;
      for (std::size_t i = 0; i < chosen.size(); ++i) {
        const auto s = static_cast<Index>(i);
        if (solution[s] <= 0.0) {
          step = std::min(step, x[chosen[i]] / (x[chosen[i]] - solution[s]));
        }
      }
      for (std::size_t i = 0; i < chosen.size(); ++i) {
        double& value = x[chosen[i]];
        value += step * (solution[static_cast<Index>(i)] - value);
        if (!(value > 1e-15 * solution.cwiseAbs().maxCoeff())) {
          value = 0.0;
          active[static_cast<std::size_t>(chosen[i])] = false;
        }
      }
      if (std::none_of(active.begin(), active.end(), [](bool a) { return a; })) {
        break;
      }
    }
  }
  return x;
}

// Which parts are estimated, as columns that tie those that are one: parts x unknowns.
MatrixXd unknown_parts(const Strata& strata, const NoiseModel& noise, bool orientations) {
  constexpr double kFreedomPerAxis = 20.0;
  const bool repeats = strata.repeat_freedom() > 0.0;
  const bool by_axis = strata.repeat_freedom() >= kFreedomPerAxis;
  std::vector<Variances> columns;
  const auto add = [&](Index first, Index count) {
    Variances& column = columns.emplace_back(Variances::Zero());
    column.segment(first, count).setOnes();
  };
  const auto add_axes = [&](Index first) {
    for (Index axis = 0; axis < (by_axis ? 3 : 0); ++axis) {
      add(first + axis, 1);
    }
    if (!by_axis) {
      add(first, 3);
    }
  };
  if (strata.several_targets()) {
    add(kMisfit, 1);
  }
  if (repeats || strata.stated()) {
    add(kTargetMisfit, 1);
  }
  if (noise.common.isZero(0.0) && strata.separates_common()) {
    add_axes(kCommon);
  }
  if (!strata.stated()) {
    add_axes(kIndependent);
  }
  if (orientations && !(noise.orientation > 0.0)) {
    add(kOrientation, 1);
  }
  MatrixXd result(NoiseParts::kCount, static_cast<Index>(columns.size()));
  for (std::size_t i = 0; i < columns.size(); ++i) {
    result.col(static_cast<Index>(i)) = columns[i];
  }
  return result;
}

// Patterson and Thompson's equations: of each stratum the residual squares at the weighted solution have the
// expectation lambda (count - trace), trace = tr(C information) / lambda. For these traces the variances are the
// maximum of a gamma likelihood, found by weighted least squares; then the solution is found anew.
class Reml {
public:
  Reml(std::vector<Stratum> strata, MatrixXd unknown, const Variances& stated, MatrixXd priors, VectorXd prior_gradient)
      : strata_(std::move(strata)),
        unknown_(std::move(unknown)),
        priors_(std::move(priors)),
        prior_gradient_(std::move(prior_gradient)) {
    const auto count = static_cast<Index>(strata_.size());
    design_.resize(count, unknown_.cols());
    known_.resize(count);
    for (Index s = 0; s < count; ++s) {
      const Stratum& stratum = strata_[static_cast<std::size_t>(s)];
      design_.row(s) = stratum.coefficients.transpose() * unknown_;
      known_[s] = stratum.known + stratum.coefficients.dot(stated);
    }
  }

  bool run() {
    constexpr int kRounds = 300;
    constexpr double kSettled = 1e-7;
    double squares = 0.0;
    double count = 0.0;
    for (const Stratum& stratum : strata_) {
      squares += stratum.squares;
      count += stratum.count;
    }
    if (!(squares > 0.0) || unknown_.cols() == 0) {
      return false;
    }
    floor_ = kLeastShare * squares / count;
    lambda_ = VectorXd::Constant(known_.size(), squares / count);
    x_ = VectorXd::Constant(unknown_.cols(), 0.0);
    for (int round = 0; round < kRounds; ++round) {
      solve();
      const VectorXd before = lambda_;
      fit_gamma();
      if (!lambda_.allFinite()) {
        return false;
      }
      if ((lambda_ - before).cwiseQuotient(before).cwiseAbs().maxCoeff() < kSettled) {
        solve();
        return true;
      }
    }
    return true;
  }

  NoiseParts parts(const Variances& stated) const {
    NoiseParts result;
    result.variances = stated + unknown_ * x_;
    const VectorXd weight = freedom_.cwiseQuotient(lambda_.cwiseAbs2());
    std::vector<Index> positive;
    for (Index i = 0; i < x_.size(); ++i) {
      if (x_[i] > 0.0) {
        positive.push_back(i);
      }
    }
    if (!positive.empty()) {
      const MatrixXd design = design_(Eigen::all, positive);
      const MatrixXd fisher = 0.5 * design.transpose() * weight.asDiagonal() * design;
      const MatrixXd expand = unknown_(Eigen::all, positive);
      result.covariance = expand * fisher.completeOrthogonalDecomposition().pseudoInverse() * expand.transpose();
    }
    result.sensitivity.resize(static_cast<std::size_t>(NoiseParts::kCount));
    for (Index k = 0; k < NoiseParts::kCount; ++k) {
      result.estimated[static_cast<std::size_t>(k)] = unknown_.row(k).maxCoeff() > 0.0;
      if (!result.estimated[static_cast<std::size_t>(k)]) {
        continue;
      }
      MatrixXd& sum = result.sensitivity[static_cast<std::size_t>(k)];
      sum = MatrixXd::Zero(priors_.rows(), priors_.cols());
      for (std::size_t s = 0; s < strata_.size(); ++s) {
        if (strata_[s].information.size() > 0 && strata_[s].coefficients[k] != 0.0) {
          const double lambda = lambda_[static_cast<Index>(s)];
          sum += strata_[s].coefficients[k] / (lambda * lambda) * strata_[s].information;
        }
      }
    }
    for (std::size_t s = 0; s < strata_.size(); ++s) {
      const bool of_means = strata_[s].information.size() > 0 && strata_[s].coefficients[kOrientation] == 0.0;
      result.degrees_of_freedom += of_means ? freedom_[static_cast<Index>(s)] : 0.0;
    }
    return result;
  }

private:
  static constexpr double kLeastShare = 1e-14;

  // The solution at these variances: what is left of the squares, and the degrees of freedom of each stratum.
  void solve() {
    MatrixXd M = priors_;
    VectorXd g = prior_gradient_;
    for (std::size_t s = 0; s < strata_.size(); ++s) {
      if (strata_[s].information.size() > 0) {
        M += strata_[s].information / lambda_[static_cast<Index>(s)];
        g += strata_[s].gradient / lambda_[static_cast<Index>(s)];
      }
    }
    const VectorXd scale = M.diagonal().unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 0.0; });
    MatrixXd scaled = scale.asDiagonal() * M * scale.asDiagonal();
    scaled.diagonal().array() += 1e-12;
    const Eigen::LDLT<MatrixXd> factor(scaled);
    const MatrixXd inverse = factor.solve(MatrixXd::Identity(M.rows(), M.cols()));
    const MatrixXd C = scale.asDiagonal() * inverse * scale.asDiagonal();
    const VectorXd step = C * g;
    freedom_.resize(known_.size());
    squares_.resize(known_.size());
    for (std::size_t i = 0; i < strata_.size(); ++i) {
      const auto s = static_cast<Index>(i);
      const Stratum& stratum = strata_[i];
      freedom_[s] = stratum.count;
      squares_[s] = stratum.squares;
      if (stratum.information.size() > 0) {
        freedom_[s] -= C.cwiseProduct(stratum.information).sum() / lambda_[s];
        squares_[s] += step.dot(stratum.information * step) - 2.0 * step.dot(stratum.gradient);
      }
      freedom_[s] = std::max(freedom_[s], 0.0);
      squares_[s] = std::max(squares_[s], 0.0);
    }
  }

  void fit_gamma() {
    constexpr int kRounds = 50;
    const VectorXd z = squares_.array() / freedom_.array().max(1e-9);
    for (int round = 0; round < kRounds; ++round) {
      const VectorXd w = freedom_.cwiseQuotient(lambda_.cwiseAbs2());
      x_ = nonnegative_least_squares(design_, z - known_, w * lambda_.squaredNorm());
      const VectorXd next = (known_ + design_ * x_).cwiseMax(floor_);
      const bool settled = (next - lambda_).cwiseQuotient(lambda_).cwiseAbs().maxCoeff() < 1e-10;
      lambda_ = next;
      if (settled) {
        break;
      }
    }
  }

  std::vector<Stratum> strata_;
  MatrixXd unknown_;
  MatrixXd priors_;
  VectorXd prior_gradient_;
  MatrixXd design_;
  VectorXd known_;
  VectorXd lambda_;
  VectorXd freedom_;
  VectorXd squares_;
  VectorXd x_;
  double floor_ = 0.0;
};

// Up to this many configurations are looked at.
constexpr Eigen::Index kMostConfigurations = 2000;

struct Sample {
  Measurements measurements;
  ResidualOptions options;
  double share = 1.0;
};

Sample sampled(const Measurements& measurements, const ResidualOptions& options) {
  const Index count = measurements.joint_values.cols();
  if (count <= kMostConfigurations) {
    return {.measurements = measurements, .options = options};
  }
  std::vector<bool> chosen(static_cast<std::size_t>(count), false);
  for (Index i = 0; i < kMostConfigurations; ++i) {
    chosen[static_cast<std::size_t>(i * count / kMostConfigurations)] = true;
  }
  const auto keep = [&](const Observation& o) { return chosen[static_cast<std::size_t>(o.configuration)]; };
  Sample sample{.measurements = subset(measurements, keep), .options = options};
  sample.options.row_weights.clear();
  for (std::size_t row = 0; row < options.row_weights.size(); ++row) {
    if (keep(measurements.observations[row])) {
      sample.options.row_weights.push_back(options.row_weights[row]);
    }
  }
  sample.share = static_cast<double>(kMostConfigurations) / static_cast<double>(count);
  return sample;
}

// With unit noise, orientations included.
WhitenedSystem unit_system(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                           const Unknowns& free, const ResidualOptions& options) {
  Measurements plain = measurements;
  for (Observation& observation : plain.observations) {
    observation.sigma = 0.0;
  }
  ResidualOptions unit;
  unit.noise.independent.setOnes();
  unit.noise.orientation = 1.0;
  unit.row_weights = options.row_weights;
  return LeastSquaresProblem(model, plain, free, unit).whitened(estimate);
}

}  // namespace

NoiseModel NoiseParts::model(const NoiseModel& stated) const {
  NoiseModel result = stated;
  const auto sigma = [&](Index k) { return std::sqrt(variances[k]); };
  result.misfit = sigma(kMisfit);
  result.target_misfit = sigma(kTargetMisfit);
  if (estimated[kCommon]) {
    result.common = variances.segment<3>(kCommon).cwiseSqrt();
  }
  if (estimated[kIndependent]) {
    result.independent = variances.segment<3>(kIndependent).cwiseSqrt();
  }
  if (estimated[kOrientation]) {
    result.orientation = sigma(kOrientation);
  }
  return result;
}

Matrix3d NoiseParts::point() const {
  const Vector3d own = variances.segment<3>(kCommon) + variances.segment<3>(kIndependent);
  return Vector3d(own.array() + variances[kMisfit] + variances[kTargetMisfit]).asDiagonal();
}

double NoiseParts::freedom(double value, const Variances& gradient) const {
  const double variance = gradient.dot(covariance * gradient);
  return variance > 0.0 ? 2.0 * value * value / variance : std::numeric_limits<double>::infinity();
}

NoiseParts estimate_noise(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                          const Unknowns& free, const ResidualOptions& options) {
  const Sample sample = sampled(measurements, options);
  Strata strata(sample.measurements, sample.options);
  strata.add_means(model, estimate, free);
  if (!measurements.orientations.empty()) {
    strata.add_orientations(unit_system(model, sample.measurements, estimate, free, sample.options));
  }

  Variances stated = Variances::Zero();
  stated.segment<3>(kCommon) = options.noise.common.cwiseAbs2();
  stated[kOrientation] = options.noise.orientation * options.noise.orientation;
  const bool orientations = !measurements.orientations.empty();

  ResidualOptions priors_alone;
  priors_alone.priors = options.priors;
  priors_alone.noise.independent.setOnes();
  const WhitenedSystem with_priors =
      LeastSquaresProblem(model, sample.measurements, free, priors_alone).whitened(estimate);
  const Index first = with_priors.blocks.back();
  const MatrixXd rows = with_priors.jacobian.bottomRows(with_priors.jacobian.rows() - first);
  const VectorXd residuals = with_priors.residual.tail(with_priors.residual.size() - first);

  Reml reml(strata.finished(), unknown_parts(strata, options.noise, orientations), stated,
            sample.share * rows.transpose() * rows, sample.share * rows.transpose() * residuals);
  const bool converged = reml.run();
  if (!converged) {
    return {};
  }
  NoiseParts parts = reml.parts(stated);
  if (strata.stated()) {
    parts.variances.segment<3>(kIndependent) = strata.mean_known();
  }
  parts.covariance *= sample.share;
  parts.degrees_of_freedom /= sample.share;
  for (MatrixXd& sensitivity : parts.sensitivity) {
    sensitivity /= sample.share;
  }
  parts.converged = true;
  return parts;
}

}  // namespace kdl_calibration
