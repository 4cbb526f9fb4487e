#include "interface/touched_frames.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "base/decompositions.hpp"
#include "base/preconditions.hpp"
#include "estimation/prediction.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Tool and user frame as one arm finds them, and what is left of the touches.
struct Found {
  Isometry3d X_FT;
  Isometry3d X_BU = Isometry3d::Identity();
  Matrix3Xd tool_residuals;
  Matrix3Xd user_residuals;
  Index freedom = 0;    // coordinates of the user's touches that the frame does not need
  Matrix3Xd user = {};  // the touched points in the user frame
  double flange_height = 0.0;
};

// The point that all touches share and the tool's tip: R p_F + t = p_B for each flange pose, least squares.
void find_tool(const std::vector<Isometry3d>& X_BF, const Eigen::Ref<const Matrix3Xd>& slips, Found& found) {
  constexpr double kLeastTurn = 0.01;  // [rad], roughly
  const auto count = static_cast<Index>(X_BF.size());
  MatrixXd A(3 * count, 6);
  VectorXd b(3 * count);
  for (Index i = 0; i < count; ++i) {
    const Isometry3d& X = X_BF[static_cast<std::size_t>(i)];
    A.middleRows<3>(3 * i) << X.linear(), -Eigen::Matrix3d::Identity();
    b.segment<3>(3 * i) = -X.translation() - slips.col(i);
  }
  const VectorXd squares = eigenvalues(A.transpose() * A);
  if (squares[0] < kLeastTurn * kLeastTurn * squares[5]) {
    refuse_input("the touches of the tool hardly turn it", "orientations that differ by turns about two axes");
  }
  const VectorXd p = least_squares_solution(A, b);
  found.X_FT.translation() = p.head<3>();
  found.tool_residuals = (b - A * p).reshaped(3, count);
}

constexpr double kLeastAngle = 1e-3;  // [rad] between directions to touched points

[[noreturn]] void refuse_line() {
  refuse_input("the points of the user frame lie on one line", "three points that span a plane");
}

// See FrameTouches::user_points. Off the x-y plane are only the points behind the second.
void frame_through(const Matrix3Xd& points, Found& found) {
  const Vector3d x = points.col(1) - points.col(0);
  const Vector3d y = points.rightCols(points.cols() - 2).rowwise().mean() - points.col(0);
  const Vector3d z = x.cross(y);
  if (!(z.norm() > kLeastAngle * x.norm() * y.norm())) {
    refuse_line();
  }
  found.X_BU.linear() << x.normalized(), z.cross(x).normalized(), z.normalized();
  found.X_BU.translation() = points.col(0);
  const Vector3d up = z.normalized();
  found.user_residuals = up * (up.transpose() * (points.colwise() - points.col(0)));
  found.freedom = points.cols() - 3;
}

// The frame in which the touched points have the stated coordinates, least squares (Umeyama 1991).
void fit_frame(const Matrix3Xd& touched, const Matrix3Xd& stated, Found& found) {
  const Matrix3Xd centred = stated.colwise() - stated.rowwise().mean();
  const Vector3d squares = eigenvalues(centred * centred.transpose());
  if (!(squares[1] > kLeastAngle * kLeastAngle * squares[2])) {
    refuse_line();
  }
  found.X_BU = rigid_motion(stated, touched);
  found.user_residuals = (touched - found.X_BU.linear() * stated).colwise() - found.X_BU.translation();
  found.freedom = touched.size() - 6;
}

// The frames that the arm of an estimate finds, where each touch slipped by so much [m].
Found find(const ErrorModel& model, const Estimate& estimate, const FrameTouches& touches, const Matrix3Xd& slips) {
  Found found{.X_FT = touches.X_FT, .tool_residuals = {}, .user_residuals = {}};
  if (touches.tool.cols() > 0) {
    find_tool(flange_poses(model, estimate, touches.tool), slips.leftCols(touches.tool.cols()), found);
  }
  if (touches.user.cols() > 0) {
    const std::vector<Isometry3d> flanges = flange_poses(model, estimate, touches.user);
    Matrix3Xd touched = slips.rightCols(touches.user.cols());
    for (Index i = 0; i < touched.cols(); ++i) {
      touched.col(i) += flanges[static_cast<std::size_t>(i)] * found.X_FT.translation();
    }
    if (touches.user_points.cols() > 0) {
      fit_frame(touched, touches.user_points, found);
    } else {
      frame_through(touched, found);
    }
    found.user = found.X_BU.inverse() * touched;
    found.flange_height = -std::numeric_limits<double>::infinity();
    for (Index i = 0; i < touched.cols(); ++i) {
      const Vector3d to_flange = flanges[static_cast<std::size_t>(i)].translation() - touched.col(i);
      found.flange_height = std::max(found.flange_height, to_flange.dot(found.X_BU.linear().col(2)));
    }
  }
  return found;
}

