// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers and arrays from Python, checked: what is wrong with them is one line that names them.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::python {

namespace py = pybind11;

/// C-contiguous doubles, which may be the caller's own.
using Array = py::array_t<double, py::array::c_style>;

/// What an iterable gives. @throw py::type_error naming the argument and what it must be of
py::tuple several(const py::object& given, const char* name, const char* kind);
/// @throw py::type_error that one of them isn't
[[noreturn]] void not_of_kind(const py::handle& given, const char* name, const char* kind);

/// Doubles of any array or nested sequence of numbers. @throw py::type_error naming the argument
Array array_of(const py::handle& given, const char* name);

/// Numbers from any sequence or array of one dimension.
/// @throw py::value_error, py::type_error naming the argument
std::vector<double> numbers(const py::handle& given, const char* name);
/// The same, so many of them.
void numbers(const py::handle& given, const char* name, std::span<double> out);

/// An array of shape (N, columns), converted to doubles if need be. @throw as numbers()
Array rows(const py::handle& given, const char* name, py::ssize_t columns);

Vec3 vector3(const py::handle& given, const char* name);
/// A pose from either a position with a rotation (x, y, z, w; none: not turned) or a 4 x 4 array.
/// @throw as numbers()
Pose pose(const py::handle& position, const py::handle& rotation, const py::handle& matrix);
Eigen::Quaterniond quaternion(std::span<const double> xyzw);
/// The pose that a 4 x 4 array says, row by row. @throw py::value_error if it is no rigid transform
Pose pose_of(std::span<const double> matrix);

/// Warns, as Python's own functions do, once a line.
inline void warn(const std::vector<std::string>& lines) {
  for (const std::string& line : lines)
    if (PyErr_WarnEx(PyExc_UserWarning, line.c_str(), 1) != 0) throw py::error_already_set();
}

}  // namespace soilvdb::python
