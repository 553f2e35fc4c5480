// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The one file with headers of Cyclone DDS. A type here is a name and bytes: messages come and go
// as they are, and io/mcap/cdr.h reads and writes them. Types made by its compiler, idlc, would
// need code for each message, and would drop bad messages without a word.
#include "tools/serve/dds.h"

#ifndef SOILVDB_DDS_LIBRARY

#include "soilvdb/io/error.h"

namespace soilvdb::tools {

struct Dds::State {};

Dds::Dds(int, bool, std::vector<DdsTopic>, std::function<void()>) {
  throw io::InputError(
      "--ros: this build has no ROS 2: install cyclonedds-dev (0.10), and then build soilvdb "
      "again");
}
Dds::~Dds() = default;
std::vector<Dds::Message> Dds::take() { return {}; }
std::vector<std::string> Dds::take_warnings() { return {}; }
std::size_t Dds::senders(std::size_t) const { return 0; }
std::size_t Dds::add_writer(const DdsTopic&) { return 0; }
bool Dds::is_read(std::size_t) const { return false; }
void Dds::write(std::size_t, std::string_view) {}

}  // namespace soilvdb::tools

#else

#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>
#include <dds/ddsi/q_radmin.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <stdexcept>
#include <utility>

#include "io/file/shared_library.h"
#include "io/file/text.h"

namespace soilvdb::tools {
namespace {

/// Functions of Cyclone DDS.
struct DdsLibrary {
  const io::SharedLibrary library{SOILVDB_DDS_LIBRARY, "Cyclone DDS", "ROS 2's messages"};
  SOILVDB_FUNCTIONS(dds_create_domain, dds_create_listener, dds_create_participant, dds_create_qos,
                    dds_create_reader, dds_create_topic_sertype, dds_create_writer, dds_delete,
                    dds_delete_listener, dds_delete_qos, dds_get_publication_matched_status,
                    dds_get_subscription_matched_status, dds_lset_data_available,
                    dds_qget_durability, dds_qget_reliability, dds_qset_durability,
                    dds_qset_history, dds_qset_reliability, dds_qset_userdata, dds_return_loan,
                    dds_strretcode, dds_take, dds_takecdr, dds_writecdr, ddsi_serdata_init,
                    ddsi_sertype_fini, ddsi_sertype_init, ddsi_sertype_v0);

  static const DdsLibrary& get() {
    static const DdsLibrary functions;
    return functions;
  }
  /// @return an entity that was made @throw std::runtime_error
  dds_entity_t made(dds_return_t result, const std::string& what) const {
    if (result >= 0) return result;
    throw std::runtime_error(fmt::format("DDS can't make {}: {}", what, dds_strretcode(-result)));
  }
};

constexpr std::int32_t kMostUntaken = 1000;
constexpr std::size_t kAlignment = 4;  // of the ends of messages in RTPS

/// Does a configuration surely name the loopback interface, and no other, for any domain? It must
/// not be named twice, but left out it would be another one.
bool names_loopback(std::string config) {
  constexpr std::string_view kFile = "file://";
  if (config.starts_with(kFile)) {
    std::ifstream file(config.substr(kFile.size()));
    config.assign(std::istreambuf_iterator<char>(file), {});
  }
  static const std::regex kComment("<!--[^]*?-->"), kList(",\\s*(file:|<)"),
      kOneDomain("<Domain\\b[^>]*\\bid\\s*=", std::regex::icase),
      kInterface("<NetworkInterface\\b[^>]*>"),
      kLoopback("\\b(address|name)\\s*=\\s*[\"'](127[.]0[.]0[.]1|lo)[\"']");
  config = std::regex_replace(config, kComment, "");
  if (std::regex_search(config, kList) || std::regex_search(config, kOneDomain)) return false;
  std::sregex_iterator each(config.begin(), config.end(), kInterface), end;
  return each != end && std::all_of(each, end, [](const std::smatch& found) {
           return std::regex_search(found.str(), kLoopback);
         });
}

/// Without multicast, which loopback often lacks, participants of one computer ask each other.
/// @param more configuration of the user
std::string config_of_this_computer(const std::string& more) {
  return fmt::format(
      "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast>{}</General><Discovery>"
      "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32"
      "</MaxAutoParticipantIndex><Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain>"
      "</CycloneDDS>{}{}",
      names_loopback(more) ? ""
                           : "<Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces>",
      more.empty() ? "" : ",", more);
}

/// A message. No type has keys, so that all messages of a topic belong to one instance.
struct DdsSample : ddsi_serdata {
  std::string cdr;

