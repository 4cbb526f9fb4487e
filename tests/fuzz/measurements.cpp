#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/joint_convention.hpp"

#include <cstring>
#include <variant>

#include "promise.hpp"
#include "targets.hpp"

namespace kdl_calibration::fuzzing {
namespace {

const std::vector<std::string> kJoints = {"joint_1", "joint_2"};

bool same_bytes(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  const auto bytes = static_cast<std::size_t>(a.size()) * sizeof(double);
  return a.rows() == b.rows() && a.cols() == b.cols() && (bytes == 0 || std::memcmp(a.data(), b.data(), bytes) == 0);
}

// Whether the orientations, normals or distances of two readings of one kind are the same.
bool same_kind(const Reading& a, const Reading& b) {
  constexpr double kRounding = 1e-12;
  if (const auto* const pose = std::get_if<Pose>(&a)) {
    return same_bytes(pose->orientation.coeffs(), std::get<Pose>(b).orientation.coeffs());
  }
  if (const auto* const some = std::get_if<Coordinates>(&a)) {
    const auto& other = std::get<Coordinates>(b);
    return some->count == other.count && (some->normal - other.normal).norm() <= kRounding;
  }
  const auto* const distance = std::get_if<Distance>(&a);
  return distance == nullptr || distance->length == std::get<Distance>(b).length;
}

// `exactly`: also the last bits of the position, which a direction n does not keep.
bool same(const Observation& a, const Observation& b, bool exactly) {
  constexpr double kRounding = 1e-12;
  return a.configuration == b.configuration && a.target == b.target && a.repeat == b.repeat && a.split == b.split &&
         a.sigma == b.sigma && a.station == b.station && a.order == b.order && a.reading.index() == b.reading.index() &&
         same_kind(a.reading, b.reading) &&
         (exactly ? same_bytes(a.position(), b.position())
                  : (a.position() - b.position()).norm() <= kRounding * a.position().norm());
}

void check_read(const Measurements& m) {
  promise(!m.observations.empty(), "at least one row");
  promise(m.joint_values.allFinite(), "finite joint values");
  promise(m.joint_values.cols() == static_cast<Eigen::Index>(m.configurations.size()), "one column a configuration");
  for (const Observation& o : m.observations) {
    promise(o.position().allFinite() && o.sigma >= 0.0, "finite coordinates");
  }
  const Measurements again = parse_measurements(measurements_csv(m), kJoints);
  promise(again.configurations == m.configurations && again.targets == m.targets, "labels read back");
  promise(same_bytes(again.joint_values, m.joint_values), "joint values read back");
  promise(again.observations.size() == m.observations.size(), "rows read back");
  for (std::size_t row = 0; row < m.observations.size(); ++row) {
    const auto* const some = std::get_if<Coordinates>(&m.observations[row].reading);
    const bool exactly = some == nullptr || (some->normal.array() != 0.0).count() == 1;
    promise(same(m.observations[row], again.observations[row], exactly), "rows read back");
  }
  const Measurements mean = averaged(m);
  promise(mean.observations.size() <= m.observations.size(), "no more means than rows");
}

JointConvention two_joints() {
  return parse_joint_convention(
      R"({"controller_joints": ["J1", "J2"], "urdf_joints": ["joint_2", "joint_1"], "matrix": [[1, 1], [0, -2]]})");
}

}  // namespace

void measurements(std::string_view bytes) {
  static const JointConvention convention = two_joints();
  const bool controller = bytes.find("J1") != std::string_view::npos;
  let_input_errors_pass([&] { check_read(parse_measurements(bytes, kJoints, controller ? &convention : nullptr)); });
}

void joint_convention(std::string_view bytes) {
  let_input_errors_pass([&] {
    const JointConvention convention = parse_joint_convention(bytes);
    const auto size = static_cast<Eigen::Index>(convention.controller_joints.size());
    promise(convention.matrix.allFinite() && convention.offset.allFinite(), "finite numbers");
    promise(convention.matrix.rows() == size && convention.matrix.cols() == size && convention.offset.size() == size,
            "one row a joint");
    const JointConvention matched = matched_convention(convention, convention.urdf_joints);
    promise(same_bytes(matched.matrix, convention.matrix), "the same order");
  });
}

}  // namespace kdl_calibration::fuzzing
