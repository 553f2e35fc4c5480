// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The tuning numbers of `core`: a change of one changes accuracy, speed, memory or which branch is
// taken. A comment names the number, its unit, the reason for its value, and the harm of another
// value. Groups follow the data from input to output.
//
// Numbers of the interface stand in its headers, below include/soilvdb. Those are sides of chunks
// (initial_terrain.h) and blocks (mesher.h), sample points, the band of distances (ground.h), the
// error of a count (volume_changes.h) and steps of heap sizes (heap_block.h).
#pragma once

#include <cstddef>
#include <cstdint>

namespace soilvdb::inline v0 {

// ---- Counts (core/lattice/sample_points.cc) ----------------------------------------------------

/// Error of a count of 64 samples on a cell that a plane cuts, share of the cell: root mean square
/// over all directions of the plane, and of the worst direction.
inline constexpr double kCountError = 0.0168, kWorstCountError = 0.022;

// ---- Limits of input (core/tool, core/settle/earthmoving.cc, core/cut/tool_grid.cc) -------------

/// Smallest and largest side of a bucket, m. The largest buckets are 6 m wide. Wider limits let
/// other units pass, narrower ones refuse real buckets.
inline constexpr double kMinBucketSideM = 1e-3, kMaxBucketSideM = 100;
/// Largest number of points of a bucket's profile. The check for crossings takes the square of
/// their number.
inline constexpr std::size_t kMaxProfilePoints = 1000;
/// Distance up to which two points of a profile are the same, m: the rounding of decimal input. A
/// larger value refuses short edges, a smaller one refuses rounded ends.
inline constexpr double kSamePointM = 1e-9;
/// Largest coordinate and joint value of a motion, m or rad: beyond any site and any machine.
inline constexpr double kMaxMotionValue = 1e9;
/// Largest error of a quaternion's squared length. Input is normalised before; a smaller value
/// refuses its rounding.
inline constexpr double kMaxUnitError = 1e-3;
/// Largest number of pieces of one row of a motion. A piece is one rad or one metre of a joint. A
/// larger step is surely an error of the input, and tracing it takes forever.
inline constexpr std::size_t kMaxRowPieces = 1000;
/// Largest swell: twice the swell of any rock. A larger limit lets percents pass for shares.
inline constexpr double kMaxSwell = 3;
/// Largest coordinate of a tool's mesh in the tool's frame, m. No machine's tool is farther from
/// its frame's origin. A larger limit lets millimetres pass for metres.
inline constexpr float kMaxToolReachM = 40;
/// Largest number of voxels of a tool's grid: half a gigabyte of distances.
inline constexpr double kMaxToolVoxels = 1 << 27;
/// Largest error of a level set's matrix that still counts as cubic voxels, voxels.
inline constexpr double kCubicTolerance = 1e-6;
/// Difference between the volumes of a tool and its mesh from which on the user is told, share of
/// the mesh's volume.
inline constexpr double kToolVolumeTolerance = 0.01;
/// Largest distance of a bucket from the soil's origin along an axis, voxels. Numbers of chunks
/// there still have 21 bits. With a larger value chunks would be taken for others.
inline constexpr double kMaxIndex = 1 << 23;
/// Largest index of other places along an axis, voxels: pours, and shifts between lattices. An
/// index is an int, and this leaves room for sums.
inline constexpr double kMaxPlaceIndex = 1 << 29;

// ---- Base surfaces (core/ground) ----------------------------------------------------------------

/// Difference of two origins from whole lattice periods at which lattices are the same, voxels. A
/// larger value compares unlike samples, a smaller one parts lattices by rounding.
inline constexpr double kLatticeTolerance = 1e-3;
/// Posts along a side of a tile of a height field. A tile is read at once. Larger tiles hold more
/// posts that are never used, smaller ones take more reads.
inline constexpr int kHeightTileSide = 64;
/// Posts of a rectangle in a tile beyond which it takes the tile's bounds: a quarter of the tile.
/// Those bounds are looser, but quick to find.
inline constexpr int kTileBoundsPosts = kHeightTileSide * kHeightTileSide / 4;
/// First and last margin in which heights near unknown ground are looked for, posts. The margin
/// doubles until it holds a height. A bucket above all heights in it is above the ground. A smaller
/// last margin refuses buckets over wide gaps of a raster.
inline constexpr int kNearPosts = 4, kFarPosts = 64;
/// Gauss-Newton steps to the nearest point of a bilinear patch, and of a twisted one. The error
/// falls by twist * distance / area at each step, and a border takes one step of its own.
inline constexpr int kPatchSteps = 3, kTwistedPatchSteps = 6;
/// Value of twist * distance / area from which a patch counts as twisted. With a larger value
/// distances are too long, with a smaller one more patches take all steps.
inline constexpr float kTwistedPatch = 0.02f;
/// Largest margin in which soil near unknown ground of a level set is looked for, voxels.
inline constexpr int kFarVoxels = 512;
/// Largest number of voxels that a level set reads to classify a box. A larger box counts as mixed,
/// so with a smaller limit more chunks are read in vain.
inline constexpr std::uint64_t kMaxClassifyVoxels = 64 * 64 * 64;
/// Distance of a cell's centre from a level set's surface beyond which all its samples are alike,
/// cell sides. Corners are at 0.87. A larger value asks more samples one by one.
inline constexpr double kClearDistance = 0.9;
/// Origins that a list of chunks holds beyond twice the different ones. A larger value takes
/// memory, a smaller one sorts more often.
inline constexpr std::size_t kChunkListSlack = 4096;

// ---- Memory (core/ground/ground_memory.cc) ------------------------------------------------------

/// Part of a memory limit (1 / n) that paging out frees at once. A smaller part frees a little at
/// every update.
inline constexpr std::uint64_t kPageOutDivisor = 8;
/// Part of a memory limit (1 / n) up to which the initial terrain keeps values that it can read
/// again.
inline constexpr std::uint64_t kBaseMemoryDivisor = 4;

// ---- Paths (core/tool/motion.cc, core/site/machine.cc) ------------------------------------------

/// Largest bend of a path in one segment, voxels: the distance of a fixed point of the world from
/// its straight way in the bucket frame. A stroke's parabola leaves out a third-order part: at most
/// 0.013 of the bend on a bucket of ten voxels, 0.017 on one of five. The facet's kernel relies on
/// it for the cells that it skips. A larger value misses whole samples. A smaller one makes more
/// segments, and each looks at every voxel again.
inline constexpr double kMaxBend = 0.02;
/// Largest distance of a simplified path from the recorded one, voxels: a tenth of the error of a
/// count in one cell. A larger value shows in cuts.
inline constexpr double kPathTolerance = 1e-3;
/// Largest travel of a bucket's fastest corner between two poses of a path, voxels. Boxes around
/// segments are about as large. Larger boxes meet chunks in vain, smaller ones meet each chunk too
/// often.
inline constexpr double kPathStride = 16;
/// Number of parts that a thread makes of one machine's updates in a batch. With more parts threads
/// meet at the lock more often. With fewer parts one thread waits longer for the other at the end.
inline constexpr std::size_t kPartsOfSequence = 16;
/// Most batches that are made in turn after one in which soil met another's. With more, machines
/// that are apart again wait longer for it; with fewer, more batches are made twice.
inline constexpr int kMaxBatchesInTurn = 63;
/// Room around a machine that its soil has at least where others move theirs at once, cells: 3 m at
/// 5 cm. With more, machines near each other take turns. With less, soil leaves it more often, and
/// all is done again in turns.
inline constexpr double kSoilReachCells = 64;
/// Largest bend of a path that only bounds the places of a bucket, voxels. A larger value takes
/// more moves in the air for moves in the ground. A smaller one makes more poses.
inline constexpr double kCoarseBend = 1;
/// A stride without any limit, m, for the same paths.
inline constexpr double kAnyStride = 1e300;
/// Largest number of halvings of one piece of a path. The motion of a machine needs fewer. A
/// smaller value lets quick turns bend too much.
inline constexpr int kMaxHalvings = 40;
/// Largest number of joints of a chain whose values stand on the stack. A longer chain allocates
/// memory for each pose.
inline constexpr std::size_t kStackJoints = 16;

// ---- Cuts (core/cut) ----------------------------------------------------------------------------

/// Chunks times strokes from which on several threads dig a stroke. Below it one thread is quicker.
inline constexpr std::size_t kParallelCutWork = 64;
/// Largest number of chunks in the box of a part of a path that is dug at once. With more, lists
/// grow. With fewer, chunks that several segments meet are looked for again.
inline constexpr double kMaxPartChunks = 512;
/// Parts of a segment at whose ends the ground is checked, if the box of the whole segment meets
/// unknown ground. Fewer parts may pass over a hole, more take longer.
inline constexpr int kGroundCheckParts = 8;
/// Room for rounding in the range of a coordinate over a box of cells, and over a chunk, voxels. A
/// smaller value may skip cells that are cut, a larger one looks at more in vain.
inline constexpr float kBoxRounding = 1e-4f, kChunkRounding = 1e-3f;
/// Steepest slope of a tool's interpolated distance. Exact distances change by 1, interpolated ones
/// by more where planes meet. A larger value makes the steps along a path shorter, a smaller one
/// may step over a part of the tool.
inline constexpr double kToolSteepness = 1.25;
/// Smallest step along a path on which a tool is looked for, voxels: the error of the cut. A
/// smaller step takes longer.
inline constexpr double kMinToolStep = kMaxBend;
/// Segments of a path that a tool cuts at once. With more, each chunk tries more segments. With
/// fewer, chunks are found anew more often.
inline constexpr std::size_t kToolSegments = 16;
/// Work of a tool on one chunk, in strokes of a bucket (kParallelCutWork). So several threads
/// always dig a tool's chunks.
inline constexpr std::size_t kToolChunkWork = 64;
/// Half width of the narrow band of a tool's level set, the tool's voxels. Distances end there, so
/// a smaller value shortens steps along a path.
inline constexpr float kToolBand = 3;
/// Parts of a cell along each axis that a tool's volume is summed over, at its surface.
inline constexpr int kToolVolumeParts = 4;

// ---- Stations of a machine (core/site/machine_rest.cc, core/settle/pour_parts.cc) ---------------

/// Travel from one station to the next, radii of the bucket, and smallest travel, voxels. Soil
/// comes to rest at stations. A larger value lets soil before a full bucket come in lumps. A
/// smaller one settles more soil that moves again at once.
inline constexpr double kStationRadiusShare = 0.1, kMinStationVoxels = 2;
/// Stations of a digging bucket from one rest of the soil behind it to the next. With more, that
/// soil stands too steep for longer. With fewer, more soil slides that moves again at once.
inline constexpr int kStationsPerRest = 5;
/// Steps of sliding soil at a station. With more, an update with a station takes longer. With
/// fewer, soil behind the bucket stands too steep for longer.
inline constexpr int kStationSteps = 60;
/// Time after which soil beside a bucket that stands goes on as at a station, s. With more, it
/// takes longer to rest; with less, updates take longer.
inline constexpr double kTick_s = 0.05;
/// A bucket stands that stays so near for so many ticks: as far as sensors err, and not so long
/// that one is taken to stand that digs at 0.15 m/s. Later ticks are made up for, up to some.
inline constexpr double kMaxTremble_m = 0.02;
inline constexpr std::int64_t kTicksToStand = 3, kMaxTicks = 20;
/// What times err by, ticks; and the longest time that is counted, s.
inline constexpr double kTickRounding = 1e-3, kMaxStand_s = 1e12;
/// Stations from one at which soil slides to the next.
inline constexpr int kStationsPerSlide = 2;
/// Places before the lip at which the ground that holds a load in is measured, a cell apart: their
/// number, and the distance of the first, from which on the lip cuts no column beside it.
inline constexpr int kColumnsBefore = 3;
inline constexpr double kFirstBefore = 1.5;
/// Smallest sine of the mouth's rise, and of its outward direction's length in plan, at which
/// ground may hold a load in: a mouth that looks up or down has no ground before it.
inline constexpr double kMinMouthRise = 0.1;
/// Turn between two rows of a motion after which a bucket loses soil that it can't hold, rad. With
/// a larger value, soil tipped on the way depends on where updates end. A smaller one makes an
/// update cost more.
inline constexpr double kSpillTurnRad = 0.05;
/// Amount of spilled soil that falls before the next station, share of the struck capacity. With a
/// larger value soil that is tipped at once hangs in the air. With a smaller one dense rows make
/// many small piles.
inline constexpr double kMinSpillShare = 0.1;
/// Largest amount that a bucket holds more for soil that dropped before its mouth, m^3 per m^3. As
/// much less is spilled at the next station in the ground. With 0, the load swings from station to
/// station. With more, soil drops later than it should.
inline constexpr double kMaxHoldGain = 2;
/// Smallest way in plan since the last station along which the body pushes soil, radii of the
/// bucket. After a shorter way the soil goes before the mouth.
inline constexpr double kMinPushWay = 0.01;
/// Sine of the angle between the way and the normal of the lip up to which a bucket pushes soil
/// along its lip.
inline constexpr double kMaxPushAside = 0.7;
/// Volume of a part of a pour, cells, and smallest and largest number of parts. Parts fall evenly
/// over the pour's time. Each part looks at the pile anew, so more take longer. With fewer a truck
/// tips all its soil at the end.
inline constexpr double kPourPartCells = 400;
inline constexpr std::int64_t kMinPourParts = 16, kMaxPourParts = 128;
/// Largest number of rounds in which soil comes to rest around all machines in turn. They end
/// sooner when no soil moves.
inline constexpr int kMaxRestRounds = 32;

// ---- Ground as heights of columns (core/settle) -------------------------------------------------

/// First margin of a window around the changed columns, and around a pile, cells. It doubles when
/// soil comes to the window's border. A larger value reads columns in vain, a smaller one reads
/// columns twice.
inline constexpr int kWindowMargin = 8, kPourMargin = 8;
/// Largest side of a window, cells: 50 m at 5 cm. Soil that slides farther does so in a next
/// window.
inline constexpr int kMaxWindowCells = 1024;
/// Largest radius of a pile, cells: it fits into the largest window.
inline constexpr int kMaxPileCells = 480;
/// Side of a window in which soil is followed down ground too steep for it, and of that in which
/// its way ends, cells. With larger ones more columns are read beside its way. A smaller second one
/// takes ground for flat that is a little too steep.
inline constexpr int kRunWindowCells = 16, kRunEndCells = 64;
/// Distance that soil runs down such ground before it is lost off the site, cells: 250 m at 5 cm.
inline constexpr double kMaxRunCells = 5000;
/// Largest number of windows that poured soil is looked at in.
inline constexpr int kMaxPourWindows = 200;
/// Half side of the window into which soil runs on, radii of its pile with margin.
inline constexpr int kRunOnRadii = 4;
/// Largest number of columns of chunks whose initial terrain is kept, 600 bytes each. With fewer,
/// sites with many machines ask the surface anew.
inline constexpr std::size_t kMaxBaseColumns = 8192;
/// Largest number of tiles of columns that are kept for a machine, 4 kB each. With fewer, ground
/// that it looks at is read again and again.
inline constexpr std::size_t kMaxColumnTiles = 4096;
/// Largest number of tiles of columns whose heights are kept for readers, 3.1 kB each. With
/// fewer, large maps read their ground anew each time.
inline constexpr std::size_t kMaxHeightTiles = 1 << 14;
/// Columns of cells of which a map is made at a time, 8 bytes each. With fewer, columns at the
/// borders of parts are read more often.
inline constexpr int kMapPartColumns = 1 << 20;
/// Columns for each point up to which those between points are read as well. One alone takes four
/// and looks for them in their tiles.
inline constexpr double kMapPointColumns = 32;
/// Share of a voxel up to which a map's cells count as those of the voxels, and difference of a
/// direction up to which it is that of an axis: rounding of their input.
inline constexpr double kSameCell = 1e-6, kSameAxis = 1e-9;
/// Smallest cell of a map, voxels. Smaller ones would be lost in rounding.
inline constexpr double kMinMapCell = 1e-3;
/// Most cells of a column that may be missing below its topmost full one without a roof above them.
/// With more a column over a shallow undercut is a slit, with fewer maps hold less than the ground.
inline constexpr double kMostPoreCells = 1;
/// Chunks from the top of the initial terrain downwards whose samples are counted for heights of
/// columns. Columns of higher cliffs have the mean of a few heights, which is less exact.
inline constexpr int kMaxCountedChunks = 4;
/// Distance from the middle of a column along both axes at which its corners are asked for ground,
/// cells. It is just inside, so that a neighbour's hole doesn't count.
inline constexpr double kColumnCorner = 0.499;
/// Cells below the height of the initial terrain in which a column may have air, for the ground
/// slopes. With fewer, soil can't fill that air. With more, samples are searched in vain.
inline constexpr int kSlopeCells = 2;
/// Cells above a column's surface, and below its bank, in which its samples may lie. Bank that
/// fills a part of a column puts its soil higher than the mean.
inline constexpr int kFillCells = 16;
/// Chunks, and columns, from which on several threads change them.
inline constexpr std::size_t kParallelFillChunks = 64, kParallelFillColumns = 400;
/// Room for rounding in the height by which a surface differs over a column, cells.
inline constexpr float kTiltRounding = 1e-3f;
/// Fixed-point units in a cell, for the order of samples by height. It makes the order the same on
/// all CPUs. A smaller value makes ties, a larger one overflows in high columns.
inline constexpr float kHeightUnits = 65536;
/// A search for a count bisects at each n-th step and interpolates at the others, which alone may
/// creep; one for a level looks at each n-th step for a lip. A smaller n takes more steps on smooth
/// ground.
inline constexpr int kBisectEvery = 4;
/// Preference of soil that falls on a tool for places ahead, columns.
inline constexpr double kAheadShare = 0.01;
/// Distance between the points by which a bucket or tool blocks columns, cells. From 1 on columns
/// between them are missed, and a smaller value takes longer.
inline constexpr double kObstacleStep = 0.7;
/// Height of a bucket above the ground up to which it blocks columns, cells. The next stroke moves
/// soil that would lie below it.
inline constexpr float kObstacleClearance = 2;

// ---- Slides (core/settle/settler_slide.cc) ------------------------------------------------------

/// Drop beyond repose from which on soil slides, cells: to the next column, to the one after it,
/// and to the third. Heights err by 0.03 where soil was cut. With smaller values that error slides
/// to and fro, with larger ones heaps stand too steep.
inline constexpr int kSteepColumns = 3;
inline constexpr double kSteepDrops[kSteepColumns] = {0.12, 0.1, 0.08};
/// Tiles between two tiles with steep soil up to which that slides together.
inline constexpr int kNearTiles = 2;
/// Slope beyond repose at which sliding soil comes to rest, a quarter of a degree. It keeps most of
/// the error of heights from sliding along.
inline constexpr double kRestSlopeMargin = 0.005;
/// Height above a column's mean up to which loose soil may stand in a part of it, cells. A slope
/// of repose stands up to 1.6 above it. With a larger value needles stay where a cut went through
/// columns.
inline constexpr double kMaxStandingCells = 2;
/// Largest change of a column's height that is left out when soil slides, cells, and the share of
/// the soil that may be missed by it where it falls or rises. With larger values slopes err by more
/// than counts do; with smaller ones making samples takes longer than all else.
inline constexpr double kMaxHeightChangeLeft = 0.03, kMaxLeftOutShare = 0.05;
/// What may be missed in any case, cells, on the mean over the columns that change.
inline constexpr double kMaxHeightMissed = 0.0075;
/// Smallest change of a column's height that moves samples, cells. It is less than the error of a
/// count.
inline constexpr double kMinHeightChange = 1e-3;

// ---- Bank that fails (core/settle/wall_failure.cc, settler_bank.cc) -----------------------------

/// Acceleration of free fall, m/s2, standard.
inline constexpr double kGravity = 9.80665;
/// First margin around the dug cells in which ledges are looked for, cells. It doubles for ledges
/// that reach farther.
inline constexpr int kLedgeMargin = 4;
/// First margin below the dug cells, for the ground that ledges fall to, cells, and the factor by
/// which it grows.
inline constexpr int kLedgeDepth = 2, kLedgeDepthFactor = 4;
/// Cells above the dug cells and above the ground in which ledges are looked for.
inline constexpr int kLedgeHeadroom = 2;
/// Smallest depth below the terrain of a column that was surely dug, cells. With a smaller value
/// errors of counts are feet of cuts.
inline constexpr double kMinDugDepth = 0.25;
/// Largest height of a column of level ground above its topmost full cell, cells. A column with
/// more is partly of one height and partly of another, so its mean is no ground.
inline constexpr double kMaxPartialCells = 3.5;
/// Largest number of failures of a bank at one station. The next station goes on with the rest.
inline constexpr int kMaxBankFailures = 32;
/// Directions from a foot of a cut in which vertical slices are searched. With fewer, a cut askew
/// to them fails too late. More take longer.
inline constexpr int kSliceDirections = 32;
/// Columns around the foot of a cut from which its face's direction is known. With fewer, a cut
/// askew to the columns has the direction of their steps. With more, short faces have none.
inline constexpr int kFaceColumns = 3;
/// Columns on each side of one that stands up to the next that fails, for it to fail with them.
/// With fewer, needles are left between slices. With more, walls between two cuts come down.
inline constexpr int kGapColumns = 3;
/// Planes that are tried through each column where the ground falls off behind a cut.
inline constexpr int kSlicePlanes = 4;
/// Number of feet from which on threads share them. With a smaller one few feet wait for threads.
inline constexpr std::size_t kParallelFeet = 64;
/// Fall from one column to the next from which on the ground falls off there, sides.
inline constexpr double kFallOff = 1;
/// Share of the bank's cohesion from which on a slice fails together with a failing one. Slices at
/// different angles to a cut need the same cohesion, apart from errors of heights.
inline constexpr double kSameCohesionShare = 0.95;
/// Longest plane along which bank fails, depths dug at its foot. With a larger value slopes that
/// stood before a small cut fail after it.
inline constexpr double kMaxPlaneDepths = 16;
/// Columns before a window's border over which the ground must rise more steeply than friction to
/// ask for a larger window.
inline constexpr int kBorderRiseColumns = 4;
/// Farthest foot of a cut from the middle of the column that shows it, sides.
inline constexpr double kMaxFootOffset = 2;
/// Smallest way from the foot to a column that bounds the plane's slope, sides. Nearer columns are
/// the foot's own.
inline constexpr double kMinFootWay = 0.25;
/// Smallest wedge of a slice that fails, sides squared. A smaller one is the error of heights.
inline constexpr double kMinWedge = 0.5;
/// Lowest cut that can be told from a slope, sides. Bank that fails in a lower cut is taken for
/// cohesionless and fails along the flattest plane. Otherwise the rest of a wedge would fail again
/// and again.
inline constexpr double kMinCutHeight = 1;
/// Variance of the place of an upright cut that is due to the columns' width, sides squared.
inline constexpr double kUprightSpread = 0.4;

// ---- Resistance (core/force) -------------------------------------------------------------------

/// Smallest angle between a failure plane and the direction in which a wedge can't slide, rad.
inline constexpr double kLeastWedgeAngle = 1e-3;
/// Share to which the place where a failure plane comes to the ground is found, and the most steps
/// for it.
inline constexpr double kWedgeTolerance = 1e-6;
inline constexpr int kMaxWedgeSteps = 40;
/// Cosine of a blade's rake up to which it counts as upright.
inline constexpr double kNearlyUpright = 1e-12;
/// Flattest face of a body of soil before a steep blade, rad: Miedema finds none flatter. Precision
/// of the angle that is searched for, and the step by which it is then found by differences.
inline constexpr double kFlattestBody = 0.35, kBodyAngleTolerance = 1e-3, kBodyAngleStep = 3e-3;
/// Faces tried after which a body whose force is so many times that without one is given up.
inline constexpr int kBodyTrials = 3;
inline constexpr double kHopelessBody = 1.2;
/// Largest difference between the angles of two slices' bodies beside each other, rad; else both
/// are looked for from nothing.
inline constexpr double kBodyGuessError = 0.03;
/// Share of the lip's depth that a blade may end below the ground before its force counts as too
/// low.
inline constexpr double kBuriedShare = 0.1;
/// Sum of rake, friction and tool friction up to which no body is looked for, rad. One needs less
/// force there only before a blade that is all in soil with hardly any friction.
inline constexpr double kLeastAngleWithBody = 1.8;
/// Distance from the mouth within which columns may have been cut by it, voxels. The ground behind
/// is continued with the terrain's shape, from the mean over some heights ahead.
inline constexpr double kCutMargin = 2;
inline constexpr int kHeightsAhead = 3;
/// Length of ground ahead that is looked at, depths of the lip, and the least, voxels. Failure
/// planes of strong soil come out at six depths on level ground.
inline constexpr double kSliceDepths = 8;
inline constexpr int kLeastSliceSteps = 16, kMostSliceSteps = 400;
/// Width of a strip of the blade: two voxels, but at most this, m, and at least a voxel. Force
/// changes slowly along a lip.
inline constexpr double kStrip_m = 0.1;
inline constexpr int kMostStrips = 256;
/// Largest number of columns that lines of heights may span.
inline constexpr double kMostLineColumns = 1 << 24;
/// Largest bend between the first face of a bucket's profile and a later one that counts as the
/// same blade, rad.
inline constexpr double kBladeBend = 0.35;
/// Smallest horizontal part of a unit vector along the lip at which soil is cut across it.
inline constexpr double kLeastLevelLip = 0.5;
/// Smallest angle of friction for bearing capacity, rad. Its factors are limits at 0.
inline constexpr double kLeastFriction = 1e-4;
/// Shortest way of a lip that tells its direction, voxels. A shorter one is noise of sensors.
inline constexpr double kLeastWay = 0.1;
/// Height of a face above the ground, voxels, up to which it presses on all of it, and from which
/// on not at all. Ground that was cut at a face errs by an eighth.
inline constexpr double kPressesBelow = 0.125, kFreeAbove = 0.25;
/// Voxels that a face must be lower, where it looks a voxel ahead: floors are rough.
inline constexpr double kGoesInto = 0.5;
/// Height of soil beside the bucket over that ahead from which on it is less and less, and no more,
/// taken along: it is the wall of a slot.
inline constexpr double kLowWall = 1.25, kHighWall = 1.75;
/// Sine of the angle between a face and its way from which on it presses on the soil, and from
/// which on with all of its force; the same between an edge's way and a line across it. In between,
/// forces rise evenly, so that small turns don't switch them.
inline constexpr double kLeastPress = 0.02, kFullPress = 0.17;

// ---- Pouring (core/settle/pour.cc, front.cc, fall_line.cc) --------------------------------------

/// Drop beyond repose from which on soil runs on instead of lying there, sides. With a larger value
/// ledges stay on scarps. With a smaller one the error of counted heights is a thousand small lips.
inline constexpr double kRunOnDrop = 0.25;
/// The same where soil comes over the edge of a step, sides. With a larger value soil rises above
/// edges while the ground below the step is still lower.
inline constexpr double kEdgeRunOnDrop = 0.01;
/// Slope, of repose, from which on soil runs down ground that goes on so. With a smaller one the
/// error of heights leads it down its own heap.
inline constexpr double kRunSlope = 1.1;
/// Smallest share of a step in the drop between two columns. The rest of the drop is the ground on
/// either side, continued to the face between them. A drop with a smaller share is a slope without
/// an edge. With a larger value walls are slopes, and their edges are half a column off. With a
/// smaller one slopes are stairs.
inline constexpr double kMinStepShare = 0.6;
/// Smallest height of loose soil above a firm edge at which the soil covers it, sides. Heights at
/// faces are guesses, and with a smaller value their errors lift edges.
inline constexpr double kMinEdgeCover = 0.05;
/// Difference up to which levels are one, sides. With a larger value soil that is poured in parts
/// lies elsewhere than soil poured at once. A smaller one looks at more fronts to find a lip.
inline constexpr double kLevelTolerance = 1e-3;
/// Difference of levels at which the search for one ends where the soil takes much more at once,
/// because a way opens behind a bump, sides. With a larger value soil that is poured in parts lies
/// elsewhere than soil poured at once. A smaller one looks at more fronts that differ by less than
/// a sample.
inline constexpr double kJumpTolerance = 1e-2;
/// Share of its range that a step of that search may leave; else it bisects next. It is not 1 / 2,
/// which a bisection leaves, or rounding would decide.
inline constexpr double kMaxRangeLeft = 0.6;
/// Step past the level at which a lip opens, sides.
inline constexpr double kLipStep = kLevelTolerance / 4;
/// Volume at which a front is broken off, pours. With a larger value fronts that hold too much take
/// longer. With a smaller one they say less about the next level.
inline constexpr double kMaxFrontPours = 1.5;
/// Largest number of levels that are tried for one pile, and of piles of one pour. Real ground
/// never takes so many.
inline constexpr int kMaxPourLevels = 200, kMaxPourPiles = 10000;
/// Distance from the ground's border at which soil leaves it to run on: columns, and cube roots of
/// volume over slope. Soil comes down a slope by some columns at a time.
inline constexpr int kExitColumns = 6, kExitPiles = 2;
/// Length from which on soil that falls along a line makes a ridge, cells. Where it can't, it makes
/// heaps so far apart, but no more than so many: each takes as long as a ridge.
inline constexpr double kMinLineCells = 1, kLineHeapCells = 6;
inline constexpr int kMaxLineHeaps = 5;
/// Steps of kSourceStep ahead, besides those that meet a tool, in which a line is looked for on
/// which soil can lie. The columns that a blade cuts take some.
inline constexpr int kMaxLineSteps = 16;
/// Distance between the points by which a line of soil that falls finds its columns, columns. From
/// 1 on it misses some.
inline constexpr double kSourceStep = 0.5;
/// Distance up to which two places are one, columns. A ray so near to a corner passes through it.
inline constexpr double kSamePlace = 1e-9;

// ---- Sliding soil (core/settle/flux_grid.cc, flux_row.cc) ---------------------------------------

/// Smallest angle beyond repose at which soil begins to move, rad: one degree.
inline constexpr double kCollapseStartRad = 0.0175;
/// Step along the fluxes between columns, soil for each side of drop. The largest eigenvalue is 32,
/// of soil that flows both ways between columns. Momentum is stable up to 4/3 of its inverse. A
/// larger step runs away on ground as rough as its columns, a smaller one takes more steps.
inline constexpr float kFluxStep = 1.0f / 24;
/// Drop beyond repose as which a depth of soil on steeper support counts, per depth. It is the
/// speed of that soil. From 3 on the steps run away, and at 1 they take longer.
inline constexpr float kDrainFactor = 2;
/// Depth of soil that may stay on steep support, or lack in a column until the end, sides.
inline constexpr float kFilmDepth = 0.05f;
/// Share of the square of repose below which a slope surely doesn't start to flow. A larger share
/// may miss one by rounding.
inline constexpr float kStillShare = 0.999f;
/// Largest angle of a slope beyond repose at rest, rad: half a degree.
inline constexpr double kRestToleranceRad = 0.0087;
/// Largest number of steps from samples to samples. Random ground 100 columns wide needs 600 steps,
/// a wall 20. Where soil runs over brinks, thousands of steps don't bring rest, but beginning again
/// from where they brought the soil does.
inline constexpr int kMaxFluxSteps = 500;
/// Steps' worth of momentum that a slide begins with. A larger value comes to rest in fewer steps.
/// With 30, a wall's foot goes 2 % too far; with 15, half a percent.
inline constexpr double kFirstLead = 15;
/// Largest difference of drops and fluxes at rest, share of repose. With a larger value soil may
/// have gone too far.
inline constexpr float kFluxTolerance = 0.04f;
/// Steps between two checks for rest. A check takes as long as a step.
inline constexpr int kRestCheckSteps = 10;
/// Steps between two looks for tiles that soil came to. Until then it waits at their border.
inline constexpr int kActivateSteps = 5;
/// Depth of soil that must have come into a resting tile before that tile takes part, sides. With
/// less, counts' errors set soil flowing all over a heap; with more, a slide's foot stands too
/// steep.
inline constexpr float kMinReach = 0.02f;
/// Tiles around a tile for which room is made at once. With fewer, arrays are copied more often.
inline constexpr int kSpareTiles = 3;
/// Share of its soil that a column may lack in the end. It is rounding.
inline constexpr double kMaxOwedShare = 1e-13;
/// Times that a column is asked to give less before it gives nothing.
inline constexpr int kMaxOwedRounds = 100;

// ---- Planes of cells (core/cell/cell_plane.cc) --------------------------------------------------

/// Gauss-Newton steps of a fit. Two steps are nearly always enough. The third is for starts that
/// are 20 degrees off.
inline constexpr int kFitSteps = 3;
/// Share of wrong samples near the plane beyond which a cell has no plane, after one step.
inline constexpr float kHopelessWrongShare = 0.5f;
/// Largest share of wrong samples near the plane of a smooth surface, and largest number in one
/// cell. Curvature leaves some everywhere, and most at the window's corners. A surface that bends
/// with a radius of six voxels is a fifth of a voxel off its plane there. With larger values
/// creases are rounded off, with smaller ones curved ground is made of facets.
inline constexpr float kSmoothWrongShare = 0.1f;
inline constexpr int kSmoothWrongInCell = 14;
/// Reach of the heights from which a fit starts, cells above and below the middle one. Within it
/// each column must go from soil to air.
inline constexpr int kHeightFitReach = 2;
/// Half thickness of the slab in which one side of a wall is fitted, voxels. A wall one voxel thick
/// has its other side just beyond.
inline constexpr float kSideFitHalfSlab = 0.5f;
/// Smallest area of the plane in such a fit, voxels^2. The window has nine.
inline constexpr float kMinSideFitArea = 4;
/// Samples of soil from which on a cell isn't air beside a thin wall. The same holds for air beside
/// a thin slot.
inline constexpr int kThinWallOutside = 16;
/// Smallest number of samples of soil in two cells of a thin wall that share a face. The same holds
/// for air in a thin slot.
inline constexpr int kThinWallInside = 64;
/// Largest shift, voxels, and tilt of a plane in one step. It holds fits that run away.
inline constexpr float kMaxFitStep = 0.5f;
/// Distance beyond a cell up to which a plane still asks the cell's samples one by one, voxels. It
/// exceeds the distance of sample points from a cell's faces. A smaller value misses bits of the
/// neighbours.
inline constexpr float kCellFaceMargin = 0.04f;
/// Smallest squared length of a sum that gives a normal. Shorter sums are rounding.
inline constexpr float kMinNormalSquare = 1e-6f;
/// Smallest determinant of a fit's moments. Below it the plane stays as it is.
inline constexpr float kMinFitDeterminant = 1e-4f;
/// Fits and creases that a memo of cells remembers, powers of two. A block that was dug has 5000
/// fits and 1500 creases, so six blocks that are dug at once are remembered.
inline constexpr std::size_t kMemoFits = std::size_t{1} << 15, kMemoCreases = std::size_t{1} << 14;

// ---- Creases (core/cell/crease.cc) --------------------------------------------------------------

/// Largest number of planes that are tried together. Six have 15 pairs and 20 triples. A corner has
/// three.
inline constexpr int kMaxCandidates = 6;
/// Cosine between normals (10 degrees) and difference of offsets, voxels, from which on two planes
/// are one.
inline constexpr float kSamePlaneCosine = 0.985f, kSamePlaneGap = 0.25f;
/// Largest distance of a candidate plane beyond the cell, voxels.
inline constexpr float kCandidateReach = 1.0f;
/// Wrong samples of a neighbour without any cost, and largest number that counts. A neighbour may
/// see another surface.
inline constexpr int kFreeNeighbourWrong = 2, kMaxNeighbourWrong = 24;
/// Wrong samples that each further plane must save. With fewer, errors of counts make creases of
/// planes.
inline constexpr int kPlaneCost = 8;
/// Largest number of wrong samples of a pair of planes that needs no third.
inline constexpr int kGoodPairWrong = 14;
/// Wrong samples, planes' costs included, from which on planes are no model.
inline constexpr int kUnsolvedScore = 160;
/// Joint Gauss-Newton steps of a model's planes, and the largest of them, voxels.
inline constexpr int kCreaseFitSteps = 2;
inline constexpr float kMaxCreaseFitStep = 0.35f;
/// Stiffness of a model's planes against tilts and against shifts in these steps, voxels^2.
inline constexpr float kTiltStiffness = 0.6f, kShiftStiffness = kTiltStiffness / 4;
/// Largest distance of a wrong sample from the model that moves a plane, voxels. Farther ones are
/// of another surface.
inline constexpr float kCreaseFitReach = 0.5f;

// ---- Models of cells (core/cell/cell_models.cc, cell_model.h, cell_volume.cc) -------------------

/// Times that creases are solved: as many as CellModels::solve_creases() has. The second time they
/// know their neighbours' models, so each time needs models one voxel farther out.
inline constexpr int kCreaseSweeps = 2;
/// Distance from which a crease takes planes of other cells, and the initial terrain's, voxels.
inline constexpr int kPlaneSight = 2;
inline constexpr float kBasePlaneSight = 2;
/// Voxels beyond the models in which fits are needed for curvatures, and models to conserve
/// volumes.
inline constexpr int kBendHalo = 1, kVolumeHalo = 1;
/// Largest number of wrong samples with which a crease isn't solved again.
inline constexpr int kExplainedWrong = 4;
/// Smallest cosine between normals of neighbours that give a surface's curvature: 37 degrees.
inline constexpr float kCurvatureCosine = 0.8f;
/// Largest curvature, 1/voxel.
inline constexpr float kMaxCurvature = 0.4f;
/// Smallest determinant of the spread of neighbours for a curvature, voxels^4.
inline constexpr float kMinCurvatureSpread = 0.5f;
/// Offset of the surface along the normal from a plane fitted to 27 cells, voxels, for a trace of
/// curvature of 1/voxel. It is the mean of (u^2 + v^2) / 4 over the window. With another value
/// curved floors lie too high or too low.
inline constexpr float kCurvatureOffset = 0.375f;
/// Largest shift of planes that conserves the volume of the samples around, voxels, and smallest
/// area that it is divided by, voxels^2.
inline constexpr float kMaxVolumeShift = 0.1f, kMinVolumeArea = 1;
/// Distance of a voxel's centre outside of a thin wall at which it still counts as in it, voxels.
/// Else a wall one voxel thick is lost where both its faces run through centres. The same holds for
/// slots.
inline constexpr float kThinWallTie = 0.04f;
/// Largest thickness of such a wall or slot, voxels.
inline constexpr float kThinWallThickness = 1 + 2 * kThinWallTie;
/// Largest cosine between the normals of its two faces.
inline constexpr float kOppositeCosine = -0.9f;
/// Patterns of samples that are weighed where planes meet: the cell's own and others. Errors of a
/// pattern that all cells had would add up along a crease.
inline constexpr int kVolumePatterns = 4;
/// Distance from the surface within which a sample counts in part, voxels. The number of such
/// samples is the area.
inline constexpr float kVolumeSoftness = 0.05f;
/// Smallest component of a normal. The volume below a plane is divided by it.
inline constexpr double kMinVolumeNormal = 1e-4;

// ---- Vertices and triangles (core/surface) ------------------------------------------------------

/// Distance beyond an edge's end up to which a model's crossing still counts, voxels.
inline constexpr float kCrossingSlack = 1e-3f;
/// Smallest cosine between an edge and the normal of a plane that crosses it.
inline constexpr float kMinCrossingCosine = 1e-6f;
/// Largest distance of a vertex outside of its dual cell, voxels. With a larger value triangles
/// turn over.
inline constexpr float kMaxVertexOutside = 0.25f;
/// Distance inside a dual cell's faces at which a vertex is held that would be farther out, voxels.
inline constexpr float kVertexInset = 1e-3f;
/// Smallest cosine between normals without a crease: 14 degrees.
inline constexpr float kSmoothCosine = 0.97f;
/// Smallest eigenvalue along which a vertex leaves the mean, share of the largest. A smaller value
/// sends vertices along nearly flat creases.
inline constexpr float kMinEigenvalueShare = 0.06f;
/// Sweeps of Jacobi's rotations for eigenvalues, and smallest entry that is rotated.
inline constexpr int kJacobiSweeps = 5;
inline constexpr float kMinJacobiEntry = 1e-9f;
/// Share of the way from the mean of crossings to the middle of their planes by which a vertex
/// moves. On a surface of curvature k the mean is r^2 k / 2 below it, and the middle as much above.
/// The mean square distance r^2 is 1/4. The chords of such a mesh want the vertex k / 12 above: 5/6
/// of the way. With another value meshes of curved floors lose or gain volume.
inline constexpr float kCurvedVertexShare = 5.0f / 6;
/// Shift of a vertex by which odd and even cells lean apart, voxels. Without it the vertices of
/// neighbours may be welded at a crease that lies on the lattice.
inline constexpr float kVertexLean = 1e-4f;
/// Smallest distance of two sheets' vertices in a dual cell, voxels.
inline constexpr float kMinSheetGap = 0.02f;
/// Difference of distances to a crossing up to which the shorter diagonal splits a polygon, voxels.
inline constexpr double kDiagonalTolerance = 1e-4;
/// Smallest cross product of two sides of a triangle that has area, voxels^2.
inline constexpr double kMinSplitArea = 1e-3;

// ---- Distances and level sets (core/surface) ----------------------------------------------------

/// Reach of a polygon about the lower end of its edge, voxels: the side of a dual cell and the
/// distance of a vertex outside of it.
inline constexpr float kPolygonReach = 1 + kMaxVertexOutside;
/// Voxels between a voxel and the lower end of the edge of any polygon within the band around it:
/// the band's three and a polygon's reach.
inline constexpr int kPolygonsSeen = 4;
/// Twice the area below which a triangle has no plane of its own, voxels^2. Its distance is the one
/// to its edges.
inline constexpr float kSliverArea = 1e-4f;
/// Room for rounding in the radius of a ball around a triangle, voxels, and smallest squared length
/// of its edges, voxels^2.
inline constexpr float kTriangleRounding = 1e-3f, kMinEdgeSquare = 1e-12f;
/// Smallest distance of a voxel from the surface, voxels. It keeps the distance's sign.
inline constexpr float kMinDistance = 1e-4f;
/// Largest difference between the initial terrain's own distance and the contour's at which the
/// former is given, voxels.
inline constexpr float kBaseDistanceTolerance = 0.1f;
/// Side of the cubes in which many chunks share work, voxels. Larger cubes look at less twice, but
/// leave the caches.
inline constexpr int kSharedSide = 64;
/// Largest number of chunks in the box of a level set: 32 GB of leaves.
inline constexpr double kMaxLevelSetChunks = 1.6e7;

// ---- Heights (core/surface/surface_height.cc) ---------------------------------------------------

/// Largest number of patches that a look at many places keeps. Each takes some 100 kB.
inline constexpr std::size_t kMaxHeightPatches = 4096;
/// Largest number of patches that one thread with a memo of cells makes sooner than several threads
/// without one.
inline constexpr std::size_t kMemoPatches = 4;
/// Heights that one thread looks up in a row. A smaller number costs more for tasks.
inline constexpr std::size_t kHeightsPerThread = 256;

// ---- Dug ground as initial terrain (core/surface/ground_terrain.cc)
// --------------------------------

/// Bytes of distances that the surface keeps at least. It keeps more if its soil takes more. With
/// fewer, distances are made again and again along a cut.
inline constexpr std::uint64_t kMinTileBytes = std::uint64_t{64} << 20;
/// Largest number of voxels that are read at once. In a larger box the voxels about each point are
/// read.
inline constexpr double kMaxWindowVoxels = 70 * 70 * 70;
/// Largest number of chunks that are looked at to classify a box. A larger box is mixed, unless it
/// is air.
inline constexpr double kMaxClassifyChunks = 4096;
/// Room for rounding by which a window is larger than its box, voxels.
inline constexpr double kWindowRounding = 0.01;

// ---- Comparing (core/compare) -------------------------------------------------------------------

/// Change of a box from which on it is certain, standard deviations of counts.
inline constexpr double kCertainSigmas = 3;
/// Error of a volume that is given with it, standard deviations of counts.
inline constexpr double kErrorSigmas = 2;
/// Difference of thickness from which on it is a slope, errors of a count.
inline constexpr double kClearSigmas = 2;
/// Boxes along x, and chunks, that are compared at a time. More take memory.
inline constexpr int kSlabBoxes = 64;
inline constexpr std::size_t kGainChunks = 4096;
/// Margin by which a cell counts as smaller, sides of a box. Without it rounding gives slivers of
/// the cell to boxes beside it.
inline constexpr double kBoxInset = 1e-6;
/// Number of changed levels in a column from which on one surely changed from top to bottom.
inline constexpr int kSteepLevels = 3;
/// Halvings in the search for the depth of a wedge at the rim of a change.
inline constexpr int kWedgeHalvings = 30;
/// Smallest component of a wedge's direction. Its integrals are divided by it.
inline constexpr double kMinWedgeNormal = 0.01;

// ---- Background work (core/site/background.cc) --------------------------------------------------

/// Nice value of the background thread. A smaller one takes time from updates.
inline constexpr int kBackgroundNice = 10;

// ---- Scans (core/survey) ------------------------------------------------------------------------

/// Most sensors of a site: the time of a correction grows with the cube of their number.
inline constexpr std::size_t kMostSensors = 32;
/// Standard deviations of what is expected of a column's own height, m: of the terrain, and of a
/// floor that a machine dug. They hang together over a metre or so. With smaller values scans that
/// err are believed less than they should be.
inline constexpr double kNaturalSigmaM = 0.010, kDugSigmaM = 0.0075;
/// Share of a thickness of moved soil by which its height errs: swell and repose are not known
/// better.
inline constexpr double kFilledSigma = 0.1;
/// Standard deviation of a height of which scans say that it is another, m.
inline constexpr double kChangedSigmaM = 0.3;
/// A ray's residual counts if it is within three sigmas and this, m. A larger value takes what is
/// new for noise.
inline constexpr double kScanGateM = 0.07;
/// Error of a ray that no sensor's noise has in it, m: how its column is made.
inline constexpr double kScanErrorM = 0.003;
/// Slope from which on a hit tells no height, and how far from such a wall a ray may end, m.
inline constexpr double kScanWallSlope = 2.5, kWallGateM = 0.1;
/// Rays that are flatter to the ground tell no height: sine of the angle.
inline constexpr double kLeastDescent = 0.12;
/// What a ray passes is gone if it is so far above the ray, m, and if it ends so much farther, m;
/// it is followed from so far before the ground, m.
inline constexpr double kThroughRoomM = 0.05, kThroughShortM = 0.12, kThroughBeforeM = 0.3;
/// Rays that end farther behind the ground than this saw a mirror, such as water, m.
inline constexpr double kMostThroughM = 20;
/// Height of a bin in which rays vote for a height, m. Wider bins take two floors for one.
inline constexpr double kScanBinM = 0.04;
/// Rays that must agree before a height is believed that is not expected. With fewer dust makes
/// ground.
inline constexpr std::int64_t kScanVotes = 6;
/// Fewer are enough if they are most of the column's, and so many of those that ended in it and in
/// the columns beside it agree.
inline constexpr std::int64_t kScanVotesAbout = 2 * kScanVotes;
/// Share of a column's rays that must agree on it. With a smaller one walls and edges, whose rays
/// end at any height, make ground.
inline constexpr double kScanShare = 0.15;
/// Integers of the area that a ray of 1 m straight down stands for.
inline constexpr double kScanArea = 16;
/// Parts of a column by which the height of one with an edge in it errs: the edge's place is known
/// to a part.
inline constexpr double kEdgeCells = 16;
/// Heights farther from the ground are none of it, m.
inline constexpr double kMostScanHeightM = 40;
/// Room about a machine's body in which rays are not used, m.
inline constexpr double kMaskRoomM = 0.12;
/// What repeats from scan to scan does not average out, m: of a stereo camera, of a lidar, and for
/// each unit of slope and of bend of the ground.
inline constexpr double kStereoFloorM = 0.005, kLidarFloorM = 0.003, kSlopeFloorM = 0.01;
inline constexpr double kBendFloor = 0.25;
/// Neighbouring pixels of stereo that count as one.
inline constexpr double kStereoPixels = 16;
/// Side of the squares in which columns' own errors hang together, m; and the share of a column's
/// variance that is alike in its square.
inline constexpr double kScanBlockM = 2, kAlikeShare = 0.5;
/// Error of a height by the ground's bend from which on its column tells nothing of errors that
/// others share, m: at edges and feet, also of what scans found, many columns err to one side.
inline constexpr double kMostBendErrorM = 0.02;
/// A column takes no part in common errors if the mean about it, or itself, is off by so many
/// sigmas. With larger values a half filled floor pulls the lip.
inline constexpr double kPooledGate = 2.5, kColumnGate = 3.5;
/// Rounds in which these columns are looked for.
inline constexpr int kGateRounds = 4;
/// Steps of Gauss and Newton at most that fit a scan's pose, and a step that ends them: m, rad.
inline constexpr int kPoseSteps = 5;
inline constexpr double kLastPoseShiftM = 2e-4, kLastPoseTurn = 4e-5;
/// Squares of ground, and their side, m, that a scan must see for its pose to be fitted. With fewer
/// a slump or a machine in view moves the whole scan.
inline constexpr std::size_t kPoseBlocks = 20;
inline constexpr double kPoseBlockM = 1;
/// A pose that would be so many sigmas off, and the root of this, m^2 or rad^2, is not found.
inline constexpr double kLostPoseSigmas = 5, kLostPoseVariance = 1e-6;
/// Slope from which on ground takes no part in a pose: there a column's height errs by its edges.
inline constexpr double kPoseSlope = 1;
/// A heap has this height at least, voxels, so that a square fits on its flanks; scans saw this
/// share of it at least; and a boundary about it has so many columns of voxels at most.
inline constexpr double kLeastHeapHeight = 8, kLeastHeapSeen = 0.5, kMostHeapColumns = 1 << 22;
/// Flanks lie between these shares of a heap's height: foot and crest are rounded. Ground of less
/// than this share of a steep flank's slope is no flank, but a saddle or a terrace.
inline constexpr double kFlankLow = 0.15, kFlankHigh = 0.85, kLeastFlankShare = 0.75;
/// Planes of flanks are fitted to squares of this side, m, and 5 columns at least. Larger ones do
/// not fit on small heaps, smaller ones take the noise of scans for slopes.
inline constexpr double kFlankWindowM = 0.3;
/// Directions from a heap's middle in which flanks are looked at, how many of them must have some,
/// and how many squares each.
inline constexpr int kFlankSectors = 8, kLeastFlankSectors = 3, kLeastFlankWindows = 2;
/// Samples to which columns of ground are right that nobody dug: what lacks more was cut.
inline constexpr double kHeapCutSamples = 8;
/// Thickness of the layers in which a bucket takes soil that had been cut before, as a share of its
/// height: the thinner, the more its lip's error counts. With a larger one the sigma of what
/// machines cut is too small.
inline constexpr double kLooseLayer = 0.2;
/// A correction is made from this on: of a voxel, and sigmas of ground that nobody touched, and of
/// other ground. With smaller values scans that agree with the ground change it.
inline constexpr double kLeastCorrection = 1.0 / 16, kNaturalSigmas = 2, kMovedSigmas = 0.5;
/// Tiles of 8 x 8 columns that scans may see at most: some 800 MB.
inline constexpr std::size_t kMaxSurveyTiles = 1 << 16;
/// Steepest shape of what a scan changes, and cells above and below it that may change. Soil in
/// the air farther up is left alone.
inline constexpr double kMostCorrectedSlope = 4;
inline constexpr int kCorrectedCells = 3;
/// Side of a square of columns that a survey changes at a time, a multiple of 8: larger ones take
/// more memory meanwhile.
inline constexpr int kSurveyBlock = 64;
/// How often the columns of a survey are looked at: a roof goes first, and where it was thin the
/// height is then another one.
inline constexpr int kSurveyRounds = 4;
/// Most columns of a part of a survey: one update, whose heights the journal has.
inline constexpr std::int64_t kMostSurveyedColumns = 1 << 24;
/// Least variance of an error that scans share: less is none.
inline constexpr double kLeastScanVariance = 1e-12;
/// Largest sigma of a sensor or a lip, in its unit.
inline constexpr double kMostSensorSigma = 10;
/// Largest distance of a scan's point from its sensor, m.
inline constexpr double kMostScanRangeM = 1000;

}  // namespace soilvdb::inline v0
