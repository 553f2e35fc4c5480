// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A header and what follows it in one piece of memory, behind one pointer: there are hundreds of
// millions of them on a site that was worked on for long.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

namespace soilvdb::inline v0 {

/// A Head, which has a member `bytes() const` that says how many it and its tail use now. Or none.
template <typename Head>
class HeapBlock {
  static_assert(std::is_trivially_copyable_v<Head>);

 public:
  HeapBlock() = default;
  HeapBlock(HeapBlock&&) = default;
  HeapBlock& operator=(HeapBlock&&) = default;
  HeapBlock(const HeapBlock& other) {
    if (other) assign(other.get(), other->bytes());
  }
  HeapBlock& operator=(const HeapBlock& other) { return *this = HeapBlock(other); }

  explicit operator bool() const { return head_ != nullptr; }
  Head* get() { return head_.get(); }
  const Head* get() const { return head_.get(); }
  Head* operator->() { return get(); }
  const Head* operator->() const { return get(); }
  void reset() { head_.reset(); }

  /// Makes it of a size, and keeps the bytes that fit. @throw std::bad_alloc
  void resize(std::size_t bytes) {
    void* grown = std::realloc(head_.get(), bytes);
    if (grown == nullptr) throw std::bad_alloc();
    static_cast<void>(head_.release());
    head_.reset(static_cast<Head*>(grown));
  }
  /// Makes it a copy of `bytes` bytes, a Head and its tail.
  void assign(const void* from, std::size_t bytes) {
    head_.reset();
    resize(bytes);
    std::memcpy(static_cast<void*>(head_.get()), from, bytes);
  }

  /// Appends its size and its bytes.
  void put(std::string& out) const {
    const std::uint32_t size = head_ ? static_cast<std::uint32_t>(head_->bytes()) : 0;
    out.append(reinterpret_cast<const char*>(&size), sizeof(size));
    out.append(reinterpret_cast<const char*>(head_.get()), size);
  }
  /// Takes it off again. @return whether it was there
  bool take(std::string_view& in) {
    std::uint32_t size = 0;
    if (in.size() < sizeof(size)) return false;
    std::memcpy(&size, in.data(), sizeof(size));
    in.remove_prefix(sizeof(size));
    reset();
    if (size == 0) return true;
    if (size < sizeof(Head) || in.size() < size) return false;
    assign(in.data(), size);
    in.remove_prefix(size);
    return head_->bytes() == size;
  }

 private:
  struct Free {
    void operator()(Head* head) const { std::free(head); }
  };
  std::unique_ptr<Head, Free> head_;
};

/// What a piece takes from the heap besides its bytes.
inline constexpr std::size_t kHeapWord = 8;

/// The size, `bytes` or more, that a piece should be of: few sizes, so that what one gives back is
/// what another asks for, and so that most changes of size need no other piece.
constexpr std::size_t heap_size(std::size_t bytes) {
  constexpr std::size_t kStep = 64;
  return (bytes + kHeapWord + kStep - 1) / kStep * kStep - kHeapWord;
}

}  // namespace soilvdb::inline v0
