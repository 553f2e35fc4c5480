// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A node as ROS 2 would have it, with Cyclone DDS and types by idlc, which checks all bytes. Lines
// of the standard input are commands; tests/serve/peers.py knows them. Shares no code with the
// server.
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "hex.h"
#include "messages.h"

namespace {

const std::map<std::string, const dds_topic_descriptor_t*> kTypes = {
    {"geometry_msgs/PoseStamped", &geometry_msgs_msg_dds__PoseStamped__desc},
    {"geometry_msgs/WrenchStamped", &geometry_msgs_msg_dds__WrenchStamped__desc},
    {"grid_map_msgs/GridMap", &grid_map_msgs_msg_dds__GridMap__desc},
    {"nav_msgs/Odometry", &nav_msgs_msg_dds__Odometry__desc},
    {"sensor_msgs/JointState", &sensor_msgs_msg_dds__JointState__desc},
    {"std_msgs/Float64", &std_msgs_msg_dds__Float64__desc},
    {"tf2_msgs/TFMessage", &tf2_msgs_msg_dds__TFMessage__desc}};

struct Endpoint {
  std::string topic;
  dds_entity_t entity = 0;
  const ddsi_sertype* type = nullptr;
};

std::mutex output;
dds_entity_t participant = 0;

void print(const std::string& line) {
  const std::scoped_lock lock(output);
  std::cout << line << std::endl;
}

template <typename Result>
Result check(Result result, const char* what) {
  if (result >= 0) return result;
  std::cerr << what << ": " << dds_strretcode(-static_cast<dds_return_t>(result)) << std::endl;
  std::exit(1);
}

void on_data(dds_entity_t reader, void* arg) {
  const auto& topic = *static_cast<const std::string*>(arg);
  ddsi_serdata* data = nullptr;
  dds_sample_info_t info;
  while (dds_takecdr(reader, &data, 1, &info, DDS_ANY_STATE) > 0) {
    std::string bytes(ddsi_serdata_size(data), '\0');
    ddsi_serdata_to_ser(data, 0, bytes.size(), bytes.data());
    ddsi_serdata_unref(data);
    if (info.valid_data) print("message " + topic + ' ' + hex_of(bytes));
  }
}

/// The type as Cyclone DDS made it of a descriptor; messages of a topic of our own have it.
const ddsi_sertype* type_of(const dds_topic_descriptor_t& descriptor) {
  static int number = 0;
  const std::string name = "own_" + std::to_string(++number);
  const dds_entity_t topic =
      check(dds_create_topic(participant, &descriptor, name.c_str(), nullptr, nullptr), "topic");
  const dds_entity_t reader =
      check(dds_create_reader(participant, topic, nullptr, nullptr), "reader");
  const dds_entity_t writer =
      check(dds_create_writer(participant, topic, nullptr, nullptr), "writer");
  const std::vector<char> zeros(descriptor.m_size);
  check(dds_write(writer, zeros.data()), "write");
  ddsi_serdata* data = nullptr;
  dds_sample_info_t info;
  while (dds_takecdr(reader, &data, 1, &info, DDS_ANY_STATE) == 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return data->type;  // its owners stay
}

/// A topic's descriptor. Of "A=B" it has the fields of B, and says that it is A.
const dds_topic_descriptor_t& descriptor_of(const std::string& type) {
  const auto at = type.find('=');
  if (at == type.npos) return *kTypes.at(type);
  const dds_topic_descriptor_t& fields = *kTypes.at(type.substr(at + 1));
  auto* const made =
      static_cast<dds_topic_descriptor_t*>(std::malloc(sizeof(dds_topic_descriptor_t)));
  new (made) dds_topic_descriptor_t{fields.m_size,
                                    fields.m_align,
                                    fields.m_flagset & ~DDS_TOPIC_XTYPES_METADATA,
                                    fields.m_nkeys,
                                    kTypes.at(type.substr(0, at))->m_typename,
                                    fields.m_keys,
                                    fields.m_nops,
                                    fields.m_ops,
                                    fields.m_meta,
                                    {nullptr, 0},
                                    {nullptr, 0},
                                    fields.restrict_data_representation};
  return *made;
}

/// Waits for another side, and prints its user data.
void wait_for_match(const Endpoint& endpoint, bool writes) {
  dds_instance_handle_t other = 0;
  const auto find = writes ? dds_get_matched_subscriptions : dds_get_matched_publications;
  while (check(find(endpoint.entity, &other, 1), "matched") == 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  dds_builtintopic_endpoint_t* of = writes
                                        ? dds_get_matched_subscription_data(endpoint.entity, other)
                                        : dds_get_matched_publication_data(endpoint.entity, other);
  void* data = nullptr;
  std::size_t size = 0;
  if (of != nullptr) dds_qget_userdata(of->qos, &data, &size);
  print("matched " + endpoint.topic + ' ' + std::string(static_cast<const char*>(data), size));
}

Endpoint make(bool writes, const std::string& topic, const std::string& type,
              const std::string& reliability, const std::string& durability) {
  const dds_topic_descriptor_t& descriptor = descriptor_of(type);
  Endpoint made{topic, 0, type_of(descriptor)};
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(
      qos, reliability == "reliable" ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
      DDS_SECS(10));
  dds_qset_durability(
      qos, durability == "latched" ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, durability == "latched" ? 1 : 10'000);
  const dds_entity_t of =
      check(dds_create_topic(participant, &descriptor, ("rt" + topic).c_str(), nullptr, nullptr),
            "topic");
  if (writes) {
    made.entity = check(dds_create_writer(participant, of, qos, nullptr), "writer");
  } else {
    dds_listener_t* listener = dds_create_listener(new std::string(topic));
    dds_lset_data_available(listener, on_data);
    made.entity = check(dds_create_reader(participant, of, qos, listener), "reader");
  }
  dds_delete_qos(qos);
  return made;
}

}  // namespace

int main() {
  const char* domain = std::getenv("ROS_DOMAIN_ID");
  participant = check(
      dds_create_participant(static_cast<dds_domainid_t>(domain == nullptr ? 0 : std::atoi(domain)),
                             nullptr, nullptr),
      "participant");
  std::map<std::string, Endpoint> writers;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string command, topic, type, reliability, durability, hex;
    words >> command >> topic;
    if (command == "writer" || command == "reader") {
      words >> type >> reliability >> durability;
      const Endpoint made = make(command == "writer", topic, type, reliability, durability);
      if (command == "writer") writers[topic] = made;
      wait_for_match(made, command == "writer");
    } else if (command == "write") {
      words >> hex;
      std::string bytes = bytes_of(hex);
      const ddsrt_iovec_t part{bytes.data(), bytes.size()};
      ddsi_serdata* data =
          ddsi_serdata_from_ser_iov(writers.at(topic).type, SDK_DATA, 1, &part, bytes.size());
      if (data == nullptr) {
        std::cerr << "no message of its type: " << line << std::endl;
        return 1;
      }
      check(dds_writecdr(writers.at(topic).entity, data), "write");
    } else if (command == "close") {
      check(dds_delete(writers.at(topic).entity), "delete");
      writers.erase(topic);
      print("closed " + topic);
    }
  }
  for (const auto& [topic, writer] : writers) dds_wait_for_acks(writer.entity, DDS_SECS(10));
  dds_delete(participant);
}
