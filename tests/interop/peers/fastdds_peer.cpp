// A foreign peer on Fast DDS 2.9, close to the 2.14 of ROS 2 Jazzy.
//
// "echo": echoes every sample of rt/ask_<type> on rt/answer_<type>, reliable or best effort, and keeps a transient-local
// sample on rt/latched. "service": endpoints of a service server, as rmw_fastrtps would have them. "big": a ROS node
// /bigendian that writes rt/big in big-endian CDR. Prints READY when everything exists. Loopback only; domain from argv.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include "typesPubSubTypes.h"

using namespace eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using eprosima::fastrtps::c_TimeInfinite;

static DomainParticipant *participant;
static Publisher *publisher;
static Subscriber *subscriber;

static void open_participant(int domain) {
  DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
  auto loopback = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  loopback->interfaceWhiteList.emplace_back("127.0.0.1");
  loopback->maxMessageSize = 65000;
  loopback->sendBufferSize = loopback->receiveBufferSize = 4 << 20;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(loopback);
  rtps::Locator_t peer;
  rtps::IPLocator::setIPv4(peer, "127.0.0.1");
  peer.port = 0;
  qos.wire_protocol().builtin.initialPeersList.push_back(peer);
  rtps::Locator_t own;
  rtps::IPLocator::setIPv4(own, "127.0.0.1");
  own.port = 0;
  qos.wire_protocol().builtin.metatrafficUnicastLocatorList.push_back(own);  // instead of the multicast default
  const std::string enclave = "enclave=/;";
  qos.user_data().setValue(std::vector<rtps::octet>(enclave.begin(), enclave.end()));
  participant = DomainParticipantFactory::get_instance()->create_participant(domain, qos);
  if (participant == nullptr) { std::fprintf(stderr, "no participant\n"); std::exit(1); }
  publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
}

static Topic *topic(const std::string &name, TopicDataType *made) {
  TypeSupport type(made);
  type->auto_fill_type_object(false);  // as rmw_fastrtps does
  type->auto_fill_type_information(false);
  type.register_type(participant);
  return participant->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT);
}

static DataWriterQos writer_qos(bool best_effort, bool latched = false) {
  DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
  qos.reliability().kind = best_effort ? BEST_EFFORT_RELIABILITY_QOS : RELIABLE_RELIABILITY_QOS;
  qos.history().kind = KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 10;
  qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
  qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;  // more than 64 kB must be sent in fragments
  return qos;
}

static DataReaderQos reader_qos(bool best_effort) {
  DataReaderQos qos = DATAREADER_QOS_DEFAULT;
  qos.reliability().kind = best_effort ? BEST_EFFORT_RELIABILITY_QOS : RELIABLE_RELIABILITY_QOS;
  qos.history().kind = KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 10;
  qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  return qos;
}

template <class PubSub, class Data>
class Echo : public DataReaderListener {
public:
  Echo(const std::string &name, bool best_effort) {
    writer_ = publisher->create_datawriter(topic("rt/answer_" + name, new PubSub()), writer_qos(best_effort));
    subscriber->create_datareader(topic("rt/ask_" + name, new PubSub()), reader_qos(best_effort), this);
  }
  void on_data_available(DataReader *reader) override {
    Data data;
    SampleInfo info;
    while (reader->take_next_sample(&data, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) writer_->write(&data);
  }

private:
  DataWriter *writer_;
};

// Bytes that are written as they are.
class RawType : public TopicDataType {
public:
  explicit RawType(const char *name) { setName(name); m_typeSize = 4096; m_isGetKeyDefined = false; }
  bool serialize(void *data, rtps::SerializedPayload_t *payload) override {
    auto &bytes = *static_cast<std::vector<unsigned char> *>(data);
    std::memcpy(payload->data, bytes.data(), bytes.size());
    payload->length = static_cast<uint32_t>(bytes.size());
    payload->encapsulation = CDR_BE;
    return true;
  }
  bool deserialize(rtps::SerializedPayload_t *, void *) override { return false; }
  std::function<uint32_t()> getSerializedSizeProvider(void *data) override {
    return [data] { return static_cast<uint32_t>(static_cast<std::vector<unsigned char> *>(data)->size()); };
  }
  void *createData() override { return new std::vector<unsigned char>(); }
  void deleteData(void *data) override { delete static_cast<std::vector<unsigned char> *>(data); }
  bool getKey(void *, rtps::InstanceHandle_t *, bool) override { return false; }
};

static void put(std::vector<unsigned char> &out, uint32_t number) {
  while (out.size() % 4) out.push_back(0);
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<unsigned char>(number >> shift));
}