  static const DdsSample& of(const ddsi_serdata* data) {
    return *static_cast<const DdsSample*>(data);
  }
};

/// A new message, whose owner is the caller. @param size of its bytes, which are zero
DdsSample* new_sample(const ddsi_sertype* type, ddsi_serdata_kind kind, std::size_t size = 0) {
  auto* made = new DdsSample();
  DdsLibrary::get().ddsi_serdata_init(made, type, kind);
  made->cdr.resize((size + kAlignment - 1) / kAlignment * kAlignment);
  return made;
}

ddsi_serdata* sample_of_fragments(const ddsi_sertype* type, ddsi_serdata_kind kind,
                                  const nn_rdata* fragment, std::size_t size) {
  DdsSample* made = new_sample(type, kind, size);
  std::size_t done = 0;
  for (; fragment != nullptr; fragment = fragment->nextfrag) {  // they may overlap
    if (fragment->maxp1 <= done) continue;
    const unsigned char* from =
        NN_RMSG_PAYLOADOFF(fragment->rmsg, NN_RDATA_PAYLOAD_OFF(fragment)) + done - fragment->min;
    std::memcpy(made->cdr.data() + done, from, fragment->maxp1 - done);
    done = fragment->maxp1;
  }
  return made;
}

ddsi_serdata* sample_of_parts(const ddsi_sertype* type, ddsi_serdata_kind kind,
                              ddsrt_msg_iovlen_t count, const ddsrt_iovec_t* parts,
                              std::size_t size) {
  DdsSample* made = new_sample(type, kind, size);
  char* to = made->cdr.data();
  for (std::size_t i = 0; i < count; to += parts[i++].iov_len)
    std::memcpy(to, parts[i].iov_base, parts[i].iov_len);
  return made;
}

/// Without virtual functions: what Cyclone DDS calls of a message.
ddsi_serdata_ops sample_functions() {
  ddsi_serdata_ops all{};
  all.eqkey = [](const ddsi_serdata*, const ddsi_serdata*) { return true; };
  all.get_size = [](const ddsi_serdata* data) {
    return static_cast<std::uint32_t>(DdsSample::of(data).cdr.size());
  };
  all.from_ser = sample_of_fragments;
  all.from_ser_iov = sample_of_parts;
  all.from_keyhash = [](const ddsi_sertype* type, const ddsi_keyhash*) -> ddsi_serdata* {
    return new_sample(type, SDK_KEY);
  };
  all.from_sample = [](const ddsi_sertype*, ddsi_serdata_kind, const void*) -> ddsi_serdata* {
    return nullptr;  // there are bytes alone
  };
  all.to_ser = [](const ddsi_serdata* data, std::size_t from, std::size_t size, void* to) {
    std::memcpy(to, DdsSample::of(data).cdr.data() + from, size);
  };
  all.to_ser_ref = [](const ddsi_serdata* data, std::size_t from, std::size_t size,
                      ddsrt_iovec_t* to) {
    to->iov_base = const_cast<char*>(DdsSample::of(data).cdr.data()) + from;
    to->iov_len = size;
    return ddsi_serdata_ref(data);
  };
  all.to_ser_unref = [](ddsi_serdata* data, const ddsrt_iovec_t*) { ddsi_serdata_unref(data); };
  all.to_sample = [](const ddsi_serdata*, void*, void**, void*) { return false; };
  all.to_untyped = [](const ddsi_serdata* data) -> ddsi_serdata* {
    DdsSample* made = new_sample(data->type, SDK_KEY);
    made->type = nullptr;
    return made;
  };
  all.untyped_to_sample = [](const ddsi_sertype*, const ddsi_serdata*, void*, void**, void*) {
    return true;
  };
  all.free = [](ddsi_serdata* data) { delete static_cast<DdsSample*>(data); };
  all.print = [](const ddsi_sertype*, const ddsi_serdata* data, char* to, std::size_t size) {
    const std::string text = fmt::format("{} bytes", DdsSample::of(data).cdr.size());
    const std::size_t n = text.copy(to, size - 1);
    to[n] = '\0';
    return n;
  };
  all.get_keyhash = [](const ddsi_serdata*, ddsi_keyhash* to, bool) { *to = {}; };
  return all;
}

/// The same of a type.
ddsi_sertype_ops type_functions() {
  ddsi_sertype_ops all{};
  all.version = DdsLibrary::get().ddsi_sertype_v0;
  all.free = [](ddsi_sertype* type) {
    DdsLibrary::get().ddsi_sertype_fini(type);
    delete type;
  };
  all.zero_samples = [](const ddsi_sertype*, void*, std::size_t) {};
  all.realloc_samples = [](void**, const ddsi_sertype*, void*, std::size_t, std::size_t) {};
  all.free_samples = [](const ddsi_sertype*, void**, std::size_t, dds_free_op_t) {};
  all.equal = [](const ddsi_sertype*, const ddsi_sertype*) { return true; };
  all.hash = [](const ddsi_sertype*) { return std::uint32_t{0}; };
  return all;
}

/// A topic of one type. @param type receives the type that its messages have
dds_entity_t make_topic(dds_entity_t participant, const std::string& name,
                        const std::string& type_name, const ddsi_sertype** type = nullptr) {
  static const ddsi_serdata_ops samples = sample_functions();
  static const ddsi_sertype_ops types = type_functions();
  const DdsLibrary& dds = DdsLibrary::get();
  auto* made = new ddsi_sertype();
  dds.ddsi_sertype_init(made, type_name.c_str(), &types, &samples, /*topickind_no_key=*/true);
  made->allowed_data_representation = DDS_DATA_REPRESENTATION_FLAG_XCDR1;
  const dds_return_t topic =
      dds.dds_create_topic_sertype(participant, name.c_str(), &made, nullptr, nullptr, nullptr);
  if (topic < 0) types.free(made);
  if (type != nullptr) *type = made;
  return dds.made(topic, fmt::format("topic '{}'", name));
}

using DdsQos = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

DdsQos make_qos(bool reliable, bool latched, std::int32_t kept, const std::string& user_data) {
  const DdsLibrary& dds = DdsLibrary::get();
  DdsQos qos(dds.dds_create_qos(), dds.dds_delete_qos);
  constexpr dds_duration_t kMostBlocked = DDS_MSECS(0);  // a slow reader must not stop a site
  dds.dds_qset_reliability(
      qos.get(), reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, kMostBlocked);
  dds.dds_qset_durability(qos.get(),
                          latched ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds.dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, kept);
  dds.dds_qset_userdata(qos.get(), user_data.data(), user_data.size());
  return qos;
}

}  // namespace

struct Dds::State {
  struct Reader {
    std::size_t topic = 0, type = 0;
    bool reliable = true;
    dds_entity_t entity = 0;
  };
  struct Writer {
    dds_entity_t entity = 0;
    const ddsi_sertype* type = nullptr;
  };

