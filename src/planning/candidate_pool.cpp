#include "planning/candidate_pool.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "base/parallel.hpp"
#include "kdl_calibration/input_error.hpp"
#include "uncertainty/identifiability.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::MatrixXf;
using Eigen::VectorXd;
using Eigen::VectorXf;

constexpr std::size_t kCandidateBlock = 1024;  // configurations per block
constexpr Index kTasksOfWorst = 5000;
constexpr Index kSampleOfBasis = 1000;

std::string undetermined(const Experiment& experiment, const MatrixXd& joint_values) {
  const auto names = experiment.free.names();
  std::string message = "all candidates together do not determine the parameters, expected wider joint ranges";
  for (const auto& group : identifiability(PointRows(experiment).stacked(joint_values), names).tied) {
    message += "; cannot tell apart:";
    for (const std::string& name : group) {
      message += " " + name;
    }
  }
  return message;
}

}  // namespace

CandidatePool::CandidatePool(const Experiment& experiment, const MatrixXd& joint_values, const MatrixXd& given,
                             int threads)
    : rows_(experiment), joint_values_(joint_values) {
  const Index sample = std::min(kSampleOfBasis, joint_values.cols());
  const MatrixXd sampled = joint_values.leftCols(sample);
  mean_ = information(experiment, sampled) / static_cast<double>(sample);
  if (!rows_.change_basis(mean_ + given)) {
    throw InputError(undetermined(experiment, sampled.leftCols(std::min<Index>(sample, 100))));
  }
  mean_ = rows_.in_basis(mean_);
  features_.resize(joint_values.cols(), rows_.feature_count());
  parallel_blocks(static_cast<std::size_t>(size()), kCandidateBlock, threads, [&](std::size_t first, std::size_t end) {
    Eigen::RowVectorXd packed(features_.cols());
    for (auto i = static_cast<Index>(first); i < static_cast<Index>(end); ++i) {
      rows_.pack(joint_values_.col(i), packed);
      features_.row(i) = packed.cast<float>();
    }
  });
}

MatrixXf CandidatePool::traces(const std::vector<MatrixXd>& forms, Index count, int threads) const {
  MatrixXf weights(features_.cols(), static_cast<Index>(forms.size()));
  Eigen::RowVectorXf constants(weights.cols());
  for (Index k = 0; k < weights.cols(); ++k) {
    const PackedForm form = rows_.form(forms[static_cast<std::size_t>(k)]);
    weights.col(k) = form.weights.cast<float>();
    constants[k] = static_cast<float>(form.constant);
  }
  MatrixXf result(count, weights.cols());
  parallel_blocks(static_cast<std::size_t>(count), kCandidateBlock, threads, [&](std::size_t first, std::size_t end) {
    const auto n = static_cast<Index>(end - first);
    for (Index k = 0; k < weights.cols(); ++k) {
      result.col(k).segment(static_cast<Index>(first), n).noalias() =
          features_.middleRows(static_cast<Index>(first), n) * weights.col(k);
    }
  });
  result.rowwise() += constants;
  return result;
}

Tasks::Tasks(const PointRows& rows, const MatrixXd& joint_values, bool worst, int threads) : rows_(rows) {
  const Index count = worst ? std::min(kTasksOfWorst, joint_values.cols()) : joint_values.cols();
  const Index features = feature_count(rows.chain_columns());
  const std::size_t targets = rows.target_blocks().size();
  if (worst) {
    packed_.assign(targets, RowMajorXf(count, features));
  }
  // Sums per block, then over the blocks: the result does not depend on the number of threads.
  const auto blocks = (static_cast<std::size_t>(count) + kCandidateBlock - 1) / kCandidateBlock;
  std::vector<MatrixXd> sums(blocks, MatrixXd::Zero(features, static_cast<Index>(targets)));
  parallel_blocks(static_cast<std::size_t>(count), kCandidateBlock, threads, [&](std::size_t first, std::size_t end) {
    Eigen::RowVectorXd packed(features);
    for (auto i = static_cast<Index>(first); i < static_cast<Index>(end); ++i) {
      const Matrix6Xd J = rows.jacobian(joint_values.col(i));
      for (std::size_t t = 0; t < targets; ++t) {
        const MatrixXd& S = rows.target_blocks()[t].S;
        pack_features(J, S.transpose() * S, packed);
        sums[first / kCandidateBlock].col(static_cast<Index>(t)) += packed.transpose();
        if (worst) {
          packed_[t].row(i) = packed.cast<float>();
        }
      }
    }
  });
  const double each = 1.0 / (static_cast<double>(count) * static_cast<double>(targets));
  mean_ = MatrixXd::Zero(rows.columns(), rows.columns());
  for (std::size_t t = 0; t < targets; ++t) {
    VectorXd sum = VectorXd::Zero(features);
    for (const MatrixXd& block : sums) {
      sum += block.col(static_cast<Index>(t));
    }
    mean_ += unpacked_information(rows.target_blocks()[t], sum * each, each * static_cast<double>(count),
                                  rows.chain_columns());
  }
}

double Tasks::power_mean(const MatrixXd& C, double power, MatrixXd& B) const {
  const MatrixXd v = variances(C);
  const double largest = v.maxCoeff();
  const MatrixXd relative = v / largest;
  const double mean = relative.array().pow(power).mean();
  const MatrixXd w =
      relative.array().pow(power - 1.0) * (std::pow(mean, 1.0 / power - 1.0) / static_cast<double>(v.size()));
  B = MatrixXd::Zero(C.rows(), C.cols());
  for (std::size_t t = 0; t < packed_.size(); ++t) {
    const VectorXd of_target = w.col(static_cast<Index>(t));
    const VectorXf sum = packed_[t].transpose() * of_target.cast<float>();
    B += unpacked_information(rows_.target_blocks()[t], sum.cast<double>(), of_target.sum(), rows_.chain_columns());
  }
  return largest * std::pow(mean, 1.0 / power);
}

MatrixXd Tasks::variances(const MatrixXd& C) const {
  MatrixXd v(packed_.front().rows(), static_cast<Index>(packed_.size()));
  for (std::size_t t = 0; t < packed_.size(); ++t) {
    const PackedForm form = packed_form(rows_.target_blocks()[t], C, rows_.chain_columns());
    const VectorXf part = packed_[t] * form.weights.cast<float>();
    v.col(static_cast<Index>(t)) = part.cast<double>().array() + form.constant;
  }
  return v;
}

}  // namespace kdl_calibration
