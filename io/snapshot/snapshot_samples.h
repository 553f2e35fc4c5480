// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The samples of a snapshot as bytes: small, fast, and independent of the number of threads.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0::io {

/// All resident chunks, and the origins of the dropped chunks.
std::string samples_bytes(const Ground& ground, const std::vector<Coord3>& dropped);

/// Puts the chunks into a ground. @return origins of the dropped chunks
/// @throw std::exception unless the bytes come from samples_bytes().
std::vector<Coord3> restore_samples(std::string_view bytes, Ground& ground);

}  // namespace soilvdb::inline v0::io
