#include "measurements/torque_means.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <limits>

#include "measurements/drive_signals.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

bool has_torques(const Header& header) { return std::any_of(header.torques.begin(), header.torques.end(), present); }

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

void TorqueMeans::add(const Header& header, const Row& row, std::int32_t configuration) {
  if (!has_torques(header)) {
    return;
  }
  const std::size_t joints = header.torques.size();
  const std::size_t first = static_cast<std::size_t>(configuration) * joints;
  if (sums_.size() < first + joints) {
    sums_.resize(first + joints, 0.0);
    counts_.resize(first + joints, 0);
  }
  for (std::size_t j = 0; j < joints; ++j) {
    if (row.has(header.torques[j])) {
      sums_[first + j] += row.number(header.torques[j]);
      ++counts_[first + j];
    }
  }
}

MatrixXd TorqueMeans::means(const Header& header, const ExpectedJoints& joints, std::size_t configurations) const {
  if (!has_torques(header)) {
    return {};
  }
  const std::size_t count = header.torques.size();
  const MatrixXd transposed_inverse = joints.convention != nullptr
                                          ? MatrixXd(joints.convention->matrix.inverse().transpose())
                                          : MatrixXd::Identity(static_cast<Index>(count), static_cast<Index>(count));
  const std::vector<std::size_t> independent = independent_joints(joints.joints);
  MatrixXd result =
      MatrixXd::Constant(static_cast<Index>(joints.joints.size()), static_cast<Index>(configurations), kUnknown);
  VectorXd stated(static_cast<Index>(count));
  for (std::size_t c = 0; c < configurations; ++c) {
    for (std::size_t j = 0; j < count; ++j) {
      const std::size_t at = c * count + j;
      stated[static_cast<Index>(j)] = counts_[at] > 0 ? sums_[at] / counts_[at] : kUnknown;
    }
    const VectorXd torques = product_with_unknowns(transposed_inverse, stated);
    for (std::size_t i = 0; i < independent.size(); ++i) {
      result(static_cast<Index>(independent[i]), static_cast<Index>(c)) = torques[static_cast<Index>(i)];
    }
  }
  return result;
}

}  // namespace kdl_calibration
