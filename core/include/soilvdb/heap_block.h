// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A header and its tail in one allocation behind one pointer: a large site has hundreds of
// millions.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

namespace soilvdb::inline v0 {

/// A Head and its tail, or null. Copies share the block until one of them changes it. Threads may
/// copy, change and destroy their own HeapBlocks, even if these share one block.
///
/// Head must begin with `std::uint32_t owners`, which HeapBlock manages; it must be 1 in an
/// assigned Head. `bytes() const` must return the current size of Head and tail.
template <typename Head>
class HeapBlock {
  static_assert(std::is_trivially_copyable_v<Head> && std::is_standard_layout_v<Head>);

 public:
  HeapBlock() = default;
  HeapBlock(HeapBlock&& other) noexcept : head_(std::exchange(other.head_, nullptr)) {}
  HeapBlock(const HeapBlock& other) noexcept : head_(other.head_) {
    if (head_ != nullptr) owners().fetch_add(1, std::memory_order_relaxed);
  }
  HeapBlock& operator=(HeapBlock other) noexcept {
    std::swap(head_, other.head_);
    return *this;
  }
  ~HeapBlock() { reset(); }

  explicit operator bool() const { return head_ != nullptr; }
  const Head* get() const { return head_; }
  const Head* operator->() const { return head_; }

  /// The Head for writing; its block is no longer shared. @throw std::bad_alloc
  Head* own() {
    if (shared()) resize(head_->bytes());
    return head_;
  }
  /// Resizes to an unshared block and keeps the bytes that fit. @throw std::bad_alloc
  void resize(std::size_t bytes) {
    const bool alone = head_ != nullptr && !shared();
    void* const memory = alone ? std::realloc(head_, bytes) : std::malloc(bytes);
    if (memory == nullptr) throw std::bad_alloc();
    if (alone) {
      head_ = static_cast<Head*>(memory);
      return;
    }
    Head* const made = ::new (memory) Head{};
    made->owners = 1;
    if (head_ != nullptr) fill(made, behind_owners(head_), std::min(bytes, head_->bytes()));
    reset();
    head_ = made;
  }
  void reset() noexcept {
    Head* const head = std::exchange(head_, nullptr);
    if (head == nullptr) return;
    std::atomic_ref<std::uint32_t> owners(head->owners);
    // Most blocks have one owner: a plain load avoids a locked instruction.
    if (owners.load(std::memory_order_acquire) == 1 ||
        owners.fetch_sub(1, std::memory_order_acq_rel) == 1)
      std::free(head);
  }

  /// Appends the size and the bytes.
  void put(std::string& out) const {
    const std::uint32_t size = head_ ? static_cast<std::uint32_t>(head_->bytes()) : 0, one = 1;
    out.append(reinterpret_cast<const char*>(&size), sizeof(size));
    if (size == 0) return;
    out.append(reinterpret_cast<const char*>(&one), sizeof(one));
    out.append(behind_owners(head_), size - sizeof(one));
  }
  /// Reads and removes the output of put() from `in`. @return false if `in` is invalid
  bool take(std::string_view& in) {
    std::uint32_t size = 0;
    if (in.size() < sizeof(size)) return false;
    std::memcpy(&size, in.data(), sizeof(size));
    in.remove_prefix(sizeof(size));
    reset();
    if (size == 0) return true;
    if (size < sizeof(Head) || in.size() < size) return false;
    resize(size);
    fill(head_, in.data() + kOwners, size);
    in.remove_prefix(size);
    return head_->bytes() == size;
  }

 private:
  static constexpr std::size_t kOwners = sizeof(std::uint32_t);

  std::atomic_ref<std::uint32_t> owners() const {
    static_assert(offsetof(Head, owners) == 0);
    return std::atomic_ref<std::uint32_t>(head_->owners);
  }
  /// Acquire: reads by former owners must happen before changes.
  bool shared() const { return owners().load(std::memory_order_acquire) != 1; }
  /// All bytes but the count, which other threads may change.
  static char* behind_owners(Head* head) { return reinterpret_cast<char*>(head) + kOwners; }
  static void fill(Head* head, const char* from, std::size_t bytes) {
    std::memcpy(behind_owners(head), from, bytes - kOwners);
  }

  Head* head_ = nullptr;
};

/// Heap overhead of an allocation, bytes.
inline constexpr std::size_t kHeapWord = 8;

/// The allocation size to use for `bytes` or more. Few sizes let allocations reuse freed ones and
/// let most resizes stay in place.
constexpr std::size_t heap_size(std::size_t bytes) {
  constexpr std::size_t kStep = 64;
  return (bytes + kHeapWord + kStep - 1) / kStep * kStep - kHeapWord;
}

}  // namespace soilvdb::inline v0
