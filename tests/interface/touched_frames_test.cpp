#include "interface/touched_frames.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <array>
#include <kdl/chainiksolverpos_lma.hpp>

#include "geometry_alone.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::touched_frames_test {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::bundled_robot;
using ::testing::HasSubstr;
using testing::kdl_pose;

PredictionBasis bent() {
  PredictionBasis basis = nominal_basis(bundled_robot());
  Random random(3);
  basis.estimate.errors = testing::random_errors(basis.model, random, 1e-3, 1e-3);
  return basis;
}

// By KDL: joint values at which the tip of a tool is at each of these points, in random orientations.
MatrixXd touching(const KDL::Chain& chain, const Vector3d& tip, const Matrix3Xd& points, Random& random) {
  KDL::ChainIkSolverPos_LMA solver(chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-11);
  MatrixXd result(6, points.cols());
  for (Index i = 0; i < points.cols();) {
    KDL::JntArray start(6);
    start.data << random.uniform(-0.5, 0.5), random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3),
        random.uniform(-1.0, 1.0), random.uniform(0.4, 1.2), random.uniform(-1.0, 1.0);
    KDL::Frame goal = kdl_pose(chain, start.data);
    const Vector3d place = points.col(i);
    goal.p = KDL::Vector(place.x(), place.y(), place.z()) - goal.M * KDL::Vector(tip.x(), tip.y(), tip.z());
    KDL::JntArray found(6);
    solver.CartToJnt(start, goal, found);
    if ((kdl_pose(chain, found.data).p - goal.p).Norm() < 1e-9) {
      result.col(i++) = found.data;
    }
  }
  return result;
}

struct Cell {
  Vector3d tip = {0.05, 0.3, -0.02};
  Vector3d spike = {0.1, 1.9, 1.2};
  Isometry3d X_BU =
      Eigen::Translation3d(-0.3, 1.6, 0.9) * Isometry3d(Eigen::AngleAxisd(0.7, Vector3d(1.0, 2.0, 3.0).normalized()));
  Matrix3Xd points =
      (Matrix3Xd(3, 5) << 0.0, 0.4, 0.1, 0.3, 0.2, 0.0, 0.0, 0.3, 0.2, -0.1, 0.0, 0.0, 0.0, 0.1, 0.2).finished();

  Matrix3Xd touched() const { return X_BU * points; }
};

double distance(const Isometry3d& a, const Isometry3d& b) { return (a.matrix() - b.matrix()).cwiseAbs().maxCoeff(); }

// Of the calibrated and of the nominal arm; the user frame from coordinates, and from its origin, axis and plane.
TEST(TouchedFrames, AreThoseThatWereTouched) {
  const Cell cell;
  for (const PredictionBasis& basis : {bent(), nominal_basis(bundled_robot())}) {
    const KDL::Chain chain = error_chain(basis.model, basis.estimate.errors);
    Random random(1);
    FrameTouches touches{.tool = touching(chain, cell.tip, cell.spike.replicate(1, 5), random),
                         .user = touching(chain, cell.tip, cell.touched(), random),
                         .user_points = cell.points};
    const TouchedFrames found = touched_frames(basis, touches);
    EXPECT_LT((found.tool->frame.translation() - cell.tip).norm(), 1e-7);
    EXPECT_LT(distance(found.user->frame, cell.X_BU), 1e-6);
    EXPECT_LT(*found.user->largest, 1e-7);
    EXPECT_LT(*found.touch_sigma, 1e-7);
    touches.user = touches.user.leftCols(3).eval();
    touches.user_points.resize(3, 0);
    const TouchedFrames through = touched_frames(basis, touches);
    EXPECT_LT(distance(through.user->frame, cell.X_BU), 1e-6);
    const TouchedFrames with_tool = touched_frames(
        basis,
        {.tool = {}, .user = touches.user, .user_points = {}, .X_FT = Isometry3d(Eigen::Translation3d(cell.tip))});
    EXPECT_LT(distance(with_tool.user->frame, cell.X_BU), 1e-6);
    EXPECT_FALSE(with_tool.tool || with_tool.touch_sigma);
  }
}