// The tool's origin, the user frame's, and its rotation: `other` against `found`.
VectorXd difference(const Found& found, const Found& other) {
  VectorXd result(9);
  result << other.X_FT.translation() - found.X_FT.translation(), other.X_BU.translation() - found.X_BU.translation(),
      rotation_log(other.X_BU.linear() * found.X_BU.linear().transpose());
  return result;
}

// d(frames) / d(column): central differences; `at` gives the frames at a step of a column.
template <class At>
MatrixXd derivatives(Index columns, const At& at) {
  constexpr double kStep = 1e-6;  // [m] or [rad]
  MatrixXd result(9, columns);
  for (Index i = 0; i < columns; ++i) {
    result.col(i) = difference(at(i, -kStep), at(i, kStep)) / (2.0 * kStep);
  }
  return result;
}

// Covariance of the frames by the parameters of the calibration; NaN if unknown.
MatrixXd covariance_by_calibration(const PredictionBasis& basis, const FrameTouches& touches, const Matrix3Xd& slips) {
  const ColumnRange geometric = basis.free.range(UnknownGroup::geometric);
  const Index count = geometric.count + basis.free.range(UnknownGroup::effects).count;
  if (basis.covariance.rows() != basis.free.size()) {
    return MatrixXd::Constant(9, 9, std::numeric_limits<double>::quiet_NaN());
  }
  const MatrixXd J = derivatives(count, [&](Index i, double step) {
    const VectorXd steps = step * VectorXd::Unit(basis.free.size(), geometric.first + i);
    return find(basis.model, basis.free.moved(basis.estimate, steps), touches, slips);
  });
  return J * basis.covariance.block(geometric.first, geometric.first, count, count) * J.transpose();
}

TouchedFrame touched(const Isometry3d& frame, const MatrixXd& covariance, const Matrix3Xd& residuals, Index freedom) {
  const VectorXd distances = residuals.colwise().norm().transpose();
  TouchedFrame result{.frame = frame, .covariance = covariance, .rms = {}, .largest = {}};
  if (freedom > 0) {
    result.rms = std::sqrt(distances.squaredNorm() / static_cast<double>(distances.size()));
    result.largest = distances.maxCoeff();
  }
  return result;
}

void check(const FrameTouches& touches) {
  if (touches.tool.cols() > 0) {
    require_at_least("touches of a tool", touches.tool.cols(), 4);
  }
  if (touches.user.cols() > 0) {
    require_at_least("touches of a user frame", touches.user.cols(), 3);
  }
  if (touches.user_points.cols() > 0) {
    require_count("points of a user frame", touches.user_points.cols(), touches.user.cols());
  }
}

}  // namespace

VectorXd TouchedFrame::std(const Eigen::Matrix3d& R) const {
  VectorXd result(covariance.rows());
  for (Index i = 0; i < result.size(); i += 3) {
    result.segment<3>(i) = (R.transpose() * covariance.block<3, 3>(i, i) * R).diagonal().cwiseSqrt();
  }
  return result;
}

TouchedFrames touched_frames(const PredictionBasis& basis, const FrameTouches& touches) {
  check(touches);
  const Matrix3Xd none = Matrix3Xd::Zero(3, touches.tool.cols() + touches.user.cols());
  const Found found = find(basis.model, basis.estimate, touches, none);
  TouchedFrames result;
  MatrixXd covariance = covariance_by_calibration(basis, touches, none);
  const Index of_tool = std::max<Index>(found.tool_residuals.size() - 6, 0);
  const Index freedom = of_tool + found.freedom;
  if (freedom > 0) {
    const double variance =
        (found.tool_residuals.squaredNorm() + found.user_residuals.squaredNorm()) / static_cast<double>(freedom);
    const MatrixXd J = derivatives(none.size(), [&](Index i, double step) {
      Matrix3Xd slips = none;
      slips.reshaped()[i] = step;
      return find(basis.model, basis.estimate, touches, slips);
    });
    covariance += variance * J * J.transpose();
    result.touch_sigma = std::sqrt(variance);
  } else {  // nothing shows how well it was touched
    covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  if (touches.tool.cols() > 0) {
    result.tool = touched(found.X_FT, covariance.topLeftCorner<3, 3>(), found.tool_residuals, of_tool);
  }
  if (touches.user.cols() > 0) {
    result.user = touched(found.X_BU, covariance.bottomRightCorner<6, 6>(), found.user_residuals, found.freedom);
    result.flange_height = found.flange_height;
    result.least_y = touches.user_points.cols() > 0 ? 0.0 : found.user.row(1).tail(touches.user.cols() - 2).minCoeff();
  }
  return result;
}

}  // namespace kdl_calibration
