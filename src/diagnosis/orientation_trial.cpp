#include "diagnosis/orientation_trial.hpp"

#include <fmt/core.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <span>
#include <utility>
#include <vector>

#include "base/degree.hpp"
#include "base/robust_statistics.hpp"
#include "diagnosis/trial_fit.hpp"
#include "estimation/prediction.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Quaterniond;

constexpr double kAgree = 0.1;           // [rad]
constexpr std::size_t kMostTried = 300;  // candidates for a target's orientation

struct MeantOrientation {
  Quaterniond (*meant)(const Quaterniond& read);
  const char* words;
};

using Angles = Eigen::Vector3d;

Quaterniond turned_about(double angle, const Angles& axis) { return Quaterniond(Eigen::AngleAxisd(angle, axis)); }
Quaterniond about_fixed(const Angles& v) {
  return turned_about(v[2], Angles::UnitZ()) * turned_about(v[1], Angles::UnitY()) *
         turned_about(v[0], Angles::UnitX());
}
Quaterniond about_moving(const Angles& v) {
  return turned_about(v[0], Angles::UnitX()) * turned_about(v[1], Angles::UnitY()) *
         turned_about(v[2], Angles::UnitZ());
}
Quaterniond about_own_axis(const Angles& v) { return turned_about(v.norm(), v.stableNormalized()); }

// The three numbers from which the orientation was read. The sign of a quaternion tells angles beyond half a turn.
Angles rotation_vector_of(const Quaterniond& q) {
  return 2.0 * std::atan2(q.vec().norm(), q.w()) * q.vec().stableNormalized();
}
Angles fixed_angles_of(const Quaterniond& q) {
  const Eigen::Matrix3d R = q.toRotationMatrix();
  return {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2))),
          std::atan2(R(1, 0), R(0, 0))};
}
Angles moving_angles_of(const Quaterniond& q) { return -fixed_angles_of(q.conjugate()); }

// A whole file may have been read so; single rows are inverted or reordered at most.
constexpr std::size_t kOfSingleRows = 6;

const std::array<MeantOrientation, 13>& readings() {
  static const std::array<MeantOrientation, 13> all = {
      MeantOrientation{[](const Quaterniond& q) { return q; }, ""},
      MeantOrientation{[](const Quaterniond& q) { return q.conjugate(); }, "as inverses (conjugates)"},
      MeantOrientation{[](const Quaterniond& q) { return Quaterniond(q.z(), q.w(), q.x(), q.y()); },
                       "with x, y, z, w in the columns qw, qx, qy, qz"},
      MeantOrientation{[](const Quaterniond& q) { return Quaterniond(q.z(), -q.w(), -q.x(), -q.y()); },
                       "as inverses, with x, y, z, w in the columns qw, qx, qy, qz"},
      MeantOrientation{[](const Quaterniond& q) { return Quaterniond(q.x(), q.y(), q.z(), q.w()); },
                       "with w, x, y, z in the columns qx, qy, qz, qw"},
      MeantOrientation{[](const Quaterniond& q) { return Quaterniond(q.x(), -q.y(), -q.z(), -q.w()); },
                       "as inverses, with w, x, y, z in the columns qx, qy, qz, qw"},
      MeantOrientation{[](const Quaterniond& q) { return about_fixed(rotation_vector_of(q)); },
                       "as angles about fixed axes instead of a rotation vector (--orientation fixed-xyz)"},
      MeantOrientation{[](const Quaterniond& q) { return about_moving(rotation_vector_of(q)); },
                       "as angles about moving axes instead of a rotation vector (--orientation moving-xyz)"},
      MeantOrientation{[](const Quaterniond& q) { return about_own_axis(fixed_angles_of(q)); },
                       "as a rotation vector instead of angles (--orientation rotation-vector)"},
      MeantOrientation{[](const Quaterniond& q) { return about_moving(fixed_angles_of(q)); },
                       "as angles about moving instead of fixed x, y and z (--orientation moving-xyz)"},
      MeantOrientation{[](const Quaterniond& q) { return about_own_axis(moving_angles_of(q)); },
                       "as a rotation vector instead of angles (--orientation rotation-vector)"},
      MeantOrientation{[](const Quaterniond& q) { return about_fixed(moving_angles_of(q)); },
                       "as angles about fixed instead of moving x, y and z (--orientation fixed-xyz)"},
      MeantOrientation{[](const Quaterniond& q) { return about_fixed(fixed_angles_of(q).reverse()); },
                       "as angles about x, y and z instead of z, y and x (A, B, C: --orientation fixed-xyz)"}};
  return all;
}

