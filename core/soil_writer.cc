// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/soil_writer.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <utility>

#include "core/affine.h"
#include "core/soil_state.h"

namespace soilvdb {
namespace {

/// Brings what is said of a chunk up to date with its samples.
SOILVDB_FOR_CPUS void recount(SampleLeaf& leaf) {
  leaf.chunk.now = static_cast<std::uint16_t>(leaf.chunk.samples.count());
  for (int g = 0; g < 8; ++g)
    leaf.getValueMask().getWord<std::uint64_t>(g) = leaf.chunk.samples.occupied(g);
}

bool is_air(const SampleWords& words) {
  return std::all_of(words.begin(), words.end(), [](std::uint64_t word) { return word == 0; });
}

/// Has a chunk soil that the base surface doesn't have?
bool exceeds(const Samples& samples, const SampleWords& base) {
  for (int n = 0; n < kLeafSize; ++n)
    if ((samples.word(n) & ~base[static_cast<std::size_t>(n)]) != 0) return true;
  return false;
}

}  // namespace

/// What comes of an edit: a leaf of the tree, or one made apart from it.
struct SoilWriter::Place {
  SampleLeaf* leaf = nullptr;
  std::unique_ptr<SampleLeaf> made;
  bool left_out = false, changed = false;
};

void SoilWriter::edit(Way way, std::span<const Edit> edits, std::size_t parallel_work,
                      const Change& change) {
  std::vector<Place> places(edits.size());
  const std::size_t work = find(way, edits, places);
  const auto run = [&](std::size_t i) {
    if (!places[i].left_out) perform(way, edits[i].origin, places[i], i, change);
  };
  try {
    if (work >= parallel_work) {
      tbb::parallel_for(std::size_t{0}, edits.size(), run);
    } else {
      for (std::size_t i = 0; i < edits.size(); ++i) run(i);
    }
  } catch (...) {
    book(places);
    throw;
  }
  book(places);
}

/// Finds the leaves, and what need not be looked at. @return the work that is left
std::size_t SoilWriter::find(Way way, std::span<const Edit> edits, std::span<Place> places) {
  Soil::State& state = *soil_.state_;
  const bool limited = soil_.store_ != nullptr;
  {
    std::shared_lock shared(state.mutex, std::defer_lock);
    std::unique_lock alone(state.mutex, std::defer_lock);
    limited ? alone.lock() : shared.lock();
    Soil::State::ConstAccessor leaves(state.tree);
    for (std::size_t i = 0; i < edits.size(); ++i) {
      Place& place = places[i];
      place.leaf = const_cast<SampleLeaf*>(leaves.probeConstLeaf(to_coord(edits[i].origin)));
      if (place.leaf == nullptr) continue;
      place.left_out = way == Way::kRemove && place.leaf->chunk.now == 0;
      if (limited && !place.left_out) state.use(place.leaf->chunk);
    }
  }
  std::size_t work = 0;
  for (std::size_t i = 0; i < edits.size(); ++i) {
    Place& place = places[i];
    if (way == Way::kRemove && place.leaf == nullptr)
      place.left_out = soil_.classify(edits[i].origin) == Content::kAir;
    if (!place.left_out) work += edits[i].work;
  }
  return work;
}

/// Changes one chunk, with its leaf made or its samples brought back first.
void SoilWriter::perform(Way way, const Coord3& origin, Place& place, std::size_t i,
                         const Change& change) {
  SampleWords base;
  if (place.leaf == nullptr) {
    soil_.read_base(origin, base);
    if (way == Way::kRemove && is_air(base)) return;
    place.made = std::make_unique<SampleLeaf>(to_coord(origin));
    place.leaf = place.made.get();
    place.leaf->chunk.samples.assign(base);
    recount(*place.leaf);
    place.leaf->chunk.base = place.leaf->chunk.now;
  } else {
    warm(place.leaf->chunk);
  }
  Chunk& chunk = place.leaf->chunk;
  try {
    place.changed = change(i, chunk.samples);
  } catch (...) {
    place.changed = true;  // for all we know
    recount(*place.leaf);
    throw;
  }
  if (!place.changed) return;
  chunk.samples.trim();
  recount(*place.leaf);
  if (way == Way::kRemove || chunk.above) return;
  chunk.above = true;  // also if the base can't be read any more
  soil_.read_base(origin, base);
  chunk.above = exceeds(chunk.samples, base);
}

/// Adds the leaves that were made, and lists what came or changed.
void SoilWriter::book(std::span<Place> places) {
  Soil::State& state = *soil_.state_;
  std::unique_lock alone(state.mutex, std::defer_lock);
  Soil::State::Accessor leaves(state.tree);
  for (Place& place : places) {
    if (!place.changed && place.made == nullptr) continue;
    Chunk& chunk = place.leaf->chunk;
    if (place.made != nullptr && chunk.now == 0 && chunk.base == 0) continue;
    if (!alone.owns_lock()) alone.lock();
    state.touch(chunk);
    state.note_above(chunk);
    if (place.made == nullptr) continue;
    if (soil_.store_ != nullptr) state.use(chunk, true);
    state.add(place.made.release(), leaves);
  }
}

/// Brings samples back from the cold store, if they are there.
void SoilWriter::warm(Chunk& chunk) {
  if (chunk.piece == 0) return;
  const std::uint32_t piece = chunk.piece;
  soil_.store_->drop(piece, soil_.thaw(chunk));
}

std::int64_t SoilWriter::change(Way way, const Coord3& origin, const SampleWords& samples) {
  std::int64_t count = 0;
  const Edit edit{origin};
  this->edit(way, {&edit, 1}, 2, [&](std::size_t, Samples& soil) {
    for (int n = 0; n < kLeafSize; ++n) {
      const std::uint64_t word = soil.word(n);
      const std::uint64_t other =
          samples[static_cast<std::size_t>(n)] & (way == Way::kRemove ? word : ~word);
      if (other == 0) continue;
      soil.set_word(n, word ^ other);
      count += std::popcount(other);
    }
    return count > 0;
  });
  return count;
}

std::int64_t SoilWriter::remove(const Coord3& origin, const SampleWords& samples) {
  return change(Way::kRemove, origin, samples);
}
std::int64_t SoilWriter::add(const Coord3& origin, const SampleWords& samples) {
  return change(Way::kAdd, origin, samples);
}

void SoilWriter::put(Chunk chunk) {
  Soil::State& state = *soil_.state_;
  SampleLeaf* leaf = state.find(chunk.origin);
  if (leaf == nullptr) {
    Soil::State::Accessor leaves(state.tree);
    state.add(leaf = new SampleLeaf(to_coord(chunk.origin)), leaves);
  }
  Chunk& mine = leaf->chunk;
  if (soil_.store_ != nullptr) state.use(mine);
  warm(mine);
  state.touch(mine);
  chunk.touched = mine.touched;
  chunk.used = mine.used;
  mine = std::move(chunk);
  recount(*leaf);
  state.note_above(mine);
}

void SoilWriter::copy_from(const Soil& other, const Coord3& origin) {
  if (const Chunk* chunk = other.find(origin)) return put(other.copy(*chunk));
  drop(origin);
}

void SoilWriter::drop(const Coord3& origin) {
  Soil::State& state = *soil_.state_;
  SampleLeaf* const leaf = state.find(origin);
  if (leaf == nullptr) return;
  Chunk& chunk = leaf->chunk;
  if (soil_.store_ != nullptr) state.use(chunk);
  warm(chunk);
  state.touch(chunk);
  delete state.tree.root().stealNode<SampleLeaf>(to_coord(origin), false, false);
  --state.chunks;
}

}  // namespace soilvdb
