#include "python/arrays.hpp"

#include <algorithm>
#include <string_view>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

namespace {

std::string shape_of(const py::array& array) { return py::str(array.attr("shape")); }

[[noreturn]] void refuse_shape(const std::string& name, const py::array& array, const std::string& expected) {
  throw InputError(name + ": an array of shape " + shape_of(array) + ", expected " + expected);
}

}  // namespace

Doubles doubles(const py::handle& object, const std::string& name) {
  // Arrays without a mask are asked for nothing more: functions of the caller's own come here often.
  if (py::hasattr(object, "mask") && py::module_::import("numpy.ma").attr("is_masked")(object).cast<bool>()) {
    throw InputError(name + ": masked values, expected numbers");
  }
  const py::array array = py::array::ensure(object);
  if (!array) {
    PyErr_Clear();
    throw py::type_error(name + ": no array, expected one of numbers");
  }
  constexpr std::string_view kNumbers = "iuf";
  if (kNumbers.find(array.dtype().kind()) == std::string_view::npos) {
    throw py::type_error(name + ": an array of " + std::string(py::str(array.dtype())) +
                         ", expected one of real numbers");
  }
  return py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(array);
}

Rows::Rows(const py::handle& object, std::size_t columns, const std::string& name)
    : array_(doubles(object, name)), columns_(static_cast<Eigen::Index>(columns)) {
  const py::ssize_t last = array_.ndim() == 0 ? 0 : array_.shape(array_.ndim() - 1);
  if ((array_.ndim() != 1 && array_.ndim() != 2) || last != columns_) {
    const std::string width = std::to_string(columns);
    refuse_shape(name, array_, "(N, " + width + ") or (" + width + ",)");
  }
  is_single_ = array_.ndim() == 1;
  count_ = is_single_ ? 1 : array_.shape(0);
}

std::vector<py::ssize_t> Rows::shape_with(std::vector<py::ssize_t> rest) const {
  if (!is_single_) {
    rest.insert(rest.begin(), count_);
  }
  return rest;
}

Eigen::Vector3d vector3(const py::handle& object, const std::string& name) {
  const Doubles array = doubles(object, name);
  if (array.ndim() != 1 || array.shape(0) != 3) {
    refuse_shape(name, array, "(3,)");
  }
  return Eigen::Map<const Eigen::Vector3d>(array.data());
}

Eigen::Isometry3d pose(const py::handle& object, const std::string& name) {
  const Doubles array = doubles(object, name);
  if (array.ndim() != 2 || array.shape(0) != 4 || array.shape(1) != 4) {
    refuse_shape(name, array, "(4, 4)");
  }
  constexpr double kRounding = 1e-9;
  using Matrix4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
  const Matrix4 matrix = Eigen::Map<const Matrix4>(array.data());
  const Eigen::Matrix3d R = matrix.topLeftCorner<3, 3>();
  if (!matrix.allFinite() || !R.isUnitary(kRounding) || R.determinant() < 0.0 ||
      matrix.row(3) != Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0)) {
    throw InputError(name + ": a matrix that is no rotation and translation, expected one with rows [R t; 0 0 0 1]");
  }
  return Eigen::Isometry3d(Eigen::Matrix4d(matrix));
}

void write_pose(const Eigen::Isometry3d& pose, double* to) {
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>{to} = pose.matrix();
}

py::array pose_array(const Eigen::Isometry3d& pose) {
  Doubles array({4, 4});
  write_pose(pose, array.mutable_data());
  return array;
}

py::array transposed_view(const Eigen::MatrixXd& matrix, const py::handle& owner) {
  Doubles array({matrix.cols(), matrix.rows()}, matrix.data(), owner);
  array.attr("flags").attr("writeable") = false;
  return array;
}

py::array text_array(const std::vector<std::string>& texts) {
  py::list list(texts.size());
  for (std::size_t i = 0; i < texts.size(); ++i) {
    list[i] = texts[i];
  }
  return py::module_::import("numpy").attr("array")(list, "dtype"_a = "U");
}

py::array structured(const std::vector<std::pair<std::string, py::array>>& columns, py::ssize_t rows) {
  py::list fields;
  for (const auto& [name, column] : columns) {
    const py::tuple shape = column.attr("shape");
    fields.append(py::make_tuple(name, column.dtype(), shape[py::slice(1, static_cast<py::ssize_t>(shape.size()), 1)]));
  }
  py::object array = py::module_::import("numpy").attr("empty")(rows, fields);
  for (const auto& [name, column] : columns) {
    array[py::str(name)] = column;
  }
  return array;
}

}  // namespace kdl_calibration::python
