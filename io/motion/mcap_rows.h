// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows of a motion out of the messages of an MCAP file's topic: what joints, poses and transforms
// share.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "io/mcap/mcap_reader.h"
#include "io/motion/mcap_messages.h"
#include "io/motion/row_source.h"

namespace soilvdb::inline v0::io {

/// What is known of a file once it was read.
struct McapFacts {
  /// A frame and the one it hangs on.
  struct Link {
    std::string child, parent;
    std::optional<Pose> fixed;  ///< where it is there, if it never moves
  };
  McapChannels channels;
  std::vector<Link> links;  ///< of transforms: from the bucket's frame up
};

enum class McapType { kJointState, kPoseStamped, kTransforms };

/// The type of a topic's messages. Those topics are looked at that are motions of some machine.
/// @throw InputError if that is none of a motion, or isn't encoded as one
McapType type_of(const std::filesystem::path& file, const McapChannel& channel);

/// The messages of one topic, with their numbers from 1 on.
class McapRows : public RowSource {
 public:
  explicit McapRows(const MotionSource& source);

  const RowPlace& place() const override { return place_; }
  const Columns& columns() const override { return columns_; }
  std::int64_t bytes_read() const override { return reader_.bytes_read(); }
  void warn(std::vector<std::string>& warnings) const override;
  MotionSource source() const override;

  RowMark mark() const override;
  void go_to(const RowMark& mark) override;
  std::string time_text() const override { return stamp_.text(); }

 protected:
  class Place : public RowPlace {
   public:
    explicit Place(const std::filesystem::path& file) : RowPlace(file, "message") {}
    void set_number(long number) { number_ = number; }
  };

  /// The next message of a topic that `wanted` says yes to, by channel. @return false at the end
  template <typename F>
  bool next_message(F wanted, McapReader::Message& message) {
    while (reader_.next(message))
      if (wanted(*message.channel)) return true;
    return false;
  }
  /// The next of the topic, counted.
  bool next_of_topic(std::string_view& data);

  /// Calls `f` for what comes of a message. @throw LineError instead of CdrError
  template <typename F>
  void decoded(F f) const {
    try {
      f();
    } catch (const CdrError& e) {
      place_.fail(std::string("is no ") + type_name() + " in CDR: it " + e.what());
    }
  }
  virtual const char* type_name() const = 0;

  MotionSource source_;
  McapReader reader_;
  Place place_;
  Columns columns_;
  RosTime stamp_;  // of the row
  std::shared_ptr<const McapFacts> facts_;
};

/// Rows of transforms.
std::unique_ptr<RowSource> mcap_tf_rows(const MotionSource& source);

}  // namespace soilvdb::inline v0::io
