// The service example_interfaces/srv/AddTwoInts on Fast DDS 2.9, as rmw_fastrtps of Humble has it.
//
// Requests and replies are the bare messages. They are linked by a "related sample identity" in the inline QoS,
// a GUID and a sequence number: a request names the client's reply reader (number unknown), a reply names that reader, or
// the request writer if no reader was named, and the sequence number of the request. Fast DDS up to 2.9 knows one inline
// QoS parameter for it, 0x800f, from any vendor; from 2.10 on it writes 0x0083 too.
//
// "serve DOMAIN SERVICE": prints READY and answers until killed.
// "call DOMAIN SERVICE A B [A B]...": prints READY, waits for a server, sends up to ten requests at once and prints
// "SUM <number>" for each, in the order given. Exits with 1 and an error on stderr if there is no server or no reply for 10 s.
// Loopback only.
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <thread>

#include "fastdds_loopback.hpp"

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
static constexpr std::chrono::seconds TIMEOUT{10};

// A struct of `count` int64, in little-endian CDR.
template <size_t count>
class Longs : public TopicDataType {
public:
  using Data = std::int64_t[count];

  explicit Longs(const char *name) { setName(name); m_typeSize = SIZE; m_isGetKeyDefined = false; }
  bool serialize(void *data, rtps::SerializedPayload_t *payload) override {
    if (payload->max_size < SIZE) return false;
    const unsigned char header[4] = {0, 1, 0, 0};
    std::memcpy(payload->data, header, sizeof header);
    std::memcpy(payload->data + sizeof header, data, sizeof(Data));
    payload->length = SIZE;
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(rtps::SerializedPayload_t *payload, void *data) override {
    if (payload->length < SIZE || payload->data[1] != 1) return false;
    std::memcpy(data, payload->data + 4, sizeof(Data));
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void *) override { return [] { return SIZE; }; }
  void *createData() override { return new std::int64_t[count]; }
  void deleteData(void *data) override { delete[] static_cast<std::int64_t *>(data); }
  bool getKey(void *, rtps::InstanceHandle_t *, bool) override { return false; }

private:
  static constexpr uint32_t SIZE = 4 + sizeof(Data);
};

using Request = Longs<2>;
using Reply = Longs<1>;

static Topic *request_topic(const std::string &service) {
  return topic("rq/" + service + "Request", new Request("example_interfaces::srv::dds_::AddTwoInts_Request_"));
}

static Topic *reply_topic(const std::string &service) {
  return topic("rr/" + service + "Reply", new Reply("example_interfaces::srv::dds_::AddTwoInts_Response_"));
}

static void say(const std::string &line) {
  std::printf("%s\n", line.c_str());
  std::fflush(stdout);
}

// Which readers a writer has found.
class FoundReaders : public DataWriterListener {
public:
  void on_publication_matched(DataWriter *, const PublicationMatchedStatus &status) override {
    std::lock_guard<std::mutex> lock(mutex_);
    const rtps::GUID_t reader = rtps::iHandle2GUID(status.last_subscription_handle);
    if (status.current_count_change > 0) found_.insert(reader);
    else found_.erase(reader);
    changed_.notify_all();
  }
  bool wait_for(const rtps::GUID_t &reader, milliseconds patience) {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, patience, [&] { return found_.count(reader) != 0; });
  }

private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::set<rtps::GUID_t> found_;
};

