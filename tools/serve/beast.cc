// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Compiles Asio and Beast, which are slow to compile, once for all users.
#include <boost/asio/impl/src.hpp>
#include <boost/beast/src.hpp>
