#pragma once

// Names of files between Python and C++, and texts that may hold one. A name is any bytes without NUL: Python has those
// that are not UTF-8 as surrogates (os.fsdecode).

#include <pybind11/pybind11.h>

#include <filesystem>
#include <string>

namespace kdl_calibration::python {

/// The name as os.fsdecode gives it.
inline pybind11::object file_name(const std::string& name) {
  return pybind11::reinterpret_steal<pybind11::object>(
      PyUnicode_DecodeFSDefaultAndSize(name.data(), static_cast<Py_ssize_t>(name.size())));
}

/// The bytes of such a name.
inline std::string bytes_of_name(const pybind11::handle& name) {
  const auto bytes = pybind11::reinterpret_steal<pybind11::object>(PyUnicode_EncodeFSDefault(name.ptr()));
  if (!bytes) {
    throw pybind11::error_already_set();
  }
  return pybind11::reinterpret_borrow<pybind11::bytes>(bytes);
}

/// A text for people, in which bytes that are not UTF-8 are shown as \xff.
inline pybind11::object message_text(const std::string& text) {
  return pybind11::reinterpret_steal<pybind11::object>(
      PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "backslashreplace"));
}

}  // namespace kdl_calibration::python

namespace pybind11::detail {

/// Takes str, bytes and os.PathLike. Throws ValueError for a NUL. Used instead of pybind11/stl/filesystem.h, which
/// takes such a name for no name at all.
template <>
struct type_caster<std::filesystem::path> {
  bool load(handle source, bool /*convert*/) {
    PyObject* bytes = nullptr;
    if (PyUnicode_FSConverter(source.ptr(), &bytes) == 0) {
      const bool has_nul = PyErr_ExceptionMatches(PyExc_ValueError) != 0;
      PyErr_Clear();
      if (has_nul) {
        throw value_error("the file name " + std::string(repr(source)) + " is none, expected one without NUL");
      }
      return false;
    }
    value = std::string(reinterpret_steal<pybind11::bytes>(bytes));
    return true;
  }

  PYBIND11_TYPE_CASTER(std::filesystem::path, const_name("os.PathLike"));
};

}  // namespace pybind11::detail
