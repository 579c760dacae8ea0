// A secured program on Fast DDS 2.9 with the files of an enclave, as rmw_fastrtps reads them; the arguments and the output
// are those of secured_cyclone_peer.c, with the domain as the last argument.
#include <chrono>
#include <cstdio>
#include <cstring>
#include <thread>

#include "fastdds_loopback.hpp"
#include "typesPubSubTypes.h"

using std_msgs::msg::dds_::String_;
using std_msgs::msg::dds_::String_PubSubType;

static void secure(DomainParticipantQos &qos, const std::string &folder) {
  auto &properties = qos.properties().properties();
  const auto set = [&](const char *name, const std::string &value) { properties.emplace_back(name, value); };
  const std::string file = "file://" + folder + "/";
  set("dds.sec.auth.plugin", "builtin.PKI-DH");
  set("dds.sec.auth.builtin.PKI-DH.identity_ca", file + "identity_ca.cert.pem");
  set("dds.sec.auth.builtin.PKI-DH.identity_certificate", file + "cert.pem");
  set("dds.sec.auth.builtin.PKI-DH.private_key", file + "key.pem");
  set("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  set("dds.sec.access.plugin", "builtin.Access-Permissions");
  set("dds.sec.access.builtin.Access-Permissions.permissions_ca", file + "permissions_ca.cert.pem");
  set("dds.sec.access.builtin.Access-Permissions.governance", file + "governance.p7s");
  set("dds.sec.access.builtin.Access-Permissions.permissions", file + "permissions.p7s");
}

template <class Entity>
static Entity *check(Entity *entity, const char *what) {
  if (entity == nullptr) {
    std::printf("FAILED %s\n", what);
    std::exit(3);
  }
  return entity;
}

int main(int argc, char **argv) {
  if (argc < 5) return 2;
  const std::string folder = argv[3];
  open_participant(std::atoi(argv[4]), [&](DomainParticipantQos &qos) { secure(qos, folder); });
  Topic *named = check(topic(argv[2], new String_PubSubType()), "topic");
  if (std::strcmp(argv[1], "talk") == 0) {
    DataWriter *writer = check(publisher->create_datawriter(named, writer_qos(false)), "writer");
    std::printf("READY\n");
    std::fflush(stdout);
    String_ sample;
    sample.data("secret");
    for (;;) {
      writer->write(&sample);
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  }
  DataReader *reader = check(subscriber->create_datareader(named, reader_qos(false)), "reader");
  std::printf("READY\n");
  std::fflush(stdout);
  for (;;) {
    String_ sample;
    SampleInfo info;
    if (reader->take_next_sample(&sample, &info) == ReturnCode_t::RETCODE_OK && info.valid_data) {
      std::printf("GOT %s\n", sample.data().c_str());
      std::fflush(stdout);
      std::_Exit(0);  // the destructors of a secured participant crash in Fast DDS 2.9.1
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}
