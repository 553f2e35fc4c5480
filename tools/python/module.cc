// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The Python module's compiled part.
#include <pybind11/pybind11.h>

#include "soilvdb/io/error.h"
#include "soilvdb/version.h"
#include "tools/python/values.h"

PYBIND11_MODULE(_soilvdb, m) {
  // Wrong input becomes a ValueError with the program's message.
  pybind11::register_exception_translator([](std::exception_ptr error) {
    try {
      if (error) std::rethrow_exception(error);
    } catch (const soilvdb::io::InputError& e) {
      PyErr_SetString(PyExc_ValueError, e.what());
    }
  });
  m.attr("__version__") = SOILVDB_VERSION;
  soilvdb::python::bind_values(m);
  soilvdb::python::bind_site(m);
  soilvdb::python::bind_files(m);
  soilvdb::python::explain_wrong_calls(m);
}