// Touches that slip, and an arm that differs from the calibrated one as its covariance says.
TEST(TouchedFrames, AreOffByTheirStandardDeviation) {
  constexpr int kRuns = 60;
  constexpr double kSlip = 5e-5;
  const Cell cell;
  PredictionBasis basis = bent();
  basis.free = Unknowns(basis.model, {}, {"dq2", "dq3", "Tz2", "Tx4", "Rz5"});
  basis.covariance = Eigen::Matrix<double, 5, 1>::Constant(1e-8).asDiagonal();
  Eigen::Matrix<double, 9, 1> squares = Eigen::Matrix<double, 9, 1>::Zero();
  Eigen::Matrix<double, 9, 1> predicted = squares;
  Random random(7);
  const auto slipped = [&](Matrix3Xd points) -> Matrix3Xd {
    return points.unaryExpr([&](double coordinate) { return coordinate + kSlip * random.normal(); });
  };
  for (int run = 0; run < kRuns; ++run) {
    const VectorXd step = VectorXd::NullaryExpr(5, [&] { return 1e-4 * random.normal(); });
    const KDL::Chain chain = error_chain(basis.model, basis.free.moved(basis.estimate, step).errors);
    const TouchedFrames found =
        touched_frames(basis, {.tool = touching(chain, cell.tip, slipped(cell.spike.replicate(1, 8)), random),
                               .user = touching(chain, cell.tip, slipped(cell.touched()), random),
                               .user_points = cell.points});
    Eigen::Matrix<double, 9, 1> error;
    error << found.tool->frame.translation() - cell.tip, found.user->frame.translation() - cell.X_BU.translation(),
        rotation_log(found.user->frame.linear() * cell.X_BU.linear().transpose());
    squares += error.cwiseAbs2() / kRuns;
    predicted.head<3>() += found.tool->std().cwiseAbs2() / kRuns;
    predicted.tail<6>() += found.user->std().cwiseAbs2() / kRuns;
  }
  for (Index i = 0; i < 9; ++i) {
    EXPECT_NEAR(squares[i] / predicted[i], 1.0, 0.5) << i;
  }
}

// With a known tool, always in the same orientation.
struct Plane {
  Isometry3d X_FT = Isometry3d(Eigen::Translation3d(Cell().tip));
  Matrix3Xd points = Cell().points.leftCols(4);
  Isometry3d X_BU;  // the flange is above it

  Plane() {
    points.row(2).setZero();
    points.col(3).y() = 0.2;
    Random random(1);
    const Vector3d spike = Cell().spike;
    const VectorXd q = touching(bundled_robot().chain, Cell().tip, spike, random).col(0);
    const Vector3d flange = to_eigen(kdl_pose(bundled_robot().chain, q)).translation();
    X_BU = Eigen::Translation3d(spike) * Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), flange - spike);
  }

  FrameTouches touches(const Matrix3Xd& in_user, const Matrix3Xd& stated) const {
    MatrixXd q(6, in_user.cols());
    for (Index i = 0; i < q.cols(); ++i) {
      Random random(1);
      const Vector3d point = X_BU * in_user.col(i);
      q.col(i) = touching(bundled_robot().chain, Cell().tip, point, random);
    }
    return {.tool = {}, .user = q, .user_points = stated, .X_FT = X_FT};
  }
};

