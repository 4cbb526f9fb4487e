#include "cli/identification_csv.hpp"

#include "base/csv.hpp"
#include "base/number_text.hpp"
#include "two_step/identification_jacobian.hpp"

namespace kdl_calibration::cli {
namespace {

// Whether a column of A is an angle, by its name.
bool is_angle(const std::string& name) { return name.compare(0, 4, "phi_") == 0; }

// Column names with units: derivatives of a length by a length or an angle.
std::vector<std::string> column_headings(const IdentificationAt& at) {
  std::vector<std::string> headings;
  for (const Unknown& unknown : at.free.columns()) {
    headings.push_back(unknown.name + (unknown.length ? "[m/m]" : "[m/rad]"));
  }
  for (const std::string& name : base_and_tool_names(at.estimate.frames.targets)) {
    headings.push_back(name + (is_angle(name) ? "[m/rad]" : "[m/m]"));
  }
  return headings;
}

Json rows_json(const Eigen::MatrixXd& matrix) {
  Json rows = Json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    const Eigen::VectorXd row = matrix.row(r);
    rows.push_back(std::vector<double>(row.begin(), row.end()));
  }
  return rows;
}

}  // namespace

std::string identification_csv(const IdentificationAt& at) {
  std::string csv = "configuration,target,axis";
  for (const std::string& heading : column_headings(at)) {
    csv += "," + csv_field(heading);
  }
  csv += "\n";
  for (Eigen::Index c = 0; c < at.joint_values.cols(); ++c) {
    const Eigen::MatrixXd J = identification_jacobian(at.model, at.estimate, at.free, at.joint_values.col(c));
    const Eigen::MatrixXd A = base_and_tool_matrix(at.model, at.estimate, at.joint_values.col(c));
    for (Eigen::Index row = 0; row < J.rows(); ++row) {
      csv += csv_field(at.configurations[static_cast<std::size_t>(c)]) + "," +
             csv_field(at.estimate.frames.targets[static_cast<std::size_t>(row / 3)].name) + "," +
             std::string(1, static_cast<char>('x' + row % 3));
      for (const Eigen::MatrixXd* matrix : {&J, &A}) {
        for (const double value : matrix->row(row)) {
          csv += "," + shortest(value);
        }
      }
      csv += "\n";
    }
  }
  return csv;
}

Json identification_json(const IdentificationAt& at) {
  Json targets = Json::array();
  for (const TargetFrame& target : at.estimate.frames.targets) {
    targets.push_back(target_json(target));
  }
  Json configurations = Json::array();
  for (Eigen::Index c = 0; c < at.joint_values.cols(); ++c) {
    const Eigen::VectorXd q = at.joint_values.col(c);
    configurations.push_back({{"configuration", at.configurations[static_cast<std::size_t>(c)]},
                              {"jacobian", rows_json(identification_jacobian(at.model, at.estimate, at.free, q))},
                              {"A", rows_json(base_and_tool_matrix(at.model, at.estimate, q))}});
  }
  return {{"columns", at.free.names()},
          {"A_columns", base_and_tool_names(at.estimate.frames.targets)},
          {"targets", targets},
          {"configurations", configurations}};
}

}  // namespace kdl_calibration::cli
