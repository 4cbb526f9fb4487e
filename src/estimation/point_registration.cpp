#include "estimation/point_registration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unsupported/Eigen/KroneckerProduct>

#include "base/decompositions.hpp"
#include "measurements/readings.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::kroneckerProduct;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Matrix39d = Eigen::Matrix<double, 3, 9>;

// Weighted sums over the observations of one target. With vec(A) the stacked columns, vec(B A Z) = kron(Z^T, B) vec(A).
struct TargetSums {
  double weight = 0.0;
  Matrix3d R = Matrix3d::Zero();       // sum w R_BF
  Vector3d Rt_p = Vector3d::Zero();    // sum w R_BF^T p_BF
  Matrix39d Rt_z = Matrix39d::Zero();  // sum w kron(z^T, R_BF^T)
  double orientation_weight = 0.0;
  Matrix9d Rt_Z = Matrix9d::Zero();  // sum w kron(Z^T, R_BF^T)
};

struct Sums {
  double count = 0.0;  // number of observations
  double weight = 0.0;
  Vector3d z_mean = Vector3d::Zero();
  Vector3d z = Vector3d::Zero();
  Matrix3d zz = Matrix3d::Zero();
  Matrix3d p_zt = Matrix3d::Zero();  // sum w p z^T: vec of it is the right-hand side
  Vector3d p = Vector3d::Zero();
  double pp = 0.0;
  std::vector<TargetSums> targets;
};

Sums accumulate(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                const RegistrationOptions& options, const std::vector<const TargetFrame*>& known) {
  Sums sums;
  sums.targets.resize(measurements.targets.size());
  sums.count = static_cast<double>(measurements.observations.size());
  for (const Observation& observation : measurements.observations) {
    sums.z_mean += observation.position();
  }
  sums.z_mean /= std::max(sums.count, 1.0);
  for (const Observation& observation : measurements.observations) {
    const auto k = static_cast<std::size_t>(observation.target);
    const Eigen::Isometry3d& pose = X_BF[static_cast<std::size_t>(observation.configuration)];
    const Matrix3d R = pose.linear();
    const double w = observation.sigma > 0.0 ? 1.0 / (observation.sigma * observation.sigma) : 1.0;
    const Vector3d z = observation.position() - sums.z_mean;
    const Vector3d p = known[k] != nullptr ? Vector3d(pose * known[k]->X_FT.translation()) : pose.translation();
    sums.weight += w;
    sums.z += w * z;
    sums.zz += w * z * z.transpose();
    sums.p_zt += w * p * z.transpose();
    sums.p += w * p;
    sums.pp += w * p.squaredNorm();
    TargetSums& target = sums.targets[k];
    if (known[k] == nullptr) {
      target.weight += w;
      target.R += w * R;
      target.Rt_p += w * (R.transpose() * p);
      target.Rt_z += kroneckerProduct(w * z.transpose(), R.transpose());
    }
    if (const Orientation* const orientation = observation.orientation()) {
      const double weight = w * options.orientation_length * options.orientation_length;
      const Matrix3d Z = orientation->toRotationMatrix();
      target.orientation_weight += weight;
      target.Rt_Z += kroneckerProduct(weight * Z.transpose(), R.transpose());
    }
  }
  return sums;
}

// d vec(A exp([delta])) / d delta at delta = 0.
Eigen::Matrix<double, 9, 3> tangent(const Matrix3d& A) {
  Eigen::Matrix<double, 9, 3> T;
  T << Vector3d::Zero(), -A.col(2), A.col(1),  //
      A.col(2), Vector3d::Zero(), -A.col(0),   //
      -A.col(1), A.col(0), Vector3d::Zero();
  return T;
}

// f(A) = vec(A)^T Q vec(A) - 2 b^T vec(A) + constant, after the elimination of c and the targets:
//   t_k = (Rt_z vec(A) - R^T c - Rt_p) / (weight + ridge),   c = c_matrix vec(A) + c_vector.
struct RotationForm {
  Matrix9d Q;
  Vector9d b;
  double constant = 0.0;
  Matrix39d c_matrix;
  Vector3d c_vector;
  Vector3d relative_information = Vector3d::Ones();  // of c: with unknown over with known targets

