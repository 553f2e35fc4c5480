#!/bin/sh
# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Kernels for newer CPUs take and return vectors in registers that other code does not use. A function
# with vectors that is called, not inlined, gives them other numbers and may write anywhere. Without
# optimisation GCC calls each function and lambda that is not SOILVDB_INLINE; its dump has their types.
#   inlined_vectors_test.sh GCC [FLAG...]   with flags to compile core
set -eu
cd "$(dirname "$0")/.."
vector='(const )?(Lanes|LaneMask|vector\(8\) (float|int))'
headers=$(grep -rl '"core/lattice/lanes.h"' core --include='*.h')
called=$({
  grep -rlF "$(printf '%s\n' core/lattice/lanes.h $headers)" core --include='*.cc' |
    sed 's/.*/#include "&"/'
  cat <<'END'   # which must be found
namespace soilvdb::inline v0 {
Lanes probe_returns(const float* v) { return lanes_at(v); }
float probe_takes(const Lanes& v, LaneMask m, float k) { return m[0] != 0 ? k : v[0]; }
float probe_calls(float k) { return [](float v) { return kLaneNumbers * v; }(k)[1]; }
}  // namespace soilvdb::inline v0
END
} | "$@" -O0 -w -Wno-psabi -x c++ - -S -o /dev/null -fdump-tree-optimized=stdout |
  awk '/^{/ { print before } { before = $0 }' |
  grep -E "^$vector |[(,] ?$vector [^ &*]+[,)]")
echo "$called" | grep -v probe_ && echo "^ must be SOILVDB_INLINE, a lambda too" && exit 1
test "$(echo "$called" | grep -c probe_)" = 3 || { echo "probes were found: $called"; exit 1; }
