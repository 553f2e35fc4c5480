// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// States that are taken back.

#include <boost/asio/post.hpp>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "io/file/json.h"
#include "tools/serve/server_state.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

/// @param took the key of the time that it takes
Reply reply_of(const std::string& name, double time_s, const StatesAfter& after, const char* took,
               double took_s) {
  const Json json = {{"machine", name},
                     {"time_s", time_s},
                     {"states", after.states},
                     {"others", after.others},
                     {took, took_s}};
  return {200, "application/json", io::to_text(json) + '\n'};
}

constexpr const char* kNotRecorded = "nothing is recorded here, so nothing can be taken back";

}  // namespace

bool ServerState::waits_for_undo(std::function<void()> go_on) {
  if (undoing) waiting_feeds.push_back(std::move(go_on));
  return undoing;
}

void ServerState::ask_undo(std::size_t machine, double time_s, const std::string& client,
                           std::function<void(Reply)> done) {
  if (!history || !site.recorded()) throw std::invalid_argument(kNotRecorded);
  site.session().flush();
  query(
      other_times, client,
      [this, machine, time_s, name = site.session().machines()[machine].name] {
        const StatesAfter after = history->states_after(machine, time_s);
        return reply_of(name, time_s, after, "about_s", after.about_s);
      },
      std::move(done));
}

void ServerState::undo(std::size_t machine, double time_s, std::function<void(Reply)> done) {
  if (!history || !site.recorded()) throw std::invalid_argument(kNotRecorded);
  site.session().flush();
  struct UndoWork {
    StatesAfter after = {};
    std::shared_ptr<Undone> undone = {};
    std::optional<FedStates> fed = {};
  };
  const Clock::time_point begin = Clock::now();
  const auto made = std::make_shared<UndoWork>();
  undoing = true;
  query(
      other_times, "",
      [this, made, machine, time_s, every_s = site.session().recording().snapshot_every_s] {
        made->after = history->states_after(machine, time_s);
        if (made->after.states == 0) return Reply();
        auto [undone, fed] = history->without(made->after, every_s, [this] {
          if (ending) throw std::runtime_error(kEnded);
        });
        made->undone = std::move(undone);
        made->fed = std::move(fed);
        return Reply();
      },
      [this, made, machine, time_s, begin, done = std::move(done)](Reply reply) {
        try {
          beside->finish();  // its jobs look at the machines
          if (made->undone) site.undo(machine, *made->undone, std::move(*made->fed));
          if (reply.status == 200)
            reply = reply_of(site.session().machines()[machine].name, time_s, made->after, "took_s",
                             std::chrono::duration<double>(Clock::now() - begin).count());
        } catch (const std::exception& e) {
          reply = refusal(500, e.what());
        }
        undoing = false;
        tell_soon();
        for (auto& go_on : std::exchange(waiting_feeds, {}))
          boost::asio::post(io, std::move(go_on));
        done(std::move(reply));
      });
}

}  // namespace soilvdb::tools
