// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/python/arguments.h"

#include <fmt/format.h>

#include <optional>
#include <utility>

namespace soilvdb::python {
namespace {

constexpr double kRigid = 1e-6;  // tolerance for float32 rotations

std::string kind_of(const py::handle& given) {
  return py::cast<std::string>(py::type::handle_of(given).attr("__name__"));
}

bool is_list(PyObject* given) { return PyTuple_Check(given) || PyList_Check(given); }

/// A few rows of floats: NumPy would take longer to find out their shape and type.
std::optional<Array> few_rows(PyObject* given, py::ssize_t columns) {
  constexpr py::ssize_t kMost = 16;
  if (!is_list(given)) return {};
  const py::ssize_t count = PySequence_Fast_GET_SIZE(given);
  if (count == 0 || count > kMost) return {};
  Array made({count, columns});
  double* to = made.mutable_data();
  for (py::ssize_t i = 0; i < count; ++i) {
    PyObject* const row = PySequence_Fast_GET_ITEM(given, i);
    if (!is_list(row) || PySequence_Fast_GET_SIZE(row) != columns) return {};
    for (py::ssize_t k = 0; k < columns; ++k) {
      PyObject* const number = PySequence_Fast_GET_ITEM(row, k);
      if (!PyFloat_Check(number)) return {};
      *to++ = PyFloat_AS_DOUBLE(number);
    }
  }
  return made;
}

}  // namespace

py::tuple several(const py::object& given, const char* name, const char* kind) {
  const py::object iterator = py::reinterpret_steal<py::object>(PyObject_GetIter(given.ptr()));
  if (!iterator) {
    PyErr_Clear();
    throw py::type_error(
        fmt::format("{} must be a list of {}, not {}", name, kind, kind_of(given)));
  }
  return py::tuple(iterator);
}

void not_of_kind(const py::handle& given, const char* name, const char* kind) {
  throw py::type_error(fmt::format("each of {} must be {}, not {}", name, kind, kind_of(given)));
}

Array array_of(const py::handle& given, const char* name) {
  // A masked array's numbers under its mask mean nothing. NumPy's own type, which has none, is not
  // asked: that takes longer than a look at the ground.
  const bool is_plain = Py_TYPE(given.ptr()) == py::detail::npy_api::get().PyArray_Type_;
  if (!is_plain && py::isinstance<py::array>(given) && py::hasattr(given, "mask") &&
      given.attr("mask").attr("any")().cast<bool>())
    throw py::type_error(
        fmt::format("{} has masked values; fill them, for instance with nan", name));
  py::array any;
  const auto is_numbers = [&] {
    return any && std::string("fiub").find(any.dtype().kind()) != std::string::npos;
  };
  try {
    any = py::array::ensure(given);
    if (!is_numbers() && py::hasattr(given, "__dlpack__"))
      any = py::array::ensure(py::module_::import("soilvdb._arrays").attr("view_of")(given));
  } catch (const py::error_already_set&) {
  }
  if (!is_numbers()) {
    PyErr_Clear();
    throw py::type_error(fmt::format(
        "{} must be numbers, not {}", name,
        any ? "an array of " + py::cast<std::string>(py::str(any.dtype())) : kind_of(given)));
  }
  constexpr int kAligned = py::detail::npy_api::NPY_ARRAY_ALIGNED_;  // views may be unaligned
  return py::array_t<double, py::array::c_style | py::array::forcecast | kAligned>::ensure(any);
}

void numbers(const py::handle& given, const char* name, std::span<double> out) {
  // Fast path for tuples and lists of floats: an array would cost more than an update.
  if (is_list(given.ptr())) {
    const auto size = static_cast<std::size_t>(PySequence_Fast_GET_SIZE(given.ptr()));
    if (size != out.size())
      throw py::value_error(
          fmt::format("{} has {} numbers; it must have {}", name, size, out.size()));
    for (std::size_t i = 0; i < size; ++i) {
      // Converting other objects may run Python code, which may change the list.
      if (static_cast<std::size_t>(PySequence_Fast_GET_SIZE(given.ptr())) != size)
        throw py::value_error(fmt::format("{} changed while it was read", name));
      const auto item = py::reinterpret_borrow<py::object>(
          PySequence_Fast_GET_ITEM(given.ptr(), static_cast<py::ssize_t>(i)));
      out[i] = PyComplex_Check(item.ptr()) ? -1 : PyFloat_AsDouble(item.ptr());
      if (!PyComplex_Check(item.ptr()) && (out[i] != -1 || PyErr_Occurred() == nullptr)) continue;
      PyErr_Clear();
      throw py::type_error(fmt::format("{} must be numbers, not {}", name, kind_of(item)));
    }
    return;
  }
  const Array array = array_of(given, name);
  if (array.ndim() != 1 || static_cast<std::size_t>(array.size()) != out.size())
    throw py::value_error(fmt::format("{} has the shape {}; it must be ({},)", name,
                                      py::cast<std::string>(py::str(array.attr("shape"))),
                                      out.size()));
  std::copy_n(array.data(), out.size(), out.data());
}

std::vector<double> numbers(const py::handle& given, const char* name) {
  const Array array = array_of(given, name);
  if (array.ndim() != 1)
    throw py::value_error(fmt::format("{} has the shape {}; it must be (N,)", name,
                                      py::cast<std::string>(py::str(array.attr("shape")))));
  return {array.data(), array.data() + array.size()};
}

Array rows(const py::handle& given, const char* name, py::ssize_t columns) {
  if (std::optional<Array> few = few_rows(given.ptr(), columns)) return *std::move(few);
  const Array array = array_of(given, name);
  if (array.ndim() == 1 && array.size() == 0)
    return Array(std::vector<py::ssize_t>{0, columns});  // []
  if (array.ndim() != 2 || array.shape(1) != columns)
    throw py::value_error(fmt::format("{} has the shape {}; it must be (N, {})", name,
                                      py::cast<std::string>(py::str(array.attr("shape"))),
                                      columns));
  return array;
}

std::vector<Vec2> places(const py::handle& given, const char* name) {
  const Array array = rows(given, name, 2);
  std::vector<Vec2> all(static_cast<std::size_t>(array.shape(0)));
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = Vec2(array.data() + 2 * i);
  return all;
}

Vec3 vector3(const py::handle& given, const char* name) {
  Vec3 v;
  numbers(given, name, {v.data(), 3});
  return v;
}

Eigen::Quaterniond quaternion(std::span<const double> xyzw) {
  return {xyzw[3], xyzw[0], xyzw[1], xyzw[2]};
}

Pose pose_of(std::span<const double> matrix) {
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> m(matrix.data());
  const Eigen::Matrix3d axes = m.topLeftCorner<3, 3>();
  const bool rigid = m.allFinite() && (axes * axes.transpose()).isIdentity(kRigid) &&
                     axes.determinant() > 0 && m.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1));
  if (!rigid)
    throw py::value_error(
        "pose is not a rigid transform; it needs a rotation, a position and a last row of 0 0 0 1");
  return {m.topRightCorner<3, 1>(), Eigen::Quaterniond(axes).normalized()};
}

