// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/scanner.h"

#include <fmt/format.h>

#include <boost/asio/post.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "io/file/json.h"
#include "tools/serve/scan_message.h"

namespace soilvdb::tools {
namespace {

constexpr std::chrono::milliseconds kLookAtDisk{2};
constexpr const char* kTakenBack = "states were taken back meanwhile; send the scan again";

}  // namespace

struct Scanner::Scan {
  boost::beast::flat_buffer message;
  std::optional<ScanHead> head = {};
  Sensor sensor = {};
  std::vector<Vec3> points_m = {};
  std::uint64_t undos = 0;  // of the site, when the sensor was placed
  std::string fault = {};

  std::string_view bytes() const {
    return {static_cast<const char*>(message.data().data()), message.size()};
  }
};

Scanner::Scanner(ServerState& state, Socket socket)
    : Feeder(state, std::move(socket), kMostScanBytes), disk_(state.io) {}

std::shared_ptr<Scanner> Scanner::self() {
  return std::static_pointer_cast<Scanner>(shared_from_this());
}

void Scanner::refuse(const std::string& why) {
  answer(io::to_text(nlohmann::ordered_json{{"error", why}}));
}

void Scanner::look_up(Scan& scan, std::uint64_t size) {
  if (!state_.options.takes_feeds) throw std::invalid_argument(kOnlyLookedAt);
  if (size > kMostScanBytes)
    throw std::invalid_argument(
        fmt::format("message: it has {} bytes, and may have {}; send the scan in parts, or fewer "
                    "of its points",
                    size, kMostScanBytes));
  if (socket_.got_text())
    throw std::invalid_argument("message: it is a text; scans are binary messages");
  if (state_.undoing) throw std::invalid_argument(kTakenBack);
  scan.head.emplace(scan.bytes());
  scan.undos = state_.site.undos();
  scan.sensor = state_.site.sensor_of(*scan.head);
}

void Scanner::take(boost::beast::flat_buffer message, std::uint64_t size) {
  const auto scan = std::make_shared<Scan>(Scan{std::move(message)});
  try {
    look_up(*scan, size);
  } catch (const std::exception& e) {
    return refuse(e.what());
  }
  const bool taken = state_.scans.try_run(source_->name, [scanner = self(), scan]() mutable {
    try {
      scan->points_m = scan_points(*scan->head, scan->bytes(), scan->sensor);
    } catch (const std::exception& e) {
      scan->fault = e.what();
    }
    scan->message = {};
    boost::asio::io_context& io = scanner->state_.io;
    boost::asio::post(io, [scanner = std::move(scanner), scan] { scanner->correct(scan); });
  });
  if (!taken) refuse("too many scans are waiting; send this one again later");
}

void Scanner::correct(const std::shared_ptr<Scan>& scan) {
  // A state that was taken back may have placed its sensor.
  if (state_.undoing || scan->undos != state_.site.undos()) return refuse(kTakenBack);
  if (!scan->fault.empty()) return refuse(scan->fault);
  try {
    made_ = std::make_shared<nlohmann::ordered_json>(
        state_.site.scan(*scan->head, scan->sensor, scan->points_m));
  } catch (const std::exception& e) {
    return refuse(e.what());
  }
  state_.tell_soon();
  wait_for_disk(state_.site.session().hurry());
}

void Scanner::wait_for_disk(std::uint64_t updates) {
  const Session& session = state_.site.session();
  const io::JournalExtent done = session.acknowledged();
  if (done.updates >= updates) {
    if (done.updates > 0) (*made_)["acknowledged_s"] = done.time_s;
    return answer(io::to_text(*made_));
  }
  if (const std::string why = session.recording_fault(); !why.empty())
    return refuse(kNotOnDisk + why);
  disk_.expires_after(kLookAtDisk);
  disk_.async_wait([scanner = self(), updates](const boost::system::error_code& error) {
    if (!error) scanner->wait_for_disk(updates);
  });
}

}  // namespace soilvdb::tools
