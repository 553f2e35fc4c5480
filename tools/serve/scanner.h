// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A connected sensor, each of whose messages corrects the ground.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "soilvdb/survey.h"
#include "tools/serve/feeder.h"

namespace soilvdb::tools {

/// Its points are read beside the feeds. A message is answered when its correction is on disk.
class Scanner : public Feeder {
 public:
  Scanner(ServerState& state, Socket socket);

 private:
  struct Scan;
  void take(boost::beast::flat_buffer message, std::uint64_t size) override;
  /// @throw std::invalid_argument with one line
  void look_up(Scan& scan, std::uint64_t size);
  void correct(const std::shared_ptr<Scan>& scan);
  /// Answers when `updates` are on disk.
  void wait_for_disk(std::uint64_t updates);
  void refuse(const std::string& why);
  std::shared_ptr<Scanner> self();

  boost::asio::steady_timer disk_;
  std::shared_ptr<nlohmann::ordered_json> made_;  // the answer, until it may be sent
};

}  // namespace soilvdb::tools