namespace {

/// Calls f(), and says of what its error is.
template <typename F>
auto of_base(const F& f) {
  try {
    return f();
  } catch (const py::value_error& e) {
    throw py::value_error(fmt::format("base: {}", e.what()));
  } catch (const py::type_error& e) {
    throw py::type_error(fmt::format("base: {}", e.what()));
  }
}

/// Is it (position, rotation)?
bool is_pair(const py::handle& given) {
  return PyTuple_Check(given.ptr()) && PyTuple_GET_SIZE(given.ptr()) == 2;
}

}  // namespace

Poses::Poses(const py::handle& given) : given_(!given.is_none()) {
  if (!given_) return;
  of_base([&] {
    const auto copy = [](const Array& array, std::vector<double>& to) {
      to.assign(array.data(), array.data() + array.size());
    };
    if (is_pair(given)) {
      const auto pair = py::reinterpret_borrow<py::tuple>(given);
      copy(rows(pair[0], "positions", 3), positions_);
      copy(rows(pair[1], "rotations", 4), turns_);
      if (positions_.size() / 3 != turns_.size() / 4)
        throw py::value_error("there must be as many rotations as positions");
      return;
    }
    const Array matrices = array_of(given, "poses");
    if (matrices.ndim() != 3 || matrices.shape(1) != 4 || matrices.shape(2) != 4)
      throw py::value_error("poses must have the shape (N, 4, 4), or be (positions, rotations)");
    copy(matrices, matrices_);
  });
}

void Poses::require(std::size_t count) const {
  const std::size_t there = matrices_.size() / 16 + positions_.size() / 3;
  if (given_ && there != count)
    throw py::value_error(fmt::format("base: there are {} poses for {} states", there, count));
}

std::optional<Pose> Poses::at(std::size_t row) const {
  if (!given_) return {};
  if (matrices_.empty())
    return Pose{Vec3(&positions_[3 * row]), quaternion(std::span(turns_).subspan(4 * row, 4))};
  return of_base([&] { return pose_of(std::span(matrices_).subspan(16 * row, 16)); });
}

std::optional<Pose> base_of(const py::handle& given) {
  if (given.is_none()) return {};
  return of_base([&] {
    if (!is_pair(given)) return pose(py::none(), py::none(), given);
    const auto pair = py::reinterpret_borrow<py::tuple>(given);
    return pose(pair[0], pair[1], py::none());
  });
}

Pose pose(const py::handle& position, const py::handle& rotation, const py::handle& matrix) {
  if (!matrix.is_none()) {
    if (!position.is_none() || !rotation.is_none())
      throw py::type_error("give either pose or position and rotation");
    const Array array = rows(matrix, "pose", 4);
    if (array.shape(0) != 4) throw py::value_error("pose must have 4 rows");
    return pose_of({array.data(), 16});
  }
  if (position.is_none()) throw py::type_error("position, pose or joints are missing");
  Pose made;
  made.position = vector3(position, "position");
  if (rotation.is_none()) return made;
  double xyzw[4];
  numbers(rotation, "rotation", xyzw);
  made.rotation = quaternion(xyzw);
  return made;
}

}  // namespace soilvdb::python