  double value(const Matrix3d& A) const {
    const Eigen::Map<const Vector9d> theta(A.data());
    return theta.dot(Q.lazyProduct(theta) - 2.0 * b) + constant;
  }
};

// f(A exp([delta])) at delta = 0: half of its first and second derivatives. `hessian` includes the curvature of the
// rotations, `gauss_newton` does not. Only `hessian` is zero along every rotation that changes no residual.
struct Slope {
  Vector3d gradient;
  Matrix3d gauss_newton;
  Matrix3d hessian;
};

Slope slope_at(const RotationForm& form, const Matrix3d& A) {
  const Eigen::Matrix<double, 9, 3> T = tangent(A);
  const Eigen::Map<const Vector9d> theta(A.data());
  const Vector9d slope = form.Q.lazyProduct(theta) - form.b;
  const Matrix3d M = A.transpose() * Eigen::Map<const Matrix3d>(slope.data());
  // A exp([delta]) = A (I + [delta] + (delta delta^T - |delta|^2 I) / 2 + ...)
  const Matrix3d bend = 0.5 * (M + M.transpose()) - M.trace() * Matrix3d::Identity();
  // Q T without the products with the zeros of T. lazyProduct, because the matrices are too small for Eigen's blocked
  // product.
  Eigen::Matrix<double, 9, 3> turned_slope;
  for (Eigen::Index k = 0; k < 3; ++k) {
    const Eigen::Index i = (k + 1) % 3;
    const Eigen::Index j = (k + 2) % 3;
    turned_slope.col(k) = form.Q.middleCols<3>(3 * i).lazyProduct(A.col(j));
    turned_slope.col(k) -= form.Q.middleCols<3>(3 * j).lazyProduct(A.col(i));
  }
  Slope result{
      .gradient = T.transpose() * slope, .gauss_newton = T.transpose().lazyProduct(turned_slope), .hessian = bend};
  result.hessian += result.gauss_newton;
  return result;
}

// Eliminates c and the targets, with `ridge` times the squared length of each target added to the sum of squares.
RotationForm eliminate(const Sums& sums, double ridge) {
  RotationForm form;
  form.Q = kroneckerProduct(sums.zz, Matrix3d::Identity());
  form.b = Eigen::Map<const Vector9d>(sums.p_zt.data());
  form.constant = sums.pp;
  // Terms of c: C c = C_theta vec(A) - c_p at the minimum.
  Matrix3d C = sums.weight * Matrix3d::Identity();
  Matrix39d C_theta = kroneckerProduct(sums.z.transpose(), Matrix3d::Identity());
  Vector3d c_p = sums.p;
  for (const TargetSums& target : sums.targets) {
    if (target.weight > 0.0) {
      const double inverse = 1.0 / (target.weight + ridge);
      form.Q -= inverse * target.Rt_z.transpose() * target.Rt_z;
      form.b -= inverse * target.Rt_z.transpose() * target.Rt_p;
      form.constant -= inverse * target.Rt_p.squaredNorm();
      C -= inverse * target.R * target.R.transpose();
      C_theta -= inverse * target.R * target.Rt_z;
      c_p -= inverse * target.R * target.Rt_p;
    }
    if (target.orientation_weight > 0.0) {  // |A Z| = |A|
      form.Q += target.orientation_weight * Matrix9d::Identity() -
                target.Rt_Z.transpose() * target.Rt_Z / target.orientation_weight;
    }
  }
  form.relative_information = eigenvalues(C) / sums.weight;
  // C is singular for a single configuration; the least-norm c is used.
  const Matrix3d C_inverse = pseudo_inverse(C);
  form.c_matrix = C_inverse * C_theta;
  form.c_vector = -C_inverse * c_p;
  form.Q -= C_theta.transpose() * form.c_matrix;
  form.b -= form.c_matrix.transpose() * c_p;
  form.constant -= c_p.dot(C_inverse * c_p);
  return form;
}

