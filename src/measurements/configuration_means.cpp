#include "measurements/configuration_means.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <limits>

#include "robot/mimic.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// Matrix product in which NaN marks an unknown input: only dependent outputs become NaN.
VectorXd product_with_unknowns(const MatrixXd& matrix, const VectorXd& values) {
  VectorXd result = VectorXd::Zero(matrix.rows());
  for (Index i = 0; i < matrix.rows(); ++i) {
    for (Index j = 0; j < matrix.cols(); ++j) {
      if (matrix(i, j) != 0.0) {
        result[i] += matrix(i, j) * values[j];
      }
    }
  }
  return result;
}

}  // namespace

ConfigurationMeans::ConfigurationMeans(std::span<const Column> columns) {
  if (std::any_of(columns.begin(), columns.end(), present)) {
    columns_.assign(columns.begin(), columns.end());
  }
}

void ConfigurationMeans::add(const Row& row, std::int32_t configuration) {
  const std::size_t first = static_cast<std::size_t>(configuration) * columns_.size();
  if (sums_.size() < first + columns_.size()) {
    sums_.resize(first + columns_.size(), 0.0);
    counts_.resize(first + columns_.size(), 0);
  }
  for (std::size_t j = 0; j < columns_.size(); ++j) {
    if (row.has(columns_[j])) {
      sums_[first + j] += row.number(columns_[j]);
      ++counts_[first + j];
    }
  }
}

MatrixXd ConfigurationMeans::means(std::size_t configurations) const {
  if (columns_.empty()) {
    return {};
  }
  MatrixXd result(std::ssize(columns_), static_cast<Index>(configurations));
  for (Index i = 0; i < result.size(); ++i) {
    const auto at = static_cast<std::size_t>(i);  // column by column, as the matrix is stored
    result.data()[i] = counts_[at] > 0 ? sums_[at] / counts_[at] : kUnknown;
  }
  return result;
}

MatrixXd joint_torques(const MatrixXd& stated, const ExpectedJoints& joints) {
  if (stated.size() == 0) {
    return {};
  }
  const Index count = stated.rows();
  const MatrixXd transposed_inverse = joints.convention != nullptr
                                          ? MatrixXd(joints.convention->matrix.inverse().transpose())
                                          : MatrixXd::Identity(count, count);
  const std::vector<std::size_t> independent = independent_joints(joints.joints);
  MatrixXd result = MatrixXd::Constant(static_cast<Index>(joints.joints.size()), stated.cols(), kUnknown);
  for (Index c = 0; c < stated.cols(); ++c) {
    const VectorXd torques = product_with_unknowns(transposed_inverse, stated.col(c));
    for (std::size_t i = 0; i < independent.size(); ++i) {
      result(static_cast<Index>(independent[i]), c) = torques[static_cast<Index>(i)];
    }
  }
  return result;
}

}  // namespace kdl_calibration
