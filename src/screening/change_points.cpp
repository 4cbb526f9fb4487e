#include "screening/change_points.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <numeric>
#include <utility>

#include "base/number_range.hpp"
#include "base/robust_statistics.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// A step between the rows position - 1 and position of a series.
struct Change {
  Index position = 0;
  double statistic = 0.0;  // in units of the values; divided by sigma a norm of standard normal values
};

Index shortest(const QualityOptions& options) { return std::max(options.segment, 1); }

// Largest difference of winsorised means over the steps in the rows [first, end): sqrt(n1 n2 / n) |m2 - m1|.
Change largest_change(const MatrixXd& values, Index first, Index end, const QualityOptions& options, double sigma) {
  constexpr double kWinsor = 5.0;
  const Index n = end - first;
  MatrixXd clipped = values.middleRows(first, n);
  const VectorXd centre = medians(values, first, end);
  for (Index axis = 0; axis < values.cols(); ++axis) {
    const VectorXd deviation = (clipped.col(axis).array() - centre[axis]).matrix();
    const double reach =
        kWinsor * std::max({robust_sigma({deviation.begin(), deviation.end()}), sigma, options.noise_floor});
    clipped.col(axis) = deviation.cwiseMax(-reach).cwiseMin(reach);
  }
  const VectorXd total = clipped.colwise().sum();
  VectorXd before = VectorXd::Zero(values.cols());
  Change best{.position = first};
  for (Index i = 1; i + shortest(options) <= n; ++i) {
    before += clipped.row(i - 1).transpose();
    if (i < shortest(options)) {
      continue;
    }
    const auto n1 = static_cast<double>(i);
    const auto n2 = static_cast<double>(n - i);
    const double statistic = std::sqrt(n1 * n2 / static_cast<double>(n)) * ((total - before) / n2 - before / n1).norm();
    if (statistic > best.statistic) {
      best = {.position = first + i, .statistic = statistic};
    }
  }
  return best;
}

// Position of the step near `change` with the smallest sum of absolute deviations from the medians of both sides.
Index located(const MatrixXd& values, Index first, Index end, Index change, Index segment) {
  const VectorXd before = medians(values, first, change);
  const VectorXd after = medians(values, change, end);
  double sum = 0.0;  // over the rows before, relative to all of them being after
  double smallest = kInfinity;
  Index best = change;
  for (Index i = first; i < end - segment; ++i) {
    sum += (values.row(i).transpose() - before).lpNorm<1>() - (values.row(i).transpose() - after).lpNorm<1>();
    if (i + 1 - first >= segment && sum < smallest) {
      smallest = sum;
      best = i + 1;
    }
  }
  return best;
}

// State of the binary segmentation.
struct Segmentation {
  const MatrixXd& values;
  double sigma;
  double limit;
  const QualityOptions& options;
  std::vector<Index> changes;  // ascending

  void find(Index first, Index end) {
    if (end - first < 2 * shortest(options)) {
      return;
    }
    const Change change = largest_change(values, first, end, options, sigma);
    if (!(change.statistic > limit * sigma)) {
      return;
    }
    const Index position = located(values, first, end, change.position, shortest(options));
    const double step = (medians(values, position, end) - medians(values, first, position)).norm();
    if (!(step > options.smallest_slip * sigma)) {
      return;
    }
    find(first, position);
    changes.push_back(position);
    find(position, end);
  }
};

Levels levels_of(const Series& series, const std::vector<Index>& changes) {
  Levels levels;
  Index first = 0;
  for (const Index change : changes) {
    levels.values.push_back(medians(series.values, first, change));
    levels.starts.push_back(series.configurations[static_cast<std::size_t>(change)]);
    levels.last_before.push_back(series.configurations[static_cast<std::size_t>(change - 1)]);
    first = change;
  }
  levels.values.push_back(medians(series.values, first, series.values.rows()));
  return levels;
}

// Fewer rows cannot show a slip: deviations of three values from their median do not measure the noise.
Index fewest_rows(const QualityOptions& options) { return std::max(Index{10}, 2 * shortest(options)); }

}  // namespace

Series series_of(const Repeats& repeats, Index axes) {
  const std::vector<int>& of = repeats.configurations;
  std::vector<Index> order(of.size());
  std::iota(order.begin(), order.end(), Index{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](Index a, Index b) { return of[static_cast<std::size_t>(a)] < of[static_cast<std::size_t>(b)]; });
  const MatrixXd sorted = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      repeats.values.data(), static_cast<Index>(of.size()), axes)(order, Eigen::all);
  Series series{.configurations = {}, .values = MatrixXd(sorted.rows(), axes)};
  for (Index first = 0; first < sorted.rows();) {
    const int configuration = of[static_cast<std::size_t>(order[static_cast<std::size_t>(first)])];
    Index end = first + 1;
    while (end < sorted.rows() && of[static_cast<std::size_t>(order[static_cast<std::size_t>(end)])] == configuration) {
      ++end;
    }
    auto row = series.values.row(static_cast<Index>(series.configurations.size()));
    if (end == first + 1) {
      row = sorted.row(first);
    } else {
      row = medians(sorted, first, end);
    }
    series.configurations.push_back(configuration);
    first = end;
  }
  series.values.conservativeResize(static_cast<Index>(series.configurations.size()), Eigen::NoChange);
  return series;
}

std::vector<Levels> find_levels(const std::vector<Series>& all, double fitted, double independent,
                                const QualityOptions& options) {
  std::vector<double> centred;
  double comparisons = 0.0;
  for (const Series& series : all) {
    const Index rows = series.values.rows();
    Index change = rows;
    if (rows >= fewest_rows(options)) {
      change = largest_change(series.values, 0, rows, options, 0.0).position;
      comparisons += static_cast<double>(rows - 2 * shortest(options) + 1);
    }
    for (const auto& [first, end] : {std::pair<Index, Index>{0, change}, std::pair<Index, Index>{change, rows}}) {
      if (first < end) {
        const MatrixXd part =
            series.values.middleRows(first, end - first).rowwise() - medians(series.values, first, end).transpose();
        centred.insert(centred.end(), part.reshaped().begin(), part.reshaped().end());
        fitted += static_cast<double>(part.cols());
      }
    }
  }
  const Scatter scatter = scatter_of(centred, fitted, options.noise_floor);
  std::vector<Levels> result;
  for (const Series& series : all) {
    const double limit =
        threshold(options.false_alarm, comparisons, series.values.cols(), independent * scatter.freedom);
    const Index rows = series.values.rows() < fewest_rows(options) ? 0 : series.values.rows();
    Segmentation search{series.values, scatter.sigma, limit, options, {}};
    search.find(0, rows);
    result.push_back(levels_of(series, search.changes));
  }
  return result;
}

}  // namespace kdl_calibration
