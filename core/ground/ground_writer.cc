// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/ground/ground_writer.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <optional>
#include <utility>

#include "core/ground/ground_state.h"
#include "core/lattice/affine.h"

namespace soilvdb::inline v0 {
namespace {

/// Updates the counts and the mask of a chunk from its samples.
SOILVDB_FOR_CPUS void recount(SampleLeaf& leaf) {
  leaf.chunk.soil_count = static_cast<std::uint16_t>(leaf.chunk.samples.count());
  leaf.chunk.loose_count = static_cast<std::uint16_t>(leaf.chunk.loose.count());
  for (int g = 0; g < 8; ++g)
    leaf.getValueMask().getWord<std::uint64_t>(g) = leaf.chunk.samples.occupied(g);
}

bool is_air(const SampleWords& words) {
  return std::all_of(words.begin(), words.end(), [](std::uint64_t word) { return word == 0; });
}

/// Removes loose samples that are not soil.
void keep_loose_in(const Samples& soil, Samples& loose) {
  for (int g = 0; g < kChunkVoxels / 64; ++g) {
    for (std::uint64_t left = loose.occupied(g); left != 0; left &= left - 1) {
      const int n = 64 * g + std::countr_zero(left);
      const std::uint64_t word = loose.word(n);
      if ((word & ~soil.word(n)) != 0) loose.set_word(n, word & soil.word(n));
    }
  }
}

/// True if a chunk has soil where the initial terrain has air.
bool exceeds(const Samples& samples, const SampleWords& base) {
  for (int n = 0; n < kChunkVoxels; ++n)
    if ((samples.word(n) & ~base[static_cast<std::size_t>(n)]) != 0) return true;
  return false;
}

}  // namespace

/// The leaf of an edit: of the tree, or made outside it.
struct GroundWriter::Target {
  SampleLeaf* leaf = nullptr;
  std::unique_ptr<SampleLeaf> made;
  std::optional<Chunk> before;  // for GroundUndo
  bool left_out = false, changed = false;
};

void GroundWriter::edit(Operation operation, std::span<const Edit> edits, std::size_t parallel_work,
                        const Change& change) {
  std::vector<Target> targets(edits.size());
  const std::size_t work = find(operation, edits, targets);
  const auto run = [&](std::size_t i) {
    if (!targets[i].left_out) perform(operation, edits[i], targets[i], i, change);
  };
  try {
    if (work >= parallel_work) {
      tbb::parallel_for(std::size_t{0}, edits.size(), run);
    } else {
      for (std::size_t i = 0; i < edits.size(); ++i) run(i);
    }
  } catch (...) {
    book(targets);
    throw;
  }
  book(targets);
}

/// Finds the leaves, and skips edits without effect. @return the remaining work
std::size_t GroundWriter::find(Operation operation, std::span<const Edit> edits,
                               std::span<Target> targets) {
  Ground::State& state = *ground_.state_;
  const bool limited = ground_.store_ != nullptr;
  {
    std::shared_lock shared(state.mutex, std::defer_lock);
    std::unique_lock alone(state.mutex, std::defer_lock);
    limited ? alone.lock() : shared.lock();
    Ground::State::ConstAccessor leaves(state.tree);
    for (std::size_t i = 0; i < edits.size(); ++i) {
      Target& target = targets[i];
      target.leaf = const_cast<SampleLeaf*>(leaves.probeConstLeaf(to_coord(edits[i].origin)));
      if (target.leaf == nullptr) continue;
      target.left_out = operation == Operation::kRemove && target.leaf->chunk.soil_count == 0;
      if (target.left_out) continue;
      if (limited) state.use(target.leaf->chunk);
      if (state.before != nullptr && !state.before->contains(edits[i].origin))
        target.before = ground_.copy(target.leaf->chunk);
    }
  }
  std::size_t work = 0;
  for (std::size_t i = 0; i < edits.size(); ++i) {
    Target& target = targets[i];
    if (operation == Operation::kRemove && target.leaf == nullptr)
      target.left_out = ground_.classify(edits[i].origin) == Content::kAir;
    if (!target.left_out) work += edits[i].work;
  }
  return work;
}

/// Changes one chunk, after its leaf is made or its samples are read back.
void GroundWriter::perform(Operation operation, const Edit& edit, Target& target, std::size_t i,
                           const Change& change) {
  SampleWords read;
  const SampleWords* base = nullptr;  // null: not known
  const auto read_base = [&] {
    ground_.read_base(edit.origin, read);
    base = &read;
  };
  if (target.leaf == nullptr) {
    base = edit.soil;  // that of the terrain
    if (base == nullptr) read_base();
    if (operation == Operation::kRemove && is_air(*base)) return;
    target.made = std::make_unique<SampleLeaf>(to_coord(edit.origin));
    target.leaf = target.made.get();
    target.leaf->chunk.samples.assign(*base);
    recount(*target.leaf);
    target.leaf->chunk.base_count = target.leaf->chunk.soil_count;
  } else {
    load(target.leaf->chunk);
  }
  Chunk& chunk = target.leaf->chunk;
  try {
    target.changed = change(i, chunk.samples, chunk.loose);
  } catch (...) {
    target.changed = true;  // for all we know
    keep_loose_in(chunk.samples, chunk.loose);
    recount(*target.leaf);
    throw;
  }
  if (!target.changed) return;
  chunk.samples.trim();
  chunk.loose.trim();
  recount(*target.leaf);
  if (operation == Operation::kRemove || chunk.above) return;
  chunk.above = true;  // also if the base can't be read any more
  if (chunk.soil_count > chunk.base_count) return;
  if (base == nullptr) read_base();
  chunk.above = exceeds(chunk.samples, *base);
}

/// Adds the new leaves to the tree, and lists the chunks that appeared or changed.
void GroundWriter::book(std::span<Target> targets) {
  Ground::State& state = *ground_.state_;
  std::unique_lock alone(state.mutex, std::defer_lock);
  Ground::State::Accessor leaves(state.tree);
  for (Target& target : targets) {
    if (!target.changed && target.made == nullptr) continue;
    Chunk& chunk = target.leaf->chunk;
    if (target.made != nullptr && chunk.soil_count == 0 && chunk.base_count == 0) continue;
    if (!alone.owns_lock()) alone.lock();
    if (state.before != nullptr) state.before->try_emplace(chunk.origin, std::move(target.before));
    state.touch(chunk);
    state.note_above(chunk);
    if (target.made == nullptr) continue;
    if (ground_.store_ != nullptr) state.use(chunk, true);
    state.add(target.made.release(), leaves);
  }
}

/// Reads samples back from the swap store, if they are there.
void GroundWriter::load(Chunk& chunk) {
  if (chunk.swap_record == 0) return;
  const std::uint32_t swap_record = chunk.swap_record;
  ground_.store_->drop(swap_record, ground_.load(chunk));
}

std::int64_t GroundWriter::change(Operation operation, const Coord3& origin,
                                  const SampleWords& samples, Kind kind) {
  std::int64_t count = 0;
  const Edit edit{origin};
  this->edit(operation, {&edit, 1}, 2, [&](std::size_t, Samples& soil, Samples& loose) {
    for (int n = 0; n < kChunkVoxels; ++n) {
      const std::uint64_t word = soil.word(n);
      const std::uint64_t other =
          samples[static_cast<std::size_t>(n)] & (operation == Operation::kRemove ? word : ~word);
      if (other == 0) continue;
      soil.set_word(n, word ^ other);
      if (operation == Operation::kRemove)
        loose.set_word(n, loose.word(n) & ~other);
      else if (kind == Kind::kLoose)
        loose.set_word(n, loose.word(n) | other);
      count += std::popcount(other);
    }
    return count > 0;
  });
  return count;
}

std::int64_t GroundWriter::remove(const Coord3& origin, const SampleWords& samples) {
  return change(Operation::kRemove, origin, samples, Kind::kBank);
}
std::int64_t GroundWriter::add(const Coord3& origin, const SampleWords& samples, Kind kind) {
  return change(Operation::kAdd, origin, samples, kind);
}

void GroundWriter::put(Chunk chunk) {
  Ground::State& state = *ground_.state_;
  SampleLeaf* leaf = state.find(chunk.origin);
  if (leaf == nullptr) {
    Ground::State::Accessor leaves(state.tree);
    state.add(leaf = new SampleLeaf(to_coord(chunk.origin)), leaves);
  }
  Chunk& mine = leaf->chunk;
  if (ground_.store_ != nullptr) state.use(mine);
  load(mine);
  state.touch(mine);
  chunk.touched = mine.touched;
  chunk.used = mine.used;
  mine = std::move(chunk);
  recount(*leaf);
  state.note_above(mine);
}

void GroundWriter::copy_from(const Ground& other, const Coord3& origin) {
  if (const Chunk* chunk = other.find(origin)) return put(other.copy(*chunk));
  drop(origin);
}

void GroundWriter::drop(const Coord3& origin) {
  Ground::State& state = *ground_.state_;
  SampleLeaf* const leaf = state.find(origin);
  if (leaf == nullptr) return;
  Chunk& chunk = leaf->chunk;
  if (ground_.store_ != nullptr) state.use(chunk);
  load(chunk);
  state.touch(chunk);
  delete state.tree.root().stealNode<SampleLeaf>(to_coord(origin), false, false);
  --state.chunks;
}

struct GroundUndo::Before {
  Ground::State::Before chunks;
  std::vector<std::pair<std::weak_ptr<ChunkList>, ChunkList>> lists;  // of followers
  bool undone = false;
};

GroundUndo::GroundUndo(Ground& ground) : ground_(ground), before_(std::make_unique<Before>()) {
  ground_.tell_followers();
  for (const auto& follower : ground_.state_->followers)
    if (const auto list = follower.lock()) before_->lists.emplace_back(follower, *list);
  ground_.state_->before = &before_->chunks;
}

GroundUndo::~GroundUndo() {
  ground_.state_->before = nullptr;
  if (!before_->undone) return;
  ground_.tell_followers();
  for (auto& [follower, then] : before_->lists)
    if (const auto list = follower.lock()) *list = std::move(then);
}

void GroundUndo::undo() {
  before_->undone = true;
  GroundWriter writer(ground_);
  for (auto& [origin, chunk] : before_->chunks) {
    if (chunk)
      writer.put(std::move(*chunk));
    else
      writer.drop(origin);
  }
  before_->chunks.clear();
}

}  // namespace soilvdb::inline v0
