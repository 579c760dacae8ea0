// A foreign peer on Fast DDS 2.9, close to the 2.14 of ROS 2 Jazzy.
//
// "echo": echoes every sample of rt/ask_<type> on rt/answer_<type>, reliable or best effort, and keeps a transient-local
// sample on rt/latched. "big": a ROS node /bigendian that writes rt/big in big-endian CDR. Prints READY when everything
// exists. Loopback only; domain from argv.
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

#include "fastdds_loopback.hpp"
#include "typesPubSubTypes.h"

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
