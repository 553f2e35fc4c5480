// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A survey that somebody posts, as new ground of a live site.
#pragma once

#include <boost/asio/steady_timer.hpp>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "tools/run/survey_input.h"
#include "tools/serve/server_state.h"
#include "tools/serve/temp_folder.h"

namespace soilvdb::tools {

inline constexpr std::uint64_t kMostSurveyBytes = std::uint64_t{512} << 20;

/// Removes folders of surveys that a killed server left.
void remove_left_surveys();

/// Reads its file on a thread of queries, and then takes it in parts, between which feeds have
/// their turn. Each part is an update; if it ends early, the parts so far are taken, and the same
/// survey again takes the rest. There is one at a time.
class SurveyPost : public std::enable_shared_from_this<SurveyPost> {
 public:
  /// Makes a folder for its file.
  /// @param from its sender @throw std::exception with one line for wrong parameters, or if another
  /// one is at work
  SurveyPost(ServerState& state, const std::string& target, std::string from);
  ~SurveyPost();
  SurveyPost(const SurveyPost&) = delete;
  SurveyPost& operator=(const SurveyPost&) = delete;

  /// Where whoever receives it puts it.
  std::filesystem::path file() const { return folder_->path() / "survey"; }
  /// The file is complete. @param done called once, later
  void take(std::function<void(Reply)> done);

 private:
  void begin();
  void read(Session& site);
  void next();
  void finish(std::uint64_t updates);
  void refuse(unsigned status, const std::string& why);
  std::string without_folder(std::string why) const;

  ServerState& state_;
  const std::string from_;
  std::optional<TempFolder> folder_;
  int lock_ = -1;        ///< of the folder, for as long as this process lives
  std::string surface_;  ///< name of one of several in the file
  SurveyOptions options_;
  SurveyInput input_;
  Vec3 middle_ = Vec3::Zero(), origin_ = Vec3::Zero();  ///< of the survey; of its columns
  std::size_t taken_ = 0;                               ///< parts
  SurveyVolumes volumes_;
  boost::asio::steady_timer disk_;
  std::function<void(Reply)> done_;
};

}  // namespace soilvdb::tools