// Damped Newton step; negative curvatures are replaced by their absolute values.
Vector3d newton_step(const Slope& slope, double added_damping) {
  Eigen::SelfAdjointEigenSolver<Matrix3d> eigen;
  eigen.computeDirect(slope.hessian);
  const Vector3d curvature = eigen.eigenvalues().cwiseAbs().array() + added_damping;
  return -eigen.eigenvectors() * (eigen.eigenvectors().transpose() * slope.gradient).cwiseQuotient(curvature);
}

// Whether one of the minima found is close to A.
bool is_known(const Matrix3d& A, const std::vector<Matrix3d>& found) {
  return std::any_of(found.begin(), found.end(), [&](const Matrix3d& other) { return (A - other).norm() < 0.1; });
}

// Levenberg-Marquardt on the rotations; steps use the form, not the data. Near a minimum with a large misfit it
// converges slowly: if the steps do not halve, Newton steps take over. Ends at a step shorter than `tolerance` [rad],
// or where it comes close to a minimum found earlier.
Matrix3d descend(const RotationForm& form, Matrix3d A, double tolerance, const std::vector<Matrix3d>& found = {}) {
  constexpr int kIterations = 60;
  constexpr double kNear = 0.1;  // [rad]
  // Close to the minimum values differ by less than rounding, so such steps are accepted.
  const double rounding = 1e-13 * std::abs(form.constant);
  double damping = 1e-3;
  double value = form.value(A);
  double before = std::numeric_limits<double>::infinity();
  bool converges_slowly = false;
  for (int i = 0; i < kIterations; ++i) {
    const Slope slope = slope_at(form, A);
    const double added_damping = damping * slope.gauss_newton.trace() / 3.0;
    const Vector3d step =
        converges_slowly
            ? newton_step(slope, added_damping)
            : Vector3d(-(slope.gauss_newton + added_damping * Matrix3d::Identity()).inverse() * slope.gradient);
    if (!step.allFinite()) {
      break;
    }
    const Matrix3d candidate = A * rotation_exp(step);
    const double candidate_value = form.value(candidate);
    if (candidate_value <= value + rounding) {
      A = candidate;
      if (is_known(A, found)) {
        break;
      }
      value = candidate_value;
      damping *= 0.1;
    } else {
      damping *= 10.0;
    }
    const double length = step.norm();
    converges_slowly = converges_slowly || (length < kNear && length > 0.5 * before);
    before = length;
    if (length < tolerance || damping > 1e12) {
      break;
    }
  }
  return A;
}