[[noreturn]] static void serve(const std::string &service) {
  FoundReaders clients;
  DataWriter *replies = publisher->create_datawriter(reply_topic(service), writer_qos(false), &clients);
  DataReader *requests = subscriber->create_datareader(request_topic(service), reader_qos(false));
  say("READY");
  for (;;) {
    requests->wait_for_unread_message({1, 0});
    Request::Data request;
    SampleInfo info;
    while (requests->take_next_sample(request, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      rtps::SampleIdentity caller = info.sample_identity;
      if (info.related_sample_identity.writer_guid() != rtps::GUID_t::unknown())
        caller.writer_guid(info.related_sample_identity.writer_guid());
      // The request may be here before the client's reader is known. Readers have this bit in their entity kind.
      const bool is_reader = (caller.writer_guid().entityId.value[3] & 0x04) != 0;
      if (is_reader && !clients.wait_for(caller.writer_guid(), milliseconds(100))) continue;
      Reply::Data reply = {request[0] + request[1]};
      rtps::WriteParams beside;
      beside.related_sample_identity(caller);
      replies->write(reply, beside);
    }
  }
}

class Client {
public:
  explicit Client(const std::string &service)
      : replies_(subscriber->create_datareader(reply_topic(service), reader_qos(false))),
        requests_(publisher->create_datawriter(request_topic(service), writer_qos(false))) {}

  bool wait_for_server() {
    for (const auto end = Clock::now() + TIMEOUT; Clock::now() < end; std::this_thread::sleep_for(milliseconds(10))) {
      PublicationMatchedStatus requests;
      SubscriptionMatchedStatus replies;
      requests_->get_publication_matched_status(requests);
      replies_->get_subscription_matched_status(replies);
      if (requests.current_count > 0 && requests.current_count == replies.current_count) return true;
    }
    return false;
  }

  // The number of the request.
  std::optional<uint64_t> send(Request::Data &request) {
    rtps::WriteParams beside;
    beside.related_sample_identity().writer_guid(replies_->guid());
    if (!requests_->write(request, beside)) return {};
    return beside.sample_identity().sequence_number().to64long();
  }

  // The sums that came, by the number of their request; fewer than `count` when time passed.
  std::map<uint64_t, std::int64_t> receive(size_t count) {
    std::map<uint64_t, std::int64_t> sums;
    for (const auto end = Clock::now() + TIMEOUT; sums.size() < count && Clock::now() < end;) {
      replies_->wait_for_unread_message({0, 100'000'000});
      Reply::Data reply;
      SampleInfo info;
      while (replies_->take_next_sample(reply, &info) == ReturnCode_t::RETCODE_OK) {
        const rtps::SampleIdentity &asked = info.related_sample_identity;
        if (info.valid_data && (asked.writer_guid() == replies_->guid() || asked.writer_guid() == requests_->guid()))
          sums[asked.sequence_number().to64long()] = reply[0];
      }
    }
    return sums;
  }

private:
  DataReader *replies_;
  DataWriter *requests_;
};

static int fail(const char *word) {
  std::fprintf(stderr, "%s\n", word);
  return 1;
}

static int call(const std::string &service, int count, char **numbers) {
  Client client(service);
  say("READY");
  if (!client.wait_for_server()) return fail("no server");
  std::vector<uint64_t> sent;
  for (int index = 0; index < count; index += 2) {
    Request::Data request = {std::atoll(numbers[index]), std::atoll(numbers[index + 1])};
    const auto number = client.send(request);
    if (!number) return fail("not sent");
    sent.push_back(*number);
  }
  const auto sums = client.receive(sent.size());
  for (const uint64_t number : sent) {
    const auto found = sums.find(number);
    if (found == sums.end()) return fail("no answer");
    say("SUM " + std::to_string(found->second));
  }
  return 0;
}

int main(int argc, char **argv) {
  const std::string mode = argc > 3 ? argv[1] : "";
  const int numbers = argc - 4;
  if (mode == "serve" && numbers == 0) {
    open_participant(std::atoi(argv[2]));
    serve(argv[3]);
  }
  if (mode == "call" && numbers >= 2 && numbers <= 20 && numbers % 2 == 0) {
    open_participant(std::atoi(argv[2]));
    return call(argv[3], numbers, argv + 4);
  }
  return fail("serve DOMAIN SERVICE | call DOMAIN SERVICE A B [A B]...");
}
