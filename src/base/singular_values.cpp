#include "base/singular_values.hpp"

#include <Eigen/SVD>

namespace kdl_calibration {

using Eigen::MatrixXd;
using Eigen::VectorXd;

SingularSystem singular_system(const MatrixXd& matrix) {
  const auto system_of = [](const auto& svd) {
    return SingularSystem{.values = svd.singularValues(), .V = svd.matrixV()};
  };
  return matrix.cols() > kManyColumns ? system_of(Eigen::BDCSVD<MatrixXd>(matrix, Eigen::ComputeFullV))
                                      : system_of(Eigen::JacobiSVD<MatrixXd>(matrix, Eigen::ComputeFullV));
}

VectorXd singular_values(const MatrixXd& matrix) {
  return matrix.cols() > kManyColumns ? Eigen::BDCSVD<MatrixXd>(matrix).singularValues()
                                      : Eigen::JacobiSVD<MatrixXd>(matrix).singularValues();
}

}  // namespace kdl_calibration