// A measured orientation and that of the flange.
struct Row {
  std::size_t row = 0;
  Quaterniond flange;    // in W
  Quaterniond measured;  // as read from the file

  Quaterniond of_target(const MeantOrientation& reading) const { return flange.conjugate() * reading.meant(measured); }
};

// Rows of each target.
using OrientationRows = std::vector<std::vector<Row>>;

OrientationRows rows_of(const ErrorModel& model, const Measurements& measurements, const Estimate& fit) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, fit, measurements);
  OrientationRows result(measurements.targets.size());
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Observation& observation = measurements.observations[row];
    if (observation.split == Split::train && has_orientation(observation)) {
      const auto& pose = X_BF[static_cast<std::size_t>(observation.configuration)];
      result[static_cast<std::size_t>(observation.target)].push_back(
          {.row = row,
           .flange = Quaterniond(fit.frames.base().linear() * pose.linear()),
           .measured = *observation.orientation()});
    }
  }
  return result;
}

struct Consensus {
  std::vector<Quaterniond> targets;  // orientation of each target in the flange frame
  std::size_t rows = 0;              // number of rows that agree
};

Consensus consensus(const OrientationRows& rows, const MeantOrientation& reading) {
  Consensus result;
  for (const std::vector<Row>& own : rows) {
    std::vector<Quaterniond> said;
    std::transform(own.begin(), own.end(), std::back_inserter(said),
                   [&](const Row& row) { return row.of_target(reading); });
    Quaterniond best = Quaterniond::Identity();
    std::size_t most = 0;
    const std::size_t step = said.size() / kMostTried + 1;
    for (std::size_t i = 0; i < said.size(); i += step) {
      const auto agree = static_cast<std::size_t>(std::count_if(
          said.begin(), said.end(), [&](const Quaterniond& q) { return q.angularDistance(said[i]) < kAgree; }));
      best = agree > most ? said[i] : best;
      most = std::max(most, agree);
    }
    result.targets.push_back(best);
    result.rows += most;
  }
  return result;
}

// Whether all measured orientations of a target are equal although the flange turns.
bool is_constant(const OrientationRows& rows) {
  constexpr double kStill = 1e-6;  // [rad]
  bool turns = false;
  for (const std::vector<Row>& own : rows) {
    for (const Row& row : own) {
      if (row.measured.angularDistance(own.front().measured) > kStill) {
        return false;
      }
      turns = turns || row.flange.angularDistance(own.front().flange) > kAgree;
    }
  }
  return turns;
}

std::string of_rows(std::size_t some, std::size_t all) { return fmt::format("{} of {}", some, all); }

// A row and the angle between its orientation and that of its target.
struct Off {
  const Row* row;
  std::size_t target;
  double angle;  // [rad]
};

std::vector<Off> all_off(const OrientationRows& rows, const Consensus& agreed, const MeantOrientation& reading) {
  std::vector<Off> all;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    for (const Row& row : rows[k]) {
      all.push_back({&row, k, row.of_target(reading).angularDistance(agreed.targets[k])});
    }
  }
  return all;
}

// [rad] beyond which a row is an outlier.
double limit_of(const std::vector<Off>& all) {
  constexpr double kTimes = 10.0;
  std::vector<double> agreeing;
  for (const Off& off : all) {
    if (off.angle < kAgree) {
      agreeing.push_back(off.angle);
    }
  }
  return std::max(kTimes * median(std::move(agreeing)), kDegree);
}

