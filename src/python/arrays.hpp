#pragma once

// Arrays of numpy in and out. Eigen's n x N columns are numpy's N x n rows: the same memory.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <utility>
#include <vector>

namespace kdl_calibration::python {

namespace py = pybind11;

using Doubles = py::array_t<double, py::array::c_style>;

/// The object as an array of doubles, without a copy if it is one in C order. Throws TypeError if its elements are no
/// integers or floating-point numbers; `name` is that of the argument.
Doubles doubles(const py::handle& object, const std::string& name);

/// (N, columns) or, for one row, (columns,).
class Rows {
public:
  /// Throws InputError for another shape.
  Rows(const py::handle& object, std::size_t columns, const std::string& name);

  Eigen::Index count() const { return count_; }
  bool is_single() const { return is_single_; }
  /// columns x N.
  Eigen::Map<const Eigen::MatrixXd> transposed() const { return {array_.data(), columns_, count_}; }
  auto row(std::size_t i) const { return transposed().col(static_cast<Eigen::Index>(i)); }
  /// The shape of results with `rest` for each row: (N, rest...) or (rest...).
  std::vector<py::ssize_t> shape_with(std::vector<py::ssize_t> rest) const;

private:
  Doubles array_;
  Eigen::Index columns_ = 0;
  Eigen::Index count_ = 0;
  bool is_single_ = false;
};

/// An array of three numbers, or homogeneous 4 x 4. Throws InputError for another shape, and for a matrix that is no
/// rotation and translation (to 1e-9).
Eigen::Vector3d vector3(const py::handle& object, const std::string& name);
Eigen::Isometry3d pose(const py::handle& object, const std::string& name);

/// 4 x 4.
py::array pose_array(const Eigen::Isometry3d& pose);
/// Copies `pose` to 16 numbers in C order.
void write_pose(const Eigen::Isometry3d& pose, double* to);

/// A view of the transposed columns of `matrix` that keeps `owner` alive and cannot be written.
py::array transposed_view(const Eigen::MatrixXd& matrix, const py::handle& owner);

/// A structured array with these columns, each of `rows` elements.
py::array structured(const std::vector<std::pair<std::string, py::array>>& columns, py::ssize_t rows);

/// An array of text.
py::array text_array(const std::vector<std::string>& texts);

}  // namespace kdl_calibration::python
