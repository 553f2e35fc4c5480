// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Forward declarations of the ground's grid and tree: OpenVDB's headers are slow to compile.
#pragma once

#include <openvdb/version.h>

#include <cstdint>

namespace openvdb {
OPENVDB_USE_VERSION_NAMESPACE
namespace OPENVDB_VERSION_NAME {
namespace tree {
template <typename Root>
class Tree;
template <typename Child>
class RootNode;
template <typename Child, std::uint32_t Log2Dim>
class InternalNode;
}  // namespace tree
template <typename Tree>
class Grid;
}  // namespace OPENVDB_VERSION_NAME
}  // namespace openvdb

namespace soilvdb::inline v0 {

class SampleLeaf;  // soilvdb/sample_tree.h

/// Nodes of 256, 32 and 8 voxels per side. Of all measured sizes they need the least memory for
/// scattered digs: a twentieth to a fortieth of OpenVDB's usual 5, 4, 3.
using SampleLower = openvdb::tree::InternalNode<SampleLeaf, 2>;
using SampleUpper = openvdb::tree::InternalNode<SampleLower, 3>;
using SampleTree = openvdb::tree::Tree<openvdb::tree::RootNode<SampleUpper>>;
using SampleGrid = openvdb::Grid<SampleTree>;

}  // namespace soilvdb::inline v0