const std::string& configuration_of(const Measurements& measurements, const Off& off) {
  const Observation& observation = measurements.observations[off.row->row];
  return measurements.configurations[static_cast<std::size_t>(observation.configuration)];
}

std::string label(const Measurements& measurements, const Off& off) {
  return "configuration " + configuration_of(measurements, off) + ", target " + measurements.targets[off.target];
}

std::vector<Subject> subjects_of(const Measurements& measurements, const Off& off) {
  return {{SubjectKind::configuration, configuration_of(measurements, off)},
          {SubjectKind::target, measurements.targets[off.target]}};
}

std::vector<NamedFigure> share_of_rows(std::size_t some, std::size_t all) {
  return {{"count", static_cast<double>(some)}, {"out_of", static_cast<double>(all)}};
}

// For `outliers` of `count` rows: another reading that fits all of them, or else the worst row.
OrientationTrial judged(const Measurements& measurements, const Consensus& agreed, const std::vector<Off>& outliers,
                        std::size_t count, double limit) {
  const std::string what =
      "the measured orientations of " + of_rows(outliers.size(), count) + " rows do not turn with " + "the arm";
  for (const MeantOrientation& reading : std::span(readings()).first(kOfSingleRows)) {
    if (std::all_of(outliers.begin(), outliers.end(), [&](const Off& off) {
          return off.row->of_target(reading).angularDistance(agreed.targets[off.target]) <= limit;
        })) {
      return {.explained = true,
              .said = {.cause = Cause::orientations,
                       .subjects = subjects_of(measurements, outliers.front()),
                       .figures = share_of_rows(outliers.size(), count),
                       .message = what + ", from " + label(measurements, outliers.front()) +
                                  " on; they do if they are read " + reading.words + "; " + kUsedAsRead}};
    }
  }
  const Off& worst =
      *std::max_element(outliers.begin(), outliers.end(), [](const Off& a, const Off& b) { return a.angle < b.angle; });
  std::vector<NamedFigure> figures = share_of_rows(outliers.size(), count);
  figures.push_back({"angle", worst.angle});
  return {.said = {.cause = Cause::orientations,
                   .subjects = subjects_of(measurements, worst),
                   .figures = std::move(figures),
                   .message = fmt::format("{}: {} is off by {:.3g} degrees", what, label(measurements, worst),
                                          worst.angle / kDegree)}};
}

}  // namespace

std::optional<OrientationTrial> try_orientations(const ErrorModel& model, const Measurements& measurements,
                                                 const Estimate& fit) {
  const OrientationRows rows = rows_of(model, measurements, fit);
  if (is_constant(rows)) {
    return OrientationTrial{.said = {.cause = Cause::orientations,
                                     .message = "the measured orientations never change while the flange turns"}};
  }
  const MeantOrientation* usual = &readings().front();
  Consensus best = consensus(rows, *usual);
  for (const MeantOrientation& reading : readings()) {
    Consensus other = consensus(rows, reading);
    if (other.rows > best.rows) {
      best = std::move(other);
      usual = &reading;
    }
  }
  std::vector<Off> all = all_off(rows, best, *usual);
  const std::size_t count = all.size();
  if (usual != &readings().front()) {
    constexpr double kMost = 0.8;
    return OrientationTrial{
        .explained = true,
        .of_most_rows = static_cast<double>(best.rows) >= kMost * static_cast<double>(count),
        .said = {.cause = Cause::orientations,
                 .figures = share_of_rows(best.rows, count),
                 .message = "the measured orientations do not turn with the arm; " + of_rows(best.rows, count) +
                            " do if they are read " + usual->words + "; " + kUsedAsRead}};
  }
  const double limit = limit_of(all);
  std::erase_if(all, [&](const Off& off) { return off.angle <= limit; });
  return all.empty() ? std::nullopt : std::optional(judged(measurements, best, all, count, limit));
}

}  // namespace kdl_calibration
