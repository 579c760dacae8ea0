// Common part of the Fast DDS peers: a participant on loopback, and topics and QoS like those of rmw_fastrtps.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

using namespace eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

static DomainParticipant *participant;
static Publisher *publisher;
static Subscriber *subscriber;

// The files of the enclave in the folder SECURE_ENCLAVE, if it is set, as rmw_fastrtps names them.
static void secure(DomainParticipantQos &qos) {
  const char *folder = std::getenv("SECURE_ENCLAVE");
  if (folder == nullptr) return;
  auto &all = qos.properties().properties();
  const std::string files = std::string("file://") + folder + "/";
  const std::string auth = "dds.sec.auth.builtin.PKI-DH.", access = "dds.sec.access.builtin.Access-Permissions.";
  all.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
  all.emplace_back(auth + "identity_ca", files + "identity_ca.cert.pem");
  all.emplace_back(auth + "identity_certificate", files + "cert.pem");
  all.emplace_back(auth + "private_key", files + "key.pem");
  all.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  all.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
  all.emplace_back(access + "permissions_ca", files + "permissions_ca.cert.pem");
  all.emplace_back(access + "governance", files + "governance.p7s");
  all.emplace_back(access + "permissions", files + "permissions.p7s");
}

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
  secure(qos);
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
  qos.data_sharing().off();
  qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;  // more than 64 kB must be sent in fragments
  return qos;
}

static DataReaderQos reader_qos(bool best_effort) {
  DataReaderQos qos = DATAREADER_QOS_DEFAULT;
  qos.reliability().kind = best_effort ? BEST_EFFORT_RELIABILITY_QOS : RELIABLE_RELIABILITY_QOS;
  qos.history().kind = KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 10;
  qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.data_sharing().off();
  return qos;
}
