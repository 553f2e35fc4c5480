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

// ---- Soil that comes to rest (core/settle) ------------------------------------------------------

/// Travel from one station, where soil comes to rest, to the next: shares of the bucket's radius,
/// and voxels at least. More: soil in front of a full bucket comes in lumps. Less: more is settled
/// that moves again at once.
inline constexpr double kStationShare = 0.1, kStationVoxels = 2;
/// Stations from one at which what a bucket left comes to rest to the next, while it digs. More:
/// soil stands too steep behind it for longer. Less: more of it slides that is moved again at once.
inline constexpr int kRestStations = 5;
/// Turn between two rows of a motion after which a bucket loses what it holds too much of, rad.
/// More: what it tips on the way depends on where updates end. Less: an update costs more.
inline constexpr double kSpillTurn = 0.05;
/// Share of a bucket's struck capacity that leaves it in a turn and comes down before the next
/// station. More: what is tipped at once hangs in the air. Less: dense rows make many small piles.
inline constexpr double kLeastSpill = 0.02;
/// A pour comes down in parts, evenly over its time: of so many cells, but no fewer and no more
/// parts than that. More: each looks at the pile anew. Fewer: a truck tips all its soil at the end.
inline constexpr double kPourCells = 400;
inline constexpr std::int64_t kLeastPourParts = 16, kMostPourParts = 128;
/// Way in plan from one station to the next that says where the body pushes soil to, radii.
inline constexpr double kLeastPush = 0.01;

/// Cells beyond what was dug, and beyond a pile, that are looked at first; more if soil comes
/// there.
inline constexpr int kWindowMargin = 8, kPourMargin = 2;
/// Cells along a side of what is looked at, 50 m at 5 cm, from which on what slides beyond does so
/// in another such square, and how many there may be.
inline constexpr int kMostWindow = 1024, kMostSlideWindows = 20;
/// Cells of a pile's radius that fit into one.
inline constexpr int kMostPile = 480;
/// Columns of chunks of which is kept what the base surface has there: 600 bytes each. Less: sites
/// with many machines ask it anew.
inline constexpr std::size_t kMostBaseColumns = 8192;
/// Cells along a side of what is looked at from which on soil that runs on beyond does so to
/// another such square. Less: piles that would fill what they run down from don't know it. More:
/// soil on long steep slopes takes longer. And how many squares there may be.
inline constexpr int kRunOnWindow = 256, kMostPourWindows = 200;
/// Cells above a column's surface, and below its bank, in which samples of it may lie: bank that
/// fills a part of a column puts its soil higher than the mean.
inline constexpr int kFillCells = 16;
/// Chunks and columns from which on they are changed in parallel.
inline constexpr std::size_t kParallelFill = 64, kParallelColumns = 400;
/// Soil slides where it drops more than repose allows by so many cells: to the next column, and to
/// the third. Heights err by 0.03 where soil was cut. Less: what counts err by slides to and
/// fro. More: heaps stand too steep.
inline constexpr double kSteepStep = 0.2, kSteepDrop = 0.08;
inline constexpr int kSteepColumns = 3;
/// What it comes to rest at is steeper than repose by so much, a quarter of a degree, so that
/// little of what counts err by slides along.
inline constexpr double kNoiseSlope = 0.005;
/// m/s2, standard.
inline constexpr double kGravity = 9.80665;
/// Cells about what was dug in which ledges are looked for first; more if they reach farther.
inline constexpr int kLedgeMargin = 4;
/// The same below it, for the ground that falls are to come to.
inline constexpr int kLedgeDepth = 2;
/// Cells below the terrain at which a column was surely dug.
inline constexpr double kDug = 0.25;
/// Times that soil comes to rest around all machines, one after the other, until none moves.
inline constexpr int kMostRests = 32;
/// Failures of a bank, one after the other at one station, before the next station goes on with it.
inline constexpr int kMostFailures = 32;
/// Change of height that is worth moving samples for, cells. Less than what a count errs by.
inline constexpr double kLeastChange = 1e-3;
/// Cells between points of a bucket that are looked at for what it stands in the way of, and how
/// far above the ground it still does: soil that is less deep there is moved by the next stroke.
inline constexpr double kObstacleStep = 0.7;
inline constexpr float kObstacleAbove = 2;