  State(int number, bool only_this_computer, std::vector<DdsTopic> all, std::function<void()> f)
      : topics(std::move(all)), wake(std::move(f)) {
    if (only_this_computer) {
      const char* more = std::getenv("CYCLONEDDS_URI");
      const std::string config = config_of_this_computer(more == nullptr ? "" : more);
      domain = dds.made(dds.dds_create_domain(static_cast<dds_domainid_t>(number), config.c_str()),
                        "a domain");
    }
    try {
      participant = dds.made(
          dds.dds_create_participant(static_cast<dds_domainid_t>(number), nullptr, nullptr),
          fmt::format("a participant of domain {}", number));
      listener = dds.dds_create_listener(this);
      dds.dds_lset_data_available(
          listener, [](dds_entity_t, void* self) { static_cast<State*>(self)->wake(); });
      publications = dds.made(
          dds.dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, nullptr, listener),
          "a reader of who is there");
    } catch (...) {
      close();
      throw;
    }
  }
  ~State() { close(); }

  void close() {
    if (participant > 0) dds.dds_delete(participant);  // waits for the listener
    if (domain > 0) dds.dds_delete(domain);
    if (listener != nullptr) dds.dds_delete_listener(listener);
  }

  /// Looks at who publishes what.
  void discover() {
    constexpr std::uint32_t kMost = 16;
    for (dds_return_t n = 1; n > 0;) {
      std::array<void*, kMost> found{};
      std::array<dds_sample_info_t, kMost> infos;
      n = dds.dds_take(publications, found.data(), infos.data(), kMost, kMost);
      for (dds_return_t i = 0; i < n; ++i) {
        const auto at = static_cast<std::size_t>(i);
        if (infos[at].valid_data && infos[at].instance_state == DDS_IST_ALIVE)
          look_at(*static_cast<const dds_builtintopic_endpoint_t*>(found[at]));
      }
      if (n > 0) dds.dds_return_loan(publications, found.data(), n);
    }
  }

  void look_at(const dds_builtintopic_endpoint_t& writer) {
    dds_reliability_kind_t reliability = DDS_RELIABILITY_BEST_EFFORT;
    dds.dds_qget_reliability(writer.qos, &reliability, nullptr);
    for (std::size_t i = 0; i < topics.size(); ++i) {
      if (topics[i].name != writer.topic_name) continue;
      const auto& types = topics[i].types;
      const auto type = std::find_if(types.begin(), types.end(), [&](const DdsType& known) {
        return known.name == writer.type_name;
      });
      if (type != types.end())
        read(i, static_cast<std::size_t>(type - types.begin()),
             reliability == DDS_RELIABILITY_RELIABLE);
      else if (warned.insert(topics[i].name + ' ' + writer.type_name).second)
        warnings.push_back(fmt::format("topic '{}' is published as {}; it is read as {}",
                                       io::printable(topics[i].name),
                                       io::printable(writer.type_name), types.front().name));
    }
  }

