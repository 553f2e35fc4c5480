// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The tree of the ground's grid, with its own leaf type. Slow to compile: include this header only
// where the tree itself is needed.
#pragma once

#include <openvdb/Grid.h>
#include <openvdb/tree/LeafNodeMask.h>
#include <openvdb/tree/Tree.h>
#include <openvdb/tree/ValueAccessor.h>

#include "soilvdb/ground.h"
#include "soilvdb/sample_tree_fwd.h"

namespace soilvdb::inline v0 {

/// Build type of the tree: keeps it distinct from other grid types.
struct SoilSamples {};

/// A chunk as a leaf of an OpenVDB tree.
///
/// SampleLeaf derives from the mask leaf as OpenVDB's PointDataLeafNode derives from LeafNode. To
/// OpenVDB (accessors, iterators, node managers, copies) the tree is a set of voxels, at 64 bytes
/// per chunk. A leaf of 64-bit words needs no own class but five times the memory.
///
/// A voxel is active where its cell holds any soil, even while the samples are in the swap store.
/// GroundWriter maintains this. OpenVDB's editing functions change only the mask, and prune()
/// deletes chunks of only soil or only air: the tree is therefore only accessible as const.
class SampleLeaf : public openvdb::tree::LeafNode<openvdb::ValueMask, 3> {
 public:
  using Base = openvdb::tree::LeafNode<openvdb::ValueMask, 3>;
  using LeafNodeType = SampleLeaf;
  using BuildType = SoilSamples;
  using Ptr = openvdb::SharedPtr<SampleLeaf>;
  using Coord = openvdb::Coord;

  Chunk chunk;

  SampleLeaf() = default;
  explicit SampleLeaf(const Coord& xyz, bool value = false, bool active = false)
      : Base(xyz, value, active) {
    chunk.origin = Coord3(origin().x(), origin().y(), origin().z());
  }
  SampleLeaf(openvdb::PartialCreate, const Coord& xyz, bool value = false, bool active = false)
      : SampleLeaf(xyz, value, active) {}
  template <typename Other>
  SampleLeaf(const Other& other, openvdb::TopologyCopy copy) : Base(other, copy) {}
  template <typename Other>
  SampleLeaf(const Other& other, bool background, openvdb::TopologyCopy copy)
      : Base(other, background, copy) {}
  template <typename Other>
  SampleLeaf(const Other& other, bool off, bool on, openvdb::TopologyCopy copy)
      : Base(other, off, on, copy) {}

  // The functions of the base class would return the base class.
  void addLeaf(SampleLeaf*) {}
  template <typename Accessor>
  void addLeafAndCache(SampleLeaf*, Accessor&) {}
  SampleLeaf* touchLeaf(const Coord&) { return this; }
  template <typename Accessor>
  SampleLeaf* touchLeafAndCache(const Coord&, Accessor&) {
    return this;
  }
  SampleLeaf* probeLeaf(const Coord&) { return this; }
  const SampleLeaf* probeLeaf(const Coord&) const { return this; }
  const SampleLeaf* probeConstLeaf(const Coord&) const { return this; }
  template <typename Accessor>
  SampleLeaf* probeLeafAndCache(const Coord&, Accessor&) {
    return this;
  }
  template <typename Accessor>
  const SampleLeaf* probeLeafAndCache(const Coord&, Accessor&) const {
    return this;
  }
  template <typename Accessor>
  const SampleLeaf* probeConstLeafAndCache(const Coord&, Accessor&) const {
    return this;
  }
  template <typename Node, typename Accessor>
  Node* probeNodeAndCache(const Coord&, Accessor&) {
    if constexpr (std::is_same_v<Node, SampleLeaf>) return this;
    return nullptr;
  }
  template <typename Node, typename Accessor>
  const Node* probeConstNodeAndCache(const Coord&, Accessor&) const {
    if constexpr (std::is_same_v<Node, SampleLeaf>) return this;
    return nullptr;
  }
  bool operator==(const SampleLeaf& other) const {
    return Base::operator==(other) && chunk.samples == other.chunk.samples;
  }
  bool operator!=(const SampleLeaf& other) const { return !(*this == other); }

 protected:
  using MaskOn = NodeMaskType::OnIterator;
  using MaskOff = NodeMaskType::OffIterator;
  using MaskAll = NodeMaskType::DenseIterator;
  friend class openvdb::tree::IteratorBase<MaskOn, SampleLeaf>;
  friend class openvdb::tree::IteratorBase<MaskOff, SampleLeaf>;
  friend class openvdb::tree::IteratorBase<MaskAll, SampleLeaf>;

 public:
  using ValueOnIter = ValueIter<MaskOn, SampleLeaf, const bool>;
  using ValueOnCIter = ValueIter<MaskOn, const SampleLeaf, const bool>;
  using ValueOffIter = ValueIter<MaskOff, SampleLeaf, const bool>;
  using ValueOffCIter = ValueIter<MaskOff, const SampleLeaf, const bool>;
  using ValueAllIter = ValueIter<MaskAll, SampleLeaf, const bool>;
  using ValueAllCIter = ValueIter<MaskAll, const SampleLeaf, const bool>;
  using ChildOnIter = ChildIter<MaskOn, SampleLeaf>;
  using ChildOnCIter = ChildIter<MaskOn, const SampleLeaf>;
  using ChildOffIter = ChildIter<MaskOff, SampleLeaf>;
  using ChildOffCIter = ChildIter<MaskOff, const SampleLeaf>;
  using ChildAllIter = DenseIter<SampleLeaf, bool>;
  using ChildAllCIter = DenseIter<const SampleLeaf, const bool>;

  // The iterators of OpenVDB's leaves, const and not: NAME starts at BEGIN of the mask.
#define SOILVDB_ITERATORS(NAME, BEGIN, END)                                   \
  NAME##CIter cbegin##NAME() const { return {getValueMask().BEGIN(), this}; } \
  NAME##CIter begin##NAME() const { return {getValueMask().BEGIN(), this}; }  \
  NAME##Iter begin##NAME() { return {getValueMask().BEGIN(), this}; }         \
  NAME##CIter cend##NAME() const { return {getValueMask().END(), this}; }     \
  NAME##CIter end##NAME() const { return {getValueMask().END(), this}; }      \
  NAME##Iter end##NAME() { return {getValueMask().END(), this}; }
  SOILVDB_ITERATORS(ValueOn, beginOn, endOn)
  SOILVDB_ITERATORS(ValueOff, beginOff, endOff)
  SOILVDB_ITERATORS(ValueAll, beginDense, endDense)
  SOILVDB_ITERATORS(ChildOn, endOn, endOn)  // a leaf has no children
  SOILVDB_ITERATORS(ChildOff, endOff, endOff)
  SOILVDB_ITERATORS(ChildAll, beginDense, endDense)
#undef SOILVDB_ITERATORS
};

}  // namespace soilvdb::inline v0

namespace openvdb {
OPENVDB_USE_VERSION_NAMESPACE
namespace OPENVDB_VERSION_NAME {
template <>
inline const char* typeNameAsString<soilvdb::SoilSamples>() {
  return "soil_samples";
}
namespace tree {
template <>
struct SameLeafConfig<3, soilvdb::SampleLeaf> {
  static const bool value = true;
};
}  // namespace tree
}  // namespace OPENVDB_VERSION_NAME
}  // namespace openvdb
