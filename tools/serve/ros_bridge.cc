// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/ros_bridge.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <exception>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "io/file/json.h"
#include "io/file/text.h"
#include "soilvdb/io/error.h"
#include "tools/run/ros_messages.h"
#include "tools/run/text.h"
#include "tools/serve/ros_types.h"
#include "tools/serve/server_state.h"

namespace soilvdb::tools {
namespace {

namespace net = boost::asio;
using Json = nlohmann::ordered_json;

constexpr std::chrono::seconds kMapEvery{1}, kRefuseEvery{10};

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t host_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

std::vector<DdsTopic> topics_of(const RosStates& states) {
  std::vector<DdsTopic> topics;
  for (const RosStates::Input& input : states.inputs()) {
    DdsTopic& topic = topics.emplace_back(DdsTopic{dds_topic(input.topic), {}, input.fixed});
    for (const io::McapType type : input.types) topic.types.push_back(dds_type(type_name(type)));
  }
  return topics;
}

}  // namespace

RosBridge::RosBridge(ServerState& state, const RosOptions& options)
    : state_(state), states_(options.machines), map_(*state.copy) {
  require_topics({});
  for (const RosMachine& machine : options.machines) {
    Fed& fed = fed_.emplace_back(Fed{machine});
    fed.source->name = "ROS 2 topic " + io::printable(machine.topic.topic);
    const io::McapTopic* world = machine.chain ? machine.topic.base.get() : &machine.topic;
    for (std::size_t i = 0; i < states_.inputs().size(); ++i) {
      const RosStates::Input& input = states_.inputs()[i];
      const auto& more = machine.topic.more_topics;
      const bool moves = input.topic == machine.topic.topic ||
                         std::find(more.begin(), more.end(), input.topic) != more.end();
      if (moves) fed.movers.push_back(i);
      if (moves || (world != nullptr &&
                    (input.topic == world->topic || input.topic == world->topic + "_static")))
        fed.inputs.push_back(i);
    }
    if (world != nullptr && !world->parent.empty()) frame_ = world->parent;
  }
  work_soon_ = [this, asked = std::make_shared<std::atomic<bool>>(false)] {
    if (asked->exchange(true)) return;
    net::post(state_.io, [this, asked] {
      *asked = false;
      work();
    });
  };
  dds_ = std::make_unique<Dds>(options.domain, options.only_this_computer, topics_of(states_),
                               work_soon_);
  ground_ = dds_->add_writer(
      {dds_topic("/soilvdb/ground"), {dds_type("grid_map_msgs/GridMap")}, /*latched=*/true});
}

void RosBridge::work() {
  if (state_.undoing || state_.ending) return;
  if (waiting_.empty())
    for (Dds::Message& message : dds_->take()) waiting_.push_back(std::move(message));
  const bool any = !waiting_.empty();
  for (const std::string& warning : dds_->take_warnings()) say("warning: ROS 2: " + warning);
  const auto until = Clock::now() + kFeedTurn;
  do {
    if (!waiting_.empty()) {
      take(waiting_.front());
      waiting_.pop_front();
    }
    for (const RosStates::State& state : states_.states(now_ns())) feed(state);
  } while (!waiting_.empty() && Clock::now() < until);
  for (const RosStates::Fault& fault : states_.take_faults())
    for (Fed& fed : fed_)
      if (fed.of.machine == fault.machine) refuse(fed, fault.why);
  publish();
  if (any) work_soon_();
}

void RosBridge::take(const Dds::Message& message) {
  const RosStates::Input& input = states_.inputs()[message.topic];
  const io::McapType type = input.types[message.type];
  try {
    for (const std::size_t machine :
         states_.take(message.topic, type, message.cdr, now_ns(), host_ns()))
      for (Fed& fed : fed_) {
        if (fed.of.machine != machine) continue;
        fed.heard = true;
        fed.source->heard();
        set_link(fed, FeedSource::Link::kLive);
      }
  } catch (const io::CdrError& e) {
    for (Fed& fed : fed_)
      if (std::find(fed.inputs.begin(), fed.inputs.end(), message.topic) != fed.inputs.end())
        refuse(fed, fmt::format("a message of {} {}", type_name(type), e.what()));
  }
}

void RosBridge::feed(const RosStates::State& state) {
  const auto fed = std::find_if(fed_.begin(), fed_.end(),
                                [&](const Fed& one) { return one.of.machine == state.machine; });
  Json line = {{"machine", state_.site.session().machines()[state.machine].name},
               {"time", io::stamp_s(state.time_ns)}};
  if (fed->of.chain) {
    line["joints"] = Json::object();
    std::size_t i = 0;
    for (const std::string& name : fed->of.chain->movable())
      line["joints"][name] = state.joints[i++];
  }
  if (state.pose) {
    Json& at = fed->of.chain ? line["base"] : line;
    at["position"] = io::numbers(state.pose->position);
    at["rotation"] = io::numbers(state.pose->rotation.coeffs());
  }
  const Json answer = Json::parse(state_.feed_of(fed->source)(io::to_text(line)));
  if (answer.contains("error")) refuse(*fed, answer["error"].get<std::string>());
  if (answer.contains("warning"))
    say(fmt::format("warning: machine '{}': {}", line["machine"].get<std::string>(),
                    answer["warning"].get<std::string>()));
  publish();
}

/// A robot sends a bad state again and again, and gets no answer.
void RosBridge::refuse(Fed& fed, const std::string& why) {
  const Clock::time_point now = Clock::now();
  if (now - fed.told < kRefuseEvery) {
    ++fed.untold;
    return;
  }
  fed.told = now;
  const std::size_t before = std::exchange(fed.untold, 0);
  say(fmt::format("warning: machine '{}': {}: {}{}", fed.of.name, fed.source->name, why,
                  before > 0 ? fmt::format(" (and {} refused since the last such line)", before)
                             : std::string()));
}

void RosBridge::set_link(Fed& fed, FeedSource::Link link) {
  if (fed.source->set_link(link)) state_.tell_soon();
}

void RosBridge::listen(std::chrono::duration<double> passed) {
  if (state_.undoing) return;
  for (Fed& fed : fed_) {
    if (!fed.heard) continue;
    fed.source->silent_s += passed.count();
    const bool is_there = std::all_of(fed.movers.begin(), fed.movers.end(),
                                      [&](std::size_t input) { return dds_->senders(input) > 0; });
    if (!is_there)
      set_link(fed, FeedSource::Link::kBroken);
    else if (fed.source->silent_s >= kLost_s)
      set_link(fed, FeedSource::Link::kSilent);
  }
}

void RosBridge::require_topics(const nlohmann::json& change) const {
  const Session& session = state_.site.session();
  std::vector<std::string> names;
  for (std::size_t i = 0; i < session.machines().size(); ++i)
    if (!session.is_retired(i)) names.push_back(session.machines()[i].name);
  const auto text = [&](const char* pointer) {
    const nlohmann::json::json_pointer at(pointer);
    return change.contains(at) && change[at].is_string() ? change[at].get<std::string>() : "";
  };
  std::erase(names, text("/rename/from"));
  for (const char* pointer : {"/add/name", "/rename/to", "/restore"})
    if (const std::string name = text(pointer); !name.empty()) names.push_back(name);
  std::map<std::string, std::string> by_topic;
  for (const std::string& name : names) {
    const auto [found, is_first] = by_topic.emplace(ros_name(name), name);
    if (!is_first && found->second != name)
      throw io::InputError(fmt::format(
          "machines '{}' and '{}' would both have the topics /soilvdb/{} of ROS 2; rename one of "
          "them",
          io::printable(found->second), io::printable(name), found->first));
  }
}

std::string RosBridge::frame_of(std::size_t machine) const {
  for (const Fed& fed : fed_)
    if (fed.of.machine == machine && !fed.of.topic.frame.empty()) return fed.of.topic.frame;
  return state_.site.session().machines()[machine].name + "_bucket";
}

void RosBridge::publish() {
  const Session& session = state_.site.session();
  told_.resize(session.machines().size());
  for (std::size_t i = 0; i < told_.size(); ++i)
    if (!session.is_retired(i)) publish(i, told_[i]);
}

void RosBridge::publish(std::size_t machine, Told& told) {
  Session& session = state_.site.session();
  const SiteMachine& of = session.machines()[machine];
  const bool soil_moves = session.earthmoving().soil.has_value();
  const bool has_force = soil_moves && !of.bucket.shape;
  if (told.name != of.name) {
    told = {of.name};
    const std::string topic = dds_topic("/soilvdb/" + ros_name(of.name));
    told.load = dds_->add_writer({topic + "/load", {dds_type("std_msgs/Float64")}});
    if (soil_moves)
      told.mass = dds_->add_writer({topic + "/load_kg", {dds_type("std_msgs/Float64")}});
    if (has_force)
      told.wrench =
          dds_->add_writer({topic + "/wrench", {dds_type("geometry_msgs/WrenchStamped")}});
  }
  const std::optional<MachineState> last = session.last(machine);
  if (!last ||
      (told.pose && told.time_s == last->time_s && row_of(*told.pose) == row_of(last->pose)))
    return;
  told.time_s = last->time_s;
  told.pose = last->pose;
  dds_->write(told.load, float_message(session.ledger(machine).bucket_m3()));
  if (soil_moves) dds_->write(told.mass, float_message(session.bucket_kg(machine)));
  if (!has_force || !dds_->is_read(told.wrench)) return;
  try {
    const std::array<double, 6> force = wrench_numbers(session.resistance(machine).total());
    dds_->write(told.wrench,
                wrench_message(last->time_s.value_or(static_cast<double>(host_ns()) * 1e-9),
                               frame_of(machine), force));
  } catch (const std::exception&) {  // no force is known here
  }
}

void RosBridge::tick(std::span<const Coord3> changed, GroundCopy& beside) {
  changed_.insert(changed_.end(), changed.begin(), changed.end());
  const Clock::time_point now = Clock::now();
  if (mapping_ || changed_.empty() || now - mapped_ < kMapEvery) return;
  mapping_ = true;
  mapped_ = now;
  const double time_s = state_.site.time_s().value_or(static_cast<double>(host_ns()) * 1e-9);
  beside.run([this, time_s, changed = std::exchange(changed_, {})] {
    map_.update(changed);
    net::post(state_.io,
              [this, message = grid_map_message(time_s, frame_, map_, state_.copy->origin())] {
                mapping_ = false;
                dds_->write(ground_, message);
              });
  });
}

}  // namespace soilvdb::tools
