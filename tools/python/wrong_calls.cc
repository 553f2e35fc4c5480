// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One-line messages about wrong arguments, by soilvdb/_wrong_calls.py.
#include "tools/python/values.h"

namespace soilvdb::python {
namespace {

namespace py = pybind11;

PyCFunctionWithKeywords dispatch = nullptr;  // pybind11's own, shared by all functions

void explain_call(PyObject* arguments, PyObject* named) {
  py::error_already_set error;  // takes the pending error
  const std::string text = py::cast<std::string>(py::str(error.value()));
  if (text.find("(): incompatible ") == std::string::npos) return error.restore();
  const py::dict by_name = named != nullptr ? py::reinterpret_borrow<py::dict>(named) : py::dict();
  const py::object line = py::module_::import("soilvdb._wrong_calls")
                              .attr("explain")(text, py::handle(arguments), by_name);
  PyErr_SetObject(PyExc_TypeError, line.ptr());
}

PyObject* call(PyObject* function, PyObject* arguments, PyObject* named) {
  PyObject* const result = dispatch(function, arguments, named);
  if (result != nullptr || PyErr_ExceptionMatches(PyExc_TypeError) == 0) return result;
  try {
    explain_call(arguments, named);
  } catch (py::error_already_set& e) {
    e.restore();
  } catch (const std::exception& e) {
    PyErr_SetString(PyExc_TypeError, e.what());
  }
  return nullptr;
}

void replace(py::handle member) {
  if (PyInstanceMethod_Check(member.ptr())) member = PyInstanceMethod_GET_FUNCTION(member.ptr());
  py::object function = py::reinterpret_borrow<py::object>(member);
  if (py::isinstance<py::staticmethod>(function)) function = function.attr("__func__");
  if (!PyCFunction_Check(function.ptr())) return;
  PyMethodDef& definition = *reinterpret_cast<PyCFunctionObject*>(function.ptr())->m_ml;
  if (definition.ml_flags != (METH_VARARGS | METH_KEYWORDS)) return;
  const auto old =
      reinterpret_cast<PyCFunctionWithKeywords>(reinterpret_cast<void (*)()>(definition.ml_meth));
  if (dispatch == nullptr) dispatch = old;
  if (old != dispatch) return;
  definition.ml_meth = reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(&call));
}

}  // namespace

void explain_wrong_calls(py::module_& m) {
  for (const auto& [name, member] : py::cast<py::dict>(m.attr("__dict__"))) {
    replace(member);
    if (!PyType_Check(member.ptr())) continue;
    for (const py::handle& one : py::list(member.attr("__dict__").attr("values")())) replace(one);
  }
}

}  // namespace soilvdb::python
