// A foreign peer on Fast DDS 2.9, close to the 2.14 of ROS 2 Jazzy.
//
// "echo DOMAIN": echoes every sample of rt/ask_<type> on rt/answer_<type>, reliable or best effort, and keeps a
// transient-local sample on rt/latched. The reader of rt/ask_filtered has a content filter, as feedback readers of ROS 2
// Lyrical: only texts with the letter of its parameter pass. Prints READY when everything exists. Loopback only.
// "talk DOMAIN TOPIC" writes a std_msgs/String ten times a second; "listen DOMAIN TOPIC" prints GOT and the first one.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <thread>

#include <fastdds/dds/topic/ContentFilteredTopic.hpp>
#include <fastdds/dds/topic/IContentFilter.hpp>
#include <fastdds/dds/topic/IContentFilterFactory.hpp>

#include "fastdds_loopback.hpp"
#include "typesPubSubTypes.h"

template <class PubSub, class Data>
class Echo : public DataReaderListener {
public:
  Echo(const std::string &name, bool best_effort, TopicDescription *(*filter)(Topic *) = nullptr) {
    writer_ = publisher->create_datawriter(topic("rt/answer_" + name, new PubSub()), writer_qos(best_effort));
    Topic *ask = topic("rt/ask_" + name, new PubSub());
    subscriber->create_datareader(filter ? filter(ask) : ask, reader_qos(best_effort), this);
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

class LetterFilter : public IContentFilter, public IContentFilterFactory {
public:
  bool evaluate(const SerializedPayload &payload, const FilterSampleInfo &, const GUID_t &) const override {
    return std::memchr(payload.data, letter_, payload.length) != nullptr;
  }
  ReturnCode_t create_content_filter(const char *, const char *, const TopicDataType *, const char *,
                                     const ParameterSeq &parameters, IContentFilter *&filter) override {
    if (parameters.length() > 0) letter_ = parameters[0][0];
    filter = this;
    return ReturnCode_t::RETCODE_OK;
  }
  ReturnCode_t delete_content_filter(const char *, IContentFilter *) override { return ReturnCode_t::RETCODE_OK; }

private:
  char letter_ = 0;
};

static LetterFilter letter_filter;

static TopicDescription *filtered(Topic *all) {
  participant->register_content_filter_factory("LETTER", &letter_filter);
  return participant->create_contentfilteredtopic("filtered", all, "letter", {"k"}, "LETTER");
}

static void ready() {
  std::printf("READY\n");
  std::fflush(stdout);
}

[[noreturn]] static void talk(const std::string &name) {
  DataWriter *writer = publisher->create_datawriter(topic(name, new std_msgs::msg::dds_::String_PubSubType()), writer_qos(false));
  std_msgs::msg::dds_::String_ sample;
  sample.data("secret");
  for (ready();; std::this_thread::sleep_for(std::chrono::milliseconds(100))) writer->write(&sample);
}

[[noreturn]] static void listen(const std::string &name) {
  DataReader *reader = subscriber->create_datareader(topic(name, new std_msgs::msg::dds_::String_PubSubType()), reader_qos(false));
  std_msgs::msg::dds_::String_ sample;
  SampleInfo info;
  for (ready(); reader->take_next_sample(&sample, &info) != ReturnCode_t::RETCODE_OK || !info.valid_data;)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  std::printf("GOT %s\n", sample.data().c_str());
  std::fflush(stdout);
  std::_Exit(0);  // the destructors of a secured participant crash in Fast DDS 2.9.1
}

int main(int argc, char **argv) {
  if (argc < 3) return 2;
  open_participant(std::atoi(argv[2]));
  const std::string mode = argv[1];
  if (argc > 3) mode == "talk" ? talk(argv[3]) : listen(argv[3]);
  using namespace std_msgs::msg::dds_;
  Echo<String_PubSubType, String_> string("string", false);
  Echo<String_PubSubType, String_> sensor("sensor", true);
  Echo<String_PubSubType, String_> passed("filtered", false, filtered);
  Echo<Float64MultiArray_PubSubType, Float64MultiArray_> array("array", false);
  Echo<geometry_msgs::msg::dds_::PoseStamped_PubSubType, geometry_msgs::msg::dds_::PoseStamped_> pose("pose", false);
  Echo<example_interfaces::msg::dds_::WString_PubSubType, example_interfaces::msg::dds_::WString_> wstring("wstring", false);
  Echo<sensor_msgs::msg::dds_::Image_PubSubType, sensor_msgs::msg::dds_::Image_> image("image", false);
  DataWriter *latched = publisher->create_datawriter(topic("rt/latched", new String_PubSubType()), writer_qos(false, true));
  String_ kept;
  kept.data("kept");
  latched->write(&kept);
  ready();
  for (;;) std::this_thread::sleep_for(std::chrono::seconds(1));
}
