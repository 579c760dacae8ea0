/* A foreign peer on Cyclone DDS 0.10, the version of ROS 2 Jazzy.
 *
 * It echoes every sample of rt/ask_<type> on rt/answer_<type>, serves rq/c_addRequest, and on the command line
 * "call N" it calls rq/py_addRequest N times. It prints READY when everything exists, and one line per finished call.
 *
 * With "talk TOPIC" it only writes a std_msgs/String ten times a second, with "listen TOPIC" it prints GOT and the first
 * one. It uses the files of the enclave in the folder SECURE_ENCLAVE, if that is set; what fails is a line FAILED.
 */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dds/dds.h"
#include "types.h"

#define REQUEST example_interfaces_srv_dds__AddTwoInts_Request_
#define RESPONSE example_interfaces_srv_dds__AddTwoInts_Response_

static dds_entity_t participant;

static dds_entity_t check(dds_entity_t entity, const char *what) {
  if (entity < 0) {
    printf("FAILED %s: %s\n", what, dds_strretcode(-entity));
    exit(3);
  }
  return entity;
}

static dds_qos_t *default_profile(bool best_effort) {
  dds_qos_t *qos = dds_create_qos();
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  dds_qset_reliability(qos, best_effort ? DDS_RELIABILITY_BEST_EFFORT : DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  dds_qset_writer_data_lifecycle(qos, false);
  return qos;
}

struct channel {
  const char *name;
  const dds_topic_descriptor_t *type;
  bool best_effort;
  dds_entity_t reader, writer;
};

static dds_entity_t topic(const dds_topic_descriptor_t *type, const char *name) {
  return check(dds_create_topic(participant, type, name, NULL, NULL), "topic");
}

static void open_channel(struct channel *channel) {
  char name[100];
  dds_qos_t *qos = default_profile(channel->best_effort);
  snprintf(name, sizeof name, "rt/ask_%s", channel->name);
  channel->reader = check(dds_create_reader(participant, topic(channel->type, name), qos, NULL), name);
  snprintf(name, sizeof name, "rt/answer_%s", channel->name);
  channel->writer = check(dds_create_writer(participant, topic(channel->type, name), qos, NULL), name);
  dds_delete_qos(qos);
}

static void echo(struct channel *channel) {
  void *sample[1] = {NULL};
  dds_sample_info_t info[1];
  while (dds_take(channel->reader, sample, info, 1, 1) > 0) {
    if (info[0].valid_data) check(dds_write(channel->writer, sample[0]), "echo");
    dds_return_loan(channel->reader, sample, 1);
  }
}

static void serve(struct channel *service) {
  void *sample[1] = {NULL};
  dds_sample_info_t info[1];
  while (dds_take(service->reader, sample, info, 1, 1) > 0) {
    if (info[0].valid_data) {
      REQUEST *request = sample[0];
      RESPONSE response = {request->client, request->number, request->a + request->b};
      check(dds_write(service->writer, &response), "respond");
    }
    dds_return_loan(service->reader, sample, 1);
  }
}

static void call(struct channel *client, int count) {
  dds_instance_handle_t own;
  dds_publication_matched_status_t matched = {0};
  dds_subscription_matched_status_t matched_reader = {0};
  check(dds_get_instance_handle(client->writer, &own), "handle");
  while (matched.current_count == 0 || matched_reader.current_count == 0) {
    dds_sleepfor(DDS_MSECS(10));
    dds_get_publication_matched_status(client->writer, &matched);
    dds_get_subscription_matched_status(client->reader, &matched_reader);
  }
  for (int number = 1; number <= count; number++) {
    REQUEST request = {own, number, number, 100};
    check(dds_write(client->writer, &request), "call");
    bool done = false;
    for (int tries = 0; tries < 20000 && !done; tries++) {
      void *sample[1] = {NULL};
      dds_sample_info_t info[1];
      if (dds_take(client->reader, sample, info, 1, 1) > 0) {
        RESPONSE *response = sample[0];
        if (info[0].valid_data && response->client == own && response->number == number) {
          printf("SUM %lld\n", (long long)response->sum);
          fflush(stdout);
          done = true;
        }
        dds_return_loan(client->reader, sample, 1);
      } else {
        dds_sleepfor(DDS_MSECS(1));
      }
    }
    if (!done) printf("TIMEOUT %d\n", number);
  }
}

static void ready(void) {
  printf("READY\n");
  fflush(stdout);
}

static void talk(const char *name) {
  dds_qos_t *qos = default_profile(false);
  dds_entity_t writer = check(dds_create_writer(participant, topic(&std_msgs_msg_dds__String__desc, name), qos, NULL), "writer");
  std_msgs_msg_dds__String_ sample = {"secret"};
  for (ready();; dds_sleepfor(DDS_MSECS(100))) check(dds_write(writer, &sample), "write");
}

static void listen(const char *name) {
  dds_qos_t *qos = default_profile(false);
  dds_entity_t reader = check(dds_create_reader(participant, topic(&std_msgs_msg_dds__String__desc, name), qos, NULL), "reader");
  void *sample[1] = {NULL};
  dds_sample_info_t info[1];
  for (ready(); dds_take(reader, sample, info, 1, 1) <= 0 || !info[0].valid_data;) dds_sleepfor(DDS_MSECS(10));
  printf("GOT %s\n", ((std_msgs_msg_dds__String_ *)sample[0])->data);
}

/* The files of the enclave in a folder, if there is one, as rmw_cyclonedds names them. */
static void secure(dds_qos_t *qos, const char *folder) {
  static const char *const files[][2] = {
    {"auth.identity_ca", "identity_ca.cert.pem"}, {"auth.identity_certificate", "cert.pem"},
    {"auth.private_key", "key.pem"}, {"access.permissions_ca", "permissions_ca.cert.pem"},
    {"access.governance", "governance.p7s"}, {"access.permissions", "permissions.p7s"},
  };
  static const char *const plugins[][3] = {
    {"auth", "auth", "authentication"}, {"crypto", "crypto", "crypto"}, {"access", "ac", "access_control"},
  };
  char name[200], value[1000];
  if (folder == NULL) return;
  for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
    snprintf(name, sizeof name, "dds.sec.%s", files[i][0]);
    snprintf(value, sizeof value, "file:%s/%s", folder, files[i][1]);
    dds_qset_prop(qos, name, value);
  }
  for (size_t i = 0; i < sizeof plugins / sizeof plugins[0]; i++) {
    snprintf(name, sizeof name, "dds.sec.%s.library.path", plugins[i][0]);
    snprintf(value, sizeof value, "dds_security_%s", plugins[i][1]);
    dds_qset_prop(qos, name, value);
    snprintf(name, sizeof name, "dds.sec.%s.library.init", plugins[i][0]);
    snprintf(value, sizeof value, "init_%s", plugins[i][2]);
    dds_qset_prop(qos, name, value);
    snprintf(name, sizeof name, "dds.sec.%s.library.finalize", plugins[i][0]);
    snprintf(value, sizeof value, "finalize_%s", plugins[i][2]);
    dds_qset_prop(qos, name, value);
  }
}