// ---- Pouring (core/settle) ----------------------------------------------------------------------

/// Drop below what repose allows from which soil runs on instead of lying there, columns' sides.
/// More: ledges stay on scarps. Less: noise of counted heights is a thousand small lips.
inline constexpr double kLooseStep = 0.25;
/// The same where soil comes over the edge of a step, columns' sides. More: soil rises above edges
/// while what it runs down to is still lower.
inline constexpr double kLooseDrop = 0.01;
/// Share of the drop between two columns that must be left when the ground on either side goes on
/// as it came: then there is a step between them with an edge to run over, else a slope. More:
/// walls are slopes and their edges half a column off. Less: slopes are stairs.
inline constexpr double kStepShare = 0.6;
/// How far loose soil with a step of its own stands above a firm edge below it, columns' sides.
/// Less: what is wrong with heights at faces, which are guessed, lifts edges.
inline constexpr double kCovered = 0.05;
/// Levels this near are one, columns' sides. More: soil poured in parts lies elsewhere than soil
/// poured at once. Less: more fronts are looked at to find a lip.
inline constexpr double kLevelStep = 1e-6;
/// Most levels that are tried for one pile, and most piles of one pour: never reached but by ground
/// that isn't any.
inline constexpr int kMostLevels = 200, kMostRuns = 10000;

// ---- Collapse of what is too steep (core/settle) ------------------------------------------------

/// Step along fluxes between columns, soil for each side of drop. The steepest mode has 32, where
/// soil flows both ways between columns, and momentum is stable up to 4/3 of its inverse. More: it
/// runs away on ground as rough as its columns. Less: more steps.
inline constexpr float kFluxStep = 1.0f / 24;
/// Drop beyond repose that counts for each side of soil on support that is steeper: how fast it
/// leaves. From 8 on it runs away, at 1 it takes longer.
inline constexpr float kDrain = 4;
/// Soil that may stay on steep support, or lack in a column until the end, sides.
inline constexpr float kFilm = 0.05f;
/// How far beyond repose a slope may be at rest, rad: half a degree; most steps until soil is where
/// they brought it and they begin again, and how often that is. Random ground 100 columns wide
/// needs 600, a wall 20. Where soil runs over brinks thousands don't bring rest, the second
/// beginning does.
inline constexpr double kRestTolerance = 0.0087;
inline constexpr int kMostSteps = 500, kMostTries = 3;
/// How far drops and fluxes may still be from each other at rest, as share of repose. More: soil
/// may have gone farther than it would.
inline constexpr float kFluxTolerance = 0.04f;
/// The same of coarser columns, of which only a start is asked, but one that is near: each side
/// there is two here.
inline constexpr double kCoarseTolerance = 0.002;
inline constexpr int kMostCoarseSteps = 300;
/// Steps after which rest is looked for, which takes as long as a step.
inline constexpr int kRestSteps = 10;
/// Columns of a side from which on coarser ones are tried first.
inline constexpr int kLeastToCoarsen = 24;
/// Share of what a column had that it may owe in the end, which rounding leaves, and times that it
/// is asked to give less before it gives nothing.
inline constexpr double kOwed = 1e-13;
inline constexpr int kMostRounds = 100;
/// Change of height at a grid's edge that counts, sides.
inline constexpr double kNoticed = 0.1;
/// Rows and columns that a thread works on at least. Less: threads wait for each other, and where
/// something else has the other core, for that.
inline constexpr int kLeastBandRows = 24, kLeastBandColumns = 3000;

}  // namespace soilvdb::inline v0