  void read(std::size_t topic, std::size_t type, bool reliable) {
    const auto found = std::find_if(readers.begin(), readers.end(), [&](const Reader& reader) {
      return reader.topic == topic && reader.type == type;
    });
    if (found != readers.end() && (reliable || !found->reliable)) return;
    Reader& reader = found != readers.end() ? *found : readers.emplace_back();
    if (reader.entity > 0) dds.dds_delete(reader.entity);
    const DdsTopic& of = topics[topic];
    reader = {topic, type, reliable, 0};
    const auto qos = make_qos(reliable, of.latched, kMostUntaken, of.types[type].user_data);
    reader.entity = dds.made(
        dds.dds_create_reader(participant, make_topic(participant, of.name, of.types[type].name),
                              qos.get(), listener),
        fmt::format("a reader of topic '{}'", of.name));
  }

  const DdsLibrary& dds = DdsLibrary::get();
  const std::vector<DdsTopic> topics;
  const std::function<void()> wake;
  dds_entity_t domain = 0, participant = 0, publications = 0;
  dds_listener_t* listener = nullptr;
  std::vector<Reader> readers;
  std::vector<Writer> writers;
  std::vector<std::string> warnings;
  std::set<std::string> warned;
};

Dds::Dds(int domain, bool only_this_computer, std::vector<DdsTopic> topics,
         std::function<void()> wake)
    : state_(std::make_unique<State>(domain, only_this_computer, std::move(topics),
                                     std::move(wake))) {}

Dds::~Dds() = default;

std::vector<Dds::Message> Dds::take() {
  State& s = *state_;
  s.discover();
  constexpr std::uint32_t kMost = 64;
  std::vector<std::pair<dds_time_t, Message> > messages;
  for (const State::Reader& reader : s.readers) {
    std::array<ddsi_serdata*, kMost> taken{};
    std::array<dds_sample_info_t, kMost> infos;
    const dds_return_t n =
        s.dds.dds_takecdr(reader.entity, taken.data(), kMost, infos.data(), DDS_ANY_STATE);
    for (std::size_t i = 0; static_cast<dds_return_t>(i) < n; ++i) {
      if (infos[i].valid_data)
        messages.push_back(
            {infos[i].source_timestamp, {reader.topic, reader.type, DdsSample::of(taken[i]).cdr}});
      ddsi_serdata_unref(taken[i]);
    }
  }
  std::stable_sort(messages.begin(), messages.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Message> all;
  for (auto& [time, message] : messages) all.push_back(std::move(message));
  return all;
}

std::vector<std::string> Dds::take_warnings() { return std::exchange(state_->warnings, {}); }

std::size_t Dds::senders(std::size_t topic) const {
  std::size_t count = 0;
  for (const State::Reader& reader : state_->readers) {
    dds_subscription_matched_status_t status{};
    if (reader.topic == topic &&
        state_->dds.dds_get_subscription_matched_status(reader.entity, &status) == DDS_RETCODE_OK)
      count += status.current_count;
  }
  return count;
}

std::size_t Dds::add_writer(const DdsTopic& topic) {
  State& s = *state_;
  State::Writer writer;
  const DdsType& type = topic.types.front();
  const dds_entity_t entity = make_topic(s.participant, topic.name, type.name, &writer.type);
  constexpr std::int32_t kKept = 10, kLatched = 1;
  const auto qos =
      make_qos(/*reliable=*/true, topic.latched, topic.latched ? kLatched : kKept, type.user_data);
  writer.entity = s.dds.made(s.dds.dds_create_writer(s.participant, entity, qos.get(), nullptr),
                             fmt::format("a writer of topic '{}'", topic.name));
  s.writers.push_back(writer);
  return s.writers.size() - 1;
}

bool Dds::is_read(std::size_t writer) const {
  dds_publication_matched_status_t status{};
  return state_->dds.dds_get_publication_matched_status(state_->writers[writer].entity, &status) ==
             DDS_RETCODE_OK &&
         status.current_count > 0;
}

void Dds::write(std::size_t writer, std::string_view cdr) {
  const State::Writer& to = state_->writers[writer];
  DdsSample* made = new_sample(to.type, SDK_DATA, cdr.size());
  std::copy(cdr.begin(), cdr.end(), made->cdr.begin());
  // A reader that doesn't keep up misses messages, which are followed by newer ones.
  state_->dds.dds_writecdr(to.entity, made);
}

}  // namespace soilvdb::tools

#endif