static void put(std::vector<unsigned char> &out, const std::string &text) {
  put(out, static_cast<uint32_t>(text.size() + 1));
  out.insert(out.end(), text.begin(), text.end());
  out.push_back(0);
}

static void put(std::vector<unsigned char> &out, const rtps::GUID_t &guid) {
  out.insert(out.end(), guid.guidPrefix.value, guid.guidPrefix.value + 12);
  out.insert(out.end(), guid.entityId.value, guid.entityId.value + 4);
}

static void big_endian_node() {
  DataWriter *data = publisher->create_datawriter(topic("rt/big", new RawType("std_msgs::msg::dds_::String_")), writer_qos(false));
  DataWriterQos qos = writer_qos(false, true);
  const std::string hash = "typehash=RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e;";
  qos.user_data().setValue(std::vector<rtps::octet>(hash.begin(), hash.end()));
  DataWriter *graph = publisher->create_datawriter(topic("ros_discovery_info", new RawType("rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_")), qos);
  std::vector<unsigned char> node = {0, 0, 0, 0};
  put(node, participant->guid());
  put(node, 1);
  put(node, "/");
  put(node, "bigendian");
  put(node, 0);
  put(node, 1);
  put(node, data->guid());
  graph->write(&node);
  std::printf("READY\n");
  std::fflush(stdout);
  std::vector<unsigned char> text = {0, 0, 0, 0};
  put(text, "from the other end");
  for (;;) {
    data->write(&text);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
}

int main(int argc, char **argv) {
  if (argc < 3) return 2;
  open_participant(std::atoi(argv[2]));
  const std::string mode = argv[1];
  if (mode == "big") big_endian_node();
  if (mode == "service") {
    using RequestType = example_interfaces::srv::dds_::AddTwoInts_Request_PubSubType;
    using ResponseType = example_interfaces::srv::dds_::AddTwoInts_Response_PubSubType;
    subscriber->create_datareader(topic("rq/fast_addRequest", new RequestType()), reader_qos(false));
    publisher->create_datawriter(topic("rr/fast_addReply", new ResponseType()), writer_qos(false));
    std::printf("READY\n");
    std::fflush(stdout);
    for (;;) std::this_thread::sleep_for(std::chrono::seconds(1));
  }
  using namespace std_msgs::msg::dds_;
  Echo<String_PubSubType, String_> string("string", false);
  Echo<String_PubSubType, String_> sensor("sensor", true);
  Echo<Float64MultiArray_PubSubType, Float64MultiArray_> array("array", false);
  Echo<geometry_msgs::msg::dds_::PoseStamped_PubSubType, geometry_msgs::msg::dds_::PoseStamped_> pose("pose", false);
  Echo<example_interfaces::msg::dds_::WString_PubSubType, example_interfaces::msg::dds_::WString_> wstring("wstring", false);
  Echo<sensor_msgs::msg::dds_::Image_PubSubType, sensor_msgs::msg::dds_::Image_> image("image", false);
  DataWriter *latched = publisher->create_datawriter(topic("rt/latched", new String_PubSubType()), writer_qos(false, true));
  String_ kept;
  kept.data("kept");
  latched->write(&kept);
  std::printf("READY\n");
  std::fflush(stdout);
  for (;;) std::this_thread::sleep_for(std::chrono::seconds(1));
}
