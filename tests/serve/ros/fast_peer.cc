// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A node as ROS 2 would have it, with Fast DDS, the middleware that most installations have. Its
// messages are any bytes. Lines of the standard input are commands; tests/serve/peers.py knows
// them.
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <iostream>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "hex.h"

namespace {

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

constexpr std::uint32_t kMostBytes = 1 << 20;

std::mutex output;

void print(const std::string& line) {
  const std::scoped_lock lock(output);
  std::cout << line << std::endl;
}

/// Bytes with their head, under the name of a type.
class Bytes : public fast::TopicDataType {
 public:
  explicit Bytes(const std::string& name) {
    setName(name.c_str());
    m_typeSize = kMostBytes;
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
    const std::string& bytes = *static_cast<std::string*>(data);
    std::memcpy(payload->data, bytes.data(), bytes.size());
    payload->length = static_cast<std::uint32_t>(bytes.size());
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
    static_cast<std::string*>(data)->assign(reinterpret_cast<const char*>(payload->data),
                                            payload->length);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<std::string*>(data)->size()); };
  }
  void* createData() override { return new std::string(); }
  void deleteData(void* data) override { delete static_cast<std::string*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

/// The user data of all readers and writers that others have, by topic.
struct Others : fast::DomainParticipantListener {
  std::mutex mutex;
  std::map<std::string, std::string> writers, readers;

  void on_publisher_discovery(fast::DomainParticipant*, rtps::WriterDiscoveryInfo&& info) override {
    const auto& data = info.info.m_qos.m_userData.getValue();
    const std::scoped_lock lock(mutex);
    writers[info.info.topicName().to_string()] = std::string(data.begin(), data.end());
  }
  void on_subscriber_discovery(fast::DomainParticipant*,
                               rtps::ReaderDiscoveryInfo&& info) override {
    const auto& data = info.info.m_qos.m_userData.getValue();
    const std::scoped_lock lock(mutex);
    readers[info.info.topicName().to_string()] = std::string(data.begin(), data.end());
  }
};

struct Printer : fast::DataReaderListener {
  explicit Printer(std::string name) : topic(std::move(name)) {}
  void on_data_available(fast::DataReader* reader) override {
    std::string bytes;
    fast::SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) print("message " + topic + ' ' + hex_of(bytes));
  }
  std::string topic;
};

/// "sensor_msgs::msg::dds_::JointState_" of "sensor_msgs/JointState".
std::string dds_name(const std::string& type) {
  const auto at = type.find('/');
  return type.substr(0, at) + "::msg::dds_::" + type.substr(at + 1) + "_";
}

}  // namespace

int main() {
  const char* domain = std::getenv("ROS_DOMAIN_ID");
  Others others;
  fast::DomainParticipantQos qos;
  // By UDP on loopback alone, as the server is in tests.
  const auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  transport->interfaceWhiteList.emplace_back("127.0.0.1");
  qos.transport().user_transports.push_back(transport);
  qos.transport().use_builtin_transports = false;
  for (std::uint32_t i = 0; i < 8; ++i) {  // without multicast, the first participants of a domain
    rtps::Locator_t peer;
    rtps::IPLocator::setIPv4(peer, 127, 0, 0, 1);
    const auto number = static_cast<std::uint32_t>(domain == nullptr ? 0 : std::atoi(domain));
    peer.port = 7400 + 250 * number + 10 + 2 * i;
    qos.wire_protocol().builtin.initialPeersList.push_back(peer);
  }
  auto* const factory = fast::DomainParticipantFactory::get_instance();
  auto* const participant = factory->create_participant(
      static_cast<fast::DomainId_t>(domain == nullptr ? 0 : std::atoi(domain)), qos, &others,
      fast::StatusMask::none());
  if (participant == nullptr) return 1;
  auto* const publisher = participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
  auto* const subscriber = participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
  std::map<std::string, fast::DataWriter*> writers;
  std::vector<std::unique_ptr<Printer>> printers;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string command, name, type, reliability, durability, hex;
    words >> command >> name;
    if (command == "writer" || command == "reader") {
      words >> type >> reliability >> durability;
      const fast::TypeSupport support(new Bytes(dds_name(type)));
      support.register_type(participant);
      auto* const topic =
          participant->create_topic("rt" + name, support.get_type_name(), fast::TOPIC_QOS_DEFAULT);
      const auto reliable = reliability == "reliable" ? fast::RELIABLE_RELIABILITY_QOS
                                                      : fast::BEST_EFFORT_RELIABILITY_QOS;
      const auto durable = durability == "latched" ? fast::TRANSIENT_LOCAL_DURABILITY_QOS
                                                   : fast::VOLATILE_DURABILITY_QOS;
      const auto matches = [&](auto* endpoint, auto status, auto get) {
        do {
          std::this_thread::sleep_for(std::chrono::milliseconds(2));
          get(endpoint, status);
        } while (status.current_count == 0);
      };
      if (command == "writer") {
        fast::DataWriterQos of = fast::DATAWRITER_QOS_DEFAULT;
        of.reliability().kind = reliable;
        of.durability().kind = durable;
        of.history().depth = 1000;
        of.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        writers[name] = publisher->create_datawriter(topic, of);
        matches(writers[name], fast::PublicationMatchedStatus(),
                [](auto* w, auto& status) { w->get_publication_matched_status(status); });
      } else {
        fast::DataReaderQos of = fast::DATAREADER_QOS_DEFAULT;
        of.reliability().kind = reliable;
        of.durability().kind = durable;
        of.history().depth = 1000;
        of.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        printers.push_back(std::make_unique<Printer>(name));
        auto* const reader = subscriber->create_datareader(topic, of, printers.back().get(),
                                                           fast::StatusMask::data_available());
        matches(reader, fast::SubscriptionMatchedStatus(),
                [](auto* r, auto& status) { r->get_subscription_matched_status(status); });
      }
      const std::scoped_lock lock(others.mutex);
      print("matched " + name + ' ' +
            (command == "writer" ? others.readers : others.writers)["rt" + name]);
    } else if (command == "write") {
      words >> hex;
      std::string bytes = bytes_of(hex);
      if (!writers.at(name)->write(&bytes)) return 1;
    } else if (command == "close") {
      publisher->delete_datawriter(writers.at(name));
      writers.erase(name);
      print("closed " + name);
    }
  }
  for (const auto& [name, writer] : writers) writer->wait_for_acknowledgments({10, 0});
  participant->delete_contained_entities();
  factory->delete_participant(participant);
}