Matrix3d nearest_rotation(const Matrix3d& M) {
  const Eigen::JacobiSVD<Matrix3d> svd(M, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix3d U = svd.matrixU();
  if ((U * svd.matrixV().transpose()).determinant() < 0.0) {
    U.col(2) *= -1.0;
  }
  return U * svd.matrixV().transpose();
}

struct RotationMinimum {
  Matrix3d A = Matrix3d::Identity();
  double value = std::numeric_limits<double>::infinity();
  double second = std::numeric_limits<double>::infinity();  // value of the second best minimum
};

RotationMinimum minimise(const RotationForm& form) {
  static const std::vector<Matrix3d> cube = cube_rotations();
  std::vector<Matrix3d> starts = cube;
  const Vector9d unconstrained = form.Q.ldlt().solve(form.b);
  if (unconstrained.allFinite()) {
    starts.push_back(nearest_rotation(Eigen::Map<const Matrix3d>(unconstrained.data())));
  }
  // Several starts lead to each minimum; usually only the first of them is followed to its end.
  std::vector<Matrix3d> found;
  RotationMinimum best;
  for (const Matrix3d& start : starts) {
    Matrix3d A = descend(form, start, 1e-2, found);
    if (is_known(A, found)) {
      continue;
    }
    A = descend(form, A, 1e-14);
    const double value = form.value(A);
    if (!is_known(A, found)) {
      found.push_back(A);
      best.second = std::min(best.second, std::max(best.value, value));
    }
    if (value < best.value) {
      best.value = value;
      best.A = A;
    }
  }
  return best;
}

constexpr double kUsualTargetDistance = 0.1;  // [m] prior distance of a target from the flange
constexpr double kTurn = 0.1;                 // [rad]

// The form with its minimum. If the tool hardly turns, translations of base and targets are nearly equivalent, and
// small misfits move both by kilometres. The targets then have a prior about the flange, scaled by the misfit u (mean
// square of a whitened coordinate): sum w |r|^2 + u |t|^2 / L^2. Undetermined directions stay small, and determined
// ones are changed by a relative amount below u / (L^2 w lambda) for the smallest eigenvalue lambda.
struct Solution {
  RotationForm form;
  RotationMinimum minimum;
  double ridge = 0.0;
  bool weakly_determined = false;  // whether base and targets are uncertain by more than kUsualTargetDistance / 3
  int places = 0;                  // number of such directions
  int rotations = 0;               // directions in which the base's rotation is uncertain by more than kTurn
};

// Number of directions in which the measurements do not determine the rotation A. u: mean square of a whitened
// coordinate's misfit. Points that hardly move relative to the flange count as undetermined.
int count_undetermined_rotations(const Sums& sums, const RotationForm& free, const Matrix3d& A, double u) {
  constexpr double kNumerical = 1e-10;
  constexpr double kStandsStill = 0.05;  // share of the flange's motion
  const double flange = std::max(sums.pp - sums.p.squaredNorm() / sums.weight, 0.0);
  const Vector3d information = eigenvalues(slope_at(free, A).hessian);
  const double least = std::max(std::min(u / (kTurn * kTurn), kStandsStill * kStandsStill * flange),
                                kNumerical * std::max({information[2], sums.zz.trace(), flange}));
  return static_cast<int>((information.array() <= least).count());
}

Solution solve(const Sums& sums) {
  constexpr double kFirm = 1e-2;  // value for orientations that differ by about six degrees
  constexpr double kNumerical = 1e-13;
  Solution solution{.form = eliminate(sums, 0.0), .minimum = {}};
  const auto misfit = [&](const RotationMinimum& minimum) { return std::max(minimum.value, 0.0) / (3.0 * sums.count); };
  if (solution.form.relative_information[0] > kFirm) {
    solution.minimum = minimise(solution.form);
    solution.rotations =
        count_undetermined_rotations(sums, solution.form, solution.minimum.A, misfit(solution.minimum));
    return solution;
  }
  const Vector3d relative_information = solution.form.relative_information.cwiseMax(0.0);
  const double numerical = kNumerical * sums.weight;
  const RotationForm free = eliminate(sums, numerical);
  const double u = misfit(minimise(free));
  solution.ridge = std::max(u / (kUsualTargetDistance * kUsualTargetDistance), numerical);
  solution.form = eliminate(sums, solution.ridge);
  solution.minimum = minimise(solution.form);
  solution.rotations = count_undetermined_rotations(sums, free, solution.minimum.A, u);
  const double firm = 9.0 * u / (kUsualTargetDistance * kUsualTargetDistance * sums.weight);
  solution.places = static_cast<int>((relative_information.array() <= std::max(firm, kNumerical)).count());
  // Directions that no measurement of this robot could determine (e.g. the target height of a planar one) do not count.
  solution.weakly_determined = relative_information[0] > kNumerical && relative_information[0] < firm;
  return solution;
}

std::string ambiguity(const Solution& solution, double weight) {
  const RotationMinimum& minimum = solution.minimum;
  if (solution.weakly_determined) {
    return "the tool hardly turns: where base and targets are is not determined along every direction; the "
           "targets were kept near the flange";
  }
  if (solution.rotations > 0) {
    return solution.rotations == 3 ? "the measured points hardly move: they do not determine the rotation of the base"
                                   : "the configurations leave a rotation of the base undetermined";
  }
  const double rms = std::sqrt(std::max(minimum.value, 0.0) / weight);
  const double other = std::sqrt(std::max(minimum.second, 0.0) / weight);
  if (other < 1.5 * rms + 1e-9) {
    return "two poses of the base explain the measurements equally well";
  }
  return {};
}

}  // namespace