TEST(TouchedFrames, AreBelowTheFlangeUnlessMirroredOrExchanged) {
  const Plane plane;
  const PredictionBasis basis = nominal_basis(bundled_robot());
  const double height = touched_frames(basis, plane.touches(plane.points, plane.points)).flange_height;
  EXPECT_GT(height, 0.2);
  Matrix3Xd mirrored = plane.points;
  mirrored.row(1) *= -1.0;
  const TouchedFrames wrong = touched_frames(basis, plane.touches(plane.points, mirrored));
  EXPECT_LT(*wrong.user->rms, 1e-6);  // nothing else shows it
  EXPECT_LT(wrong.flange_height, -0.2);
  const Matrix3Xd none;
  const Matrix3Xd three = plane.points.leftCols(3);
  EXPECT_GT(touched_frames(basis, plane.touches(three, none)).flange_height, 0.2);
  for (const auto& order : {std::array{1, 0, 2}, std::array{0, 2, 1}, std::array{2, 1, 0}}) {
    EXPECT_LT(touched_frames(basis, plane.touches(three(Eigen::all, order), none)).flange_height, -0.2);
  }
  // A fourth point shows an exchange with its neighbour, too.
  Matrix3Xd four = plane.points;
  four.col(3) << 0.3, -0.1, 0.0;
  EXPECT_LT(touched_frames(basis, plane.touches(four, none)).least_y, -0.05);
}

TEST(TouchedFrames, OfThreePointsHaveNoCheckAndNoDeviation) {
  const Plane plane;
  const PredictionBasis basis = nominal_basis(bundled_robot());
  const TouchedFrames three = touched_frames(basis, plane.touches(plane.points.leftCols(3), {}));
  EXPECT_FALSE(three.user->rms || three.touch_sigma);
  EXPECT_TRUE(three.user->std().array().isNaN().all());
  Matrix3Xd points = plane.points;
  points.col(3).z() = 1e-3;
  const TouchedFrames four = touched_frames(basis, plane.touches(points, {}));
  EXPECT_NEAR(*four.user->largest, 5e-4, 1e-4);  // half of it turns the plane
  EXPECT_GT(*four.touch_sigma, 3e-4);
}

TEST(TouchedFrames, OfACalibrationWithoutCovarianceHaveNoDeviation) {
  const Cell cell;
  PredictionBasis basis = bent();
  basis.free = Unknowns(basis.model, {}, {"dq2"});
  Random random(1);
  const MatrixXd q =
      touching(error_chain(basis.model, basis.estimate.errors), cell.tip, cell.spike.replicate(1, 5), random);
  EXPECT_TRUE(touched_frames(basis, {.tool = q}).tool->std().array().isNaN().all());
}

TEST(TouchedFrames, RefuseTouchesThatDoNotDetermineThem) {
  const PredictionBasis basis = nominal_basis(bundled_robot());
  const Cell cell;
  Random random(1);
  const MatrixXd tool = touching(bundled_robot().chain, cell.tip, cell.spike.replicate(1, 4), random);
  const auto fault = [&](const FrameTouches& touches) {
    return testing::refusal([&] { touched_frames(basis, touches); });
  };
  EXPECT_THAT(fault({.tool = tool.leftCols(3)}), HasSubstr("3 touches of a tool, expected at least 4"));
  EXPECT_THAT(fault({.tool = tool.col(0).replicate(1, 4)}), HasSubstr("hardly turn it"));
  MatrixXd about_one_axis = tool.col(0).replicate(1, 4);
  about_one_axis.row(5) << 0.0, 0.5, 1.0, 1.5;
  EXPECT_THAT(fault({.tool = about_one_axis}), HasSubstr("hardly turn it"));
  EXPECT_THAT(fault({.user = tool.leftCols(2)}), HasSubstr("2 touches of a user frame, expected at least 3"));
  EXPECT_THAT(fault({.user = tool.col(0).replicate(1, 3)}), HasSubstr("one line"));
  EXPECT_THAT(fault({.user = tool, .user_points = VectorXd::LinSpaced(12, 1.0, 12.0).reshaped(3, 4)}),
              HasSubstr("one line"));
  EXPECT_THAT(fault({.user = tool, .user_points = cell.points}), HasSubstr("5 points of a user frame, expected 4"));
}

}  // namespace
}  // namespace kdl_calibration::touched_frames_test
