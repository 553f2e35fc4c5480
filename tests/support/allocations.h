// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Counts the calls of operator new. Only one file of a program may include this.
#pragma once

#include <atomic>
#include <cstdlib>
#include <new>

namespace soilvdb::test {

inline std::atomic<std::size_t> allocations = 0;  // of this program

}  // namespace soilvdb::test

// Sanitizers have an allocator of their own.
#if !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define SOILVDB_COUNTS_ALLOCATIONS
// Not inlined: GCC would take malloc and delete for a wrong pair.
[[gnu::noinline]] void* operator new(std::size_t size) {
  ++soilvdb::test::allocations;
  if (void* const memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
#endif
