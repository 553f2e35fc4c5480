// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The numbers that accuracy and speed hang on: what each means, its unit, why it is as it is, and
// what goes wrong if it isn't. What is part of the interface stands there: sides of chunks and
// blocks, sample points (soilvdb/base_surface.h, soilvdb/mesher.h).
#pragma once

#include <cstddef>
#include <cstdint>

namespace soilvdb::inline v0 {

// ---- Cuts -------------------------------------------------------------------------------------

/// Most that a point fixed in the world may leave the straight way in the bucket frame in a segment
/// of a path, voxels. A stroke's parabola leaves out at most 0.013 of that on a bucket of ten
/// voxels (third order; 0.017 on one of five), and the facet's kernel relies on it for what it
/// skips. More: whole samples are missed. Less: more segments, each of which looks at every voxel
/// again.
inline constexpr double kMaxBend = 0.02;
/// By which a path may leave a machine's own where rows say no more than their neighbours, voxels.
/// A tenth of what a count errs by on one cell; more shows in cuts.
inline constexpr double kPathTolerance = 1e-3;
/// Travel of a bucket's fastest corner between poses of a path, voxels. Boxes around segments are
/// as large: more looks at chunks in vain, less at each chunk too often.
inline constexpr double kPathStride = 16;
/// Distance from a soil's origin at which a bucket may be, voxels along an axis: chunks there still
/// have numbers of 21 bits. More: chunks would be taken for others.
inline constexpr double kMaxIndex = 1 << 23;
/// Chunks times strokes from which on a stroke is dug by several threads. Below it one is quicker.
inline constexpr std::size_t kParallelWork = 64;
/// Chunks in the box of a part of a path that is dug at once. More: lists grow, less: chunks that
/// several segments meet are looked for again.
inline constexpr double kPartChunks = 512;

// ---- Memory -----------------------------------------------------------------------------------

/// Share of a memory limit that paging frees at once, and of it that the base surface may hold of
/// what can be read again. Less frees a little at every update.
inline constexpr std::uint64_t kPagedShare = 8, kBaseShare = 4;
/// Bytes of distances that the surface of a soil as base surface keeps, or as much as that soil
/// takes itself. Less: distances are made again and again along a cut.
inline constexpr std::uint64_t kTileBytes = std::uint64_t{64} << 20;

// ---- Planes of cells (core/cell/cell_plane.cc) ----------------------------------------------

/// Gauss-Newton steps of a fit. Two nearly always do; a third is for starts that are 20 degrees
/// off.
inline constexpr int kFitSteps = 3;
/// Share of the samples by a plane that is wrong after one step with which there is no plane.
inline constexpr float kHopelessShare = 0.5f;
/// Share of wrong samples by the plane, and how many in one cell, with which the surface counts as
/// smooth: some everywhere for want of curvature, most at the window's corners, where a surface
/// that bends with a radius of six voxels is a fifth of a voxel off its plane. More: creases are
/// rounded off. Less: curved ground is made of facets.
inline constexpr float kSmoothShare = 0.1f;
inline constexpr int kSmoothInCell = 14;
/// Half thickness of what a fit to one side of a wall looks at, voxels: a wall one voxel thick has
/// its other side just beyond.
inline constexpr float kSideSlab = 0.5f;
/// Area that such a fit needs, voxels^2, of nine at most.
inline constexpr float kLeastSideArea = 4;
/// Most that a plane moves in a step, voxels: fits that run away are held.
inline constexpr float kMaxStep = 0.5f;
/// Samples within this of a plane that passes by a cell aren't asked one by one, voxels. More than
/// sample points come near to a cell's faces: else bits of the neighbours are missed.
inline constexpr float kFaceMargin = 0.04f;

// ---- Creases (core/cell/crease.cc) -----------------------------------------------------------

/// Planes that are tried together. Six cost 15 pairs and 20 triples; a corner has three.
inline constexpr int kMaxCandidates = 6;
/// Planes are one where their normals differ by less than 10 degrees (its cosine) and their offsets
/// by less than this, voxels.
inline constexpr float kAlikeCosine = 0.985f, kAlikeGap = 0.25f;
/// Planes farther beyond the cell than this are no candidates, voxels.
inline constexpr float kFarPlane = 1.0f;
/// Wrong samples of a neighbour that cost nothing, and at most count: it may see another surface.
inline constexpr int kFreeWrong = 2, kMaxWrong = 24;
/// Wrong samples that a further plane must save. Less: noise of counts makes creases of planes.
inline constexpr int kPlaneCost = 8;
/// A pair with so few wrong isn't made a triple; one with so many isn't a model at all.
inline constexpr int kGoodPair = 14, kUnsolved = 160;
/// Joint steps of a model's planes, their stiffness against it, voxels^2, and how far they move,
/// voxels.
inline constexpr int kRefits = 2;
inline constexpr float kStiffness = 0.6f, kMaxRefit = 0.35f;

// ---- Models of cells (core/cell/cell_models.cc) ----------------------------------------------

/// Times that creases are solved; the second time they know what their neighbours found. Each needs
/// the models one voxel farther out.
inline constexpr int kSweeps = 2;
/// Voxels from which a crease takes planes, and from which it takes the base surface's.
inline constexpr int kSight = 2;
inline constexpr float kBaseSight = 2;
/// Voxels by which more is needed farther out than models: for bends, and to conserve volumes.
inline constexpr int kBendHalo = 1, kVolumeHalo = 1;
/// Wrong samples with which a crease isn't looked at again.
inline constexpr int kExplained = 4;
/// Neighbours' normals this near (37 degrees, its cosine) tell a surface's curvature, which is held
/// to this, 1/voxel; and their spread that is needed for it, voxels^4.
inline constexpr float kBendCosine = 0.8f, kMaxCurvature = 0.4f, kLeastSpread = 0.5f;
/// Offset of the surface from a plane fitted to 27 cells, along n, voxels, for a trace of curvature
/// of 1/voxel: the mean of (u^2 + v^2) / 4 over the window. Wrong: curved floors lie too high.
inline constexpr float kWindowBend = 0.375f;
/// Most that planes shift to hold the volume of the samples around, voxels, and the area that this
/// takes, voxels^2.
inline constexpr float kMaxShift = 0.1f, kLeastArea = 1;
/// How far outside of a thin wall a voxel's centre may be and count as in it, voxels: else a wall
/// one voxel thick would be lost where both its faces run through centres. The same for slots.
inline constexpr float kTie = 0.04f;

// ---- Vertices and distances ---------------------------------------------------------------------

/// How far out of its dual cell a vertex may be, voxels; one that is held to it stays this far in.
/// More: triangles turn over.
inline constexpr float kOutside = 0.25f, kInside = 1e-3f;
/// Normals this near (14 degrees, its cosine) make no crease.
inline constexpr float kSmoothCosine = 0.97f;
/// Directions with less than this share of the largest eigenvalue are left to the mean: less sends
/// vertices along nearly flat creases.
inline constexpr float kLeastEigenvalue = 0.06f;
/// Crossings lie on a curved surface, their mean r^2 k / 2 below and their planes' middle as much
/// above it (r^2 = 1/4 the mean square distance). The chords of a mesh of that spacing want the
/// vertex k / 12 above: 5/6 of the way. Wrong: meshes of curved floors lose volume.
inline constexpr float kVolumeShare = 5.0f / 6;
/// The base surface's own distance is given where it and the contour agree so far, voxels.
inline constexpr float kAgree = 0.1f;

// ---- Comparing ----------------------------------------------------------------------------------

/// Standard deviations of counts beyond which a box surely changed.
inline constexpr double kCertain = 3;

}  // namespace soilvdb::inline v0