std::vector<Matrix3d> cube_rotations() {
  std::vector<Matrix3d> rotations;
  std::array<int, 3> order = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Matrix3d R = Matrix3d::Zero();
      for (int axis = 0; axis < 3; ++axis) {
        const bool negative = ((static_cast<unsigned>(signs) >> static_cast<unsigned>(axis)) & 1U) != 0U;
        R(order[static_cast<std::size_t>(axis)], axis) = negative ? -1.0 : 1.0;
      }
      if (R.determinant() > 0.0) {
        rotations.push_back(R);
      }
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return rotations;
}

Registration register_points(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& points,
                             const RegistrationOptions& options) {
  std::vector<const TargetFrame*> known;
  for (const std::string& name : points.targets) {
    known.push_back(find_target(options.known.targets, name));
  }
  const Sums sums = accumulate(X_BF, points, options, known);
  Registration result;
  Matrix3d A = Matrix3d::Identity();
  Vector3d c = Vector3d::Zero();  // for the centred measurements
  double ridge = 0.0;
  Eigen::Isometry3d& X_WB = result.frames.base();
  if (const auto* given = find_base(options.known.bases, points.stations.front()); given != nullptr) {
    X_WB = *given;
    A = X_WB.linear().transpose();
    c = A * (X_WB.translation() - sums.z_mean);
  } else {
    const Solution solution = solve(sums);
    const RotationForm& form = solution.form;
    ridge = solution.ridge;
    A = solution.minimum.A;
    c = form.c_matrix * Eigen::Map<const Vector9d>(A.data()) + form.c_vector;
    X_WB.linear() = A.transpose();
    X_WB.translation() = A.transpose() * c + sums.z_mean;
    result.message = ambiguity(solution, sums.weight);
    result.undetermined = solution.places + solution.rotations;
    result.ambiguous = !result.message.empty();
  }
  for (std::size_t k = 0; k < points.targets.size(); ++k) {
    const TargetSums& target = sums.targets[k];
    TargetFrame frame{.name = points.targets[k]};
    frame.with_orientation = target.orientation_weight > 0.0;
    if (known[k] != nullptr) {
      frame.X_FT = known[k]->X_FT;
    } else {
      const Eigen::Map<const Vector9d> theta(A.data());
      if (target.weight > 0.0) {
        frame.X_FT.translation() =
            (target.Rt_z * theta - target.R.transpose() * c - target.Rt_p) / (target.weight + ridge);
      }
      if (frame.with_orientation) {
        const Vector9d sum = target.Rt_Z * theta;
        frame.X_FT.linear() = nearest_rotation(Eigen::Map<const Matrix3d>(sum.data()));
      }
    }
    result.frames.targets.push_back(frame);
  }
  return result;
}

double least_misfit(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements) {
  constexpr double kRidge = 1e-10;  // relative to the form; keeps undetermined matrices small
  constexpr double kRounding = 1e-13;
  Measurements points = without_orientations(*TrainingRows(measurements));
  for (Observation& observation : points.observations) {
    observation.sigma = 0.0;
  }
  const Sums sums = accumulate(X_BF, points, {}, std::vector<const TargetFrame*>(points.targets.size(), nullptr));
  const RotationForm form = eliminate(sums, 0.0);
  // |A|^2 = 3 for rotations, so the ridge adds a known constant.
  const double ridge = kRidge * form.Q.trace();
  const Vector9d theta = (form.Q + ridge * Matrix9d::Identity()).ldlt().solve(form.b);
  const double least = form.constant - form.b.dot(theta) - 3.0 * ridge - kRounding * sums.pp;
  return least > 0.0 ? std::sqrt(least / sums.count) : 0.0;
}

}  // namespace kdl_calibration
