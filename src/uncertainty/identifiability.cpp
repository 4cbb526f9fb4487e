#include "uncertainty/identifiability.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "base/decompositions.hpp"
#include "base/singular_values.hpp"
#include "uncertainty/unit_columns.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The triangular factor of the scaled Jacobian: same singular values and dependencies, few rows.
MatrixXd scaled_triangle(const MatrixXd& jacobian) {
  const VectorXd norms = jacobian.colwise().norm();
  const double none = 1e-12 * norms.maxCoeff();
  const VectorXd scale = norms.unaryExpr([&](double norm) { return norm > none ? 1.0 / norm : 0.0; });
  return triangular_factor(jacobian * scale.asDiagonal());
}

int rank_of(const VectorXd& singular_values, const IdentifiabilityOptions& options) {
  return static_cast<int>((singular_values.array() > options.tolerance * singular_values[0]).count());
}

// Merges groups that share a parameter, because tied parameters form an equivalence class.
std::vector<std::vector<std::string>> merged(const std::vector<std::vector<std::string>>& groups) {
  std::vector<std::vector<std::string>> result;
  for (std::vector<std::string> group : groups) {
    for (auto other = result.begin(); other != result.end();) {
      const bool shares = std::find_first_of(group.begin(), group.end(), other->begin(), other->end()) != group.end();
      if (!shares) {
        ++other;
        continue;
      }
      for (const std::string& name : group) {
        if (std::find(other->begin(), other->end(), name) == other->end()) {
          other->push_back(name);
        }
      }
      group = std::move(*other);
      other = result.erase(other);
    }
    result.push_back(std::move(group));
  }
  return result;
}

// Groups of linearly dependent parameters: from left to right each column in the span of the previous ones, with the
// ones that it depends on.
std::vector<std::vector<std::string>> dependencies(const MatrixXd& sqrt_information,
                                                   const std::vector<std::string>& names, double tolerance) {
  std::vector<std::vector<std::string>> groups;
  std::vector<Index> independent;
  for (Index c = 0; c < sqrt_information.cols(); ++c) {
    const VectorXd column = sqrt_information.col(c);
    if (column.norm() == 0.0) {
      groups.push_back({names[static_cast<std::size_t>(c)]});
      continue;
    }
    if (independent.empty()) {
      independent.push_back(c);
      continue;
    }
    const MatrixXd basis = sqrt_information(Eigen::all, independent);
    const VectorXd coefficients = least_squares_solution(basis, column);
    if ((basis * coefficients - column).norm() > tolerance) {
      independent.push_back(c);
      continue;
    }
    std::vector<std::string>& group = groups.emplace_back();
    for (std::size_t i = 0; i < independent.size(); ++i) {
      if (std::abs(coefficients[static_cast<Index>(i)]) > 1e-6) {
        group.push_back(names[static_cast<std::size_t>(independent[i])]);
      }
    }
    group.push_back(names[static_cast<std::size_t>(c)]);
  }
  return merged(groups);
}

// The parameters that make up nine tenths of a unit vector's square, heaviest first.
std::vector<std::string> heaviest(const VectorXd& direction, const std::vector<std::string>& names) {
  std::vector<std::size_t> order(names.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::abs(direction[static_cast<Index>(a)]) > std::abs(direction[static_cast<Index>(b)]);
  });
  std::vector<std::string> result;
  double share = 0.0;
  for (const std::size_t i : order) {
    if (share > 0.9) {
      break;
    }
    share += direction[static_cast<Index>(i)] * direction[static_cast<Index>(i)];
    result.push_back(names[i]);
  }
  return result;
}

}  // namespace

Identifiability identifiability(const MatrixXd& jacobian, const std::vector<std::string>& names,
                                const IdentifiabilityOptions& options) {
  Identifiability result;
  result.columns = static_cast<int>(jacobian.cols());
  if (jacobian.size() == 0) {
    return result;
  }
  const MatrixXd sqrt_information = scaled_triangle(jacobian);
  result.singular_values = VectorXd::Zero(jacobian.cols());
  const auto [values, V] = singular_system(sqrt_information);
  result.singular_values.head(values.size()) = values;
  const double largest = values[0];
  result.rank = rank_of(values, options);
  for (Index i = result.rank; i-- > 0 && values[i] < options.weak * largest;) {
    result.weak.push_back(heaviest(V.col(i), names));
  }
  const bool full = result.rank == result.columns;
  result.condition = full ? largest / values[values.size() - 1] : std::numeric_limits<double>::infinity();
  if (!full) {
    result.tied = dependencies(sqrt_information, names, 10.0 * options.tolerance);
  }
  return result;
}

int rank_of(const MatrixXd& jacobian, const IdentifiabilityOptions& options) {
  if (jacobian.size() == 0) {
    return 0;
  }
  const MatrixXd triangle = scaled_triangle(jacobian);
  return regular_inverse(triangle) ? static_cast<int>(jacobian.cols()) : rank_of(singular_values(triangle), options);
}

}  // namespace kdl_calibration