int main(int argc, char **argv) {
  struct channel channels[] = {
    {"string", &std_msgs_msg_dds__String__desc, false, 0, 0},
    {"sensor", &std_msgs_msg_dds__String__desc, true, 0, 0},
    {"pose", &geometry_msgs_msg_dds__PoseStamped__desc, false, 0, 0},
    {"array", &std_msgs_msg_dds__Float64MultiArray__desc, false, 0, 0},
    {"wstring", &example_interfaces_msg_dds__WString__desc, false, 0, 0},
    {"image", &sensor_msgs_msg_dds__Image__desc, false, 0, 0},
  };
  const int count = sizeof channels / sizeof channels[0];
  dds_qos_t *own = dds_create_qos();
  secure(own, getenv("SECURE_ENCLAVE"));
  participant = check(dds_create_participant(DDS_DOMAIN_DEFAULT, own, NULL), "participant");
  dds_delete_qos(own);
  if (argc > 2 && strcmp(argv[1], "talk") == 0) talk(argv[2]);
  if (argc > 2 && strcmp(argv[1], "listen") == 0) return listen(argv[2]), 0;
  dds_entity_t waitset = check(dds_create_waitset(participant), "waitset");
  for (int i = 0; i < count; i++) {
    open_channel(&channels[i]);
    check(dds_set_status_mask(channels[i].reader, DDS_DATA_AVAILABLE_STATUS), "mask");
    check(dds_waitset_attach(waitset, channels[i].reader, i), "attach");
  }
  dds_qos_t *qos = default_profile(false);
  struct channel server = {"c_add", NULL, false, 0, 0}, client = {"py_add", NULL, false, 0, 0};
  server.reader = check(dds_create_reader(participant, topic(&example_interfaces_srv_dds__AddTwoInts_Request__desc, "rq/c_addRequest"), qos, NULL), "server");
  server.writer = check(dds_create_writer(participant, topic(&example_interfaces_srv_dds__AddTwoInts_Response__desc, "rr/c_addReply"), qos, NULL), "server");
  const char *id = "clientid= 1.10.f3.7.0.a.0.1.0.0.0.1.0.0.0.2;"; /* as rmw_cyclonedds: a server waits for the reader */
  dds_qset_userdata(qos, id, strlen(id));
  client.reader = check(dds_create_reader(participant, topic(&example_interfaces_srv_dds__AddTwoInts_Response__desc, "rr/py_addReply"), qos, NULL), "client");
  client.writer = check(dds_create_writer(participant, topic(&example_interfaces_srv_dds__AddTwoInts_Request__desc, "rq/py_addRequest"), qos, NULL), "client");
  dds_delete_qos(qos);
  check(dds_set_status_mask(server.reader, DDS_DATA_AVAILABLE_STATUS), "mask");
  check(dds_waitset_attach(waitset, server.reader, count), "attach");
  ready();
  if (argc > 2 && strcmp(argv[1], "call") == 0) call(&client, atoi(argv[2]));
  for (;;) {
    dds_attach_t woken[16];
    int ready = dds_waitset_wait(waitset, woken, 16, DDS_SECS(1));
    for (int i = 0; i < ready && i < 16; i++) {
      if (woken[i] == count) serve(&server); else echo(&channels[woken[i]]);
    }
  }
}
