// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Checks numbers and arrays from Python; messages are one line that names the argument.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::python {

namespace py = pybind11;

/// C-contiguous doubles; may share the caller's memory.
using Array = py::array_t<double, py::array::c_style>;

/// The items of an iterable. @throw py::type_error naming the argument and the required type
py::tuple several(const py::object& given, const char* name, const char* kind);
/// @throw py::type_error that an item has another type
[[noreturn]] void not_of_kind(const py::handle& given, const char* name, const char* kind);

/// Doubles of an array or nested sequence of numbers. @throw py::type_error naming the argument
Array array_of(const py::handle& given, const char* name);

/// Numbers of a sequence or of a one-dimensional array.
/// @throw py::value_error, py::type_error naming the argument
std::vector<double> numbers(const py::handle& given, const char* name);
/// As above, with exactly out.size() numbers.
void numbers(const py::handle& given, const char* name, std::span<double> out);

/// An array of shape (N, columns), converted to doubles if necessary. @throw as numbers()
Array rows(const py::handle& given, const char* name, py::ssize_t columns);

/// The rows of an array of shape (N, 2). @throw as numbers()
std::vector<Vec2> places(const py::handle& given, const char* name);
Vec3 vector3(const py::handle& given, const char* name);
/// A pose from a position and a rotation (x, y, z, w; None: no rotation), or from a 4 x 4 array.
/// @throw as numbers()
Pose pose(const py::handle& position, const py::handle& rotation, const py::handle& matrix);
Eigen::Quaterniond quaternion(std::span<const double> xyzw);
/// The pose of a 4 x 4 array in row order. @throw py::value_error if it is no rigid transform
Pose pose_of(std::span<const double> matrix);

/// Poses of a machine's base, copied: (N, 4, 4), or (positions, rotations), (N, 3) and (N, 4).
class Poses {
 public:
  Poses() = default;
  /// @param given None: no poses
  explicit Poses(const py::handle& given);
  /// @param count the number of poses that there must be
  void require(std::size_t count) const;
  /// The pose of a row; empty if there are none. @throw py::value_error for a pose that is none
  std::optional<Pose> at(std::size_t row) const;

 private:
  bool given_ = false;
  std::vector<double> matrices_, positions_, turns_;
};
/// One such pose: (4, 4), or (position, rotation); empty for None.
std::optional<Pose> base_of(const py::handle& given);

/// Issues a Python warning for each line.
inline void warn(const std::vector<std::string>& lines) {
  for (const std::string& line : lines)
    if (PyErr_WarnEx(PyExc_UserWarning, line.c_str(), 1) != 0) throw py::error_already_set();
}

}  // namespace soilvdb::python
