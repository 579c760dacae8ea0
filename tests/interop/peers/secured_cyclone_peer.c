/* A secured program on Cyclone DDS with the files of an enclave, as rmw_cyclonedds reads them.
 *
 * "talk TOPIC FOLDER" writes a std_msgs/String ten times a second; "listen TOPIC FOLDER" ends with the first one. It
 * prints READY when everything exists, and "FAILED what: reason" and exits with 3 if security forbids it.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dds/dds.h"
#include "types.h"

static dds_entity_t check(dds_entity_t entity, const char *what) {
  if (entity < 0) {
    printf("FAILED %s: %s\n", what, dds_strretcode(-entity));
    exit(3);
  }
  return entity;
}

static dds_qos_t *secured(const char *folder) {
  static const char *files[][2] = {
    {"dds.sec.auth.identity_ca", "identity_ca.cert.pem"},
    {"dds.sec.auth.identity_certificate", "cert.pem"},
    {"dds.sec.auth.private_key", "key.pem"},
    {"dds.sec.access.permissions_ca", "permissions_ca.cert.pem"},
    {"dds.sec.access.governance", "governance.p7s"},
    {"dds.sec.access.permissions", "permissions.p7s"},
  };
  static const char *plugins[][3] = {
    {"auth", "dds_security_auth", "authentication"},
    {"crypto", "dds_security_crypto", "crypto"},
    {"access", "dds_security_ac", "access_control"},
  };
  char name[100], value[1000];
  dds_qos_t *qos = dds_create_qos();
  for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
    snprintf(value, sizeof value, "file:%s/%s", folder, files[i][1]);
    dds_qset_prop(qos, files[i][0], value);
  }
  for (size_t i = 0; i < sizeof plugins / sizeof plugins[0]; i++) {
    snprintf(name, sizeof name, "dds.sec.%s.library.path", plugins[i][0]);
    dds_qset_prop(qos, name, plugins[i][1]);
    static const char *functions[] = {"init", "finalize"};
    for (int f = 0; f < 2; f++) {
      snprintf(name, sizeof name, "dds.sec.%s.library.%s", plugins[i][0], functions[f]);
      snprintf(value, sizeof value, "%s_%s", functions[f], plugins[i][2]);
      dds_qset_prop(qos, name, value);
    }
  }
  return qos;
}

int main(int argc, char **argv) {
  if (argc < 4) return 2;
  dds_qos_t *qos = secured(argv[3]);
  dds_entity_t participant = check(dds_create_participant(DDS_DOMAIN_DEFAULT, qos, NULL), "participant");
  dds_delete_qos(qos);
  dds_entity_t topic = check(dds_create_topic(participant, &std_msgs_msg_dds__String__desc, argv[2], NULL, NULL), "topic");
  qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  if (strcmp(argv[1], "talk") == 0) {
    dds_entity_t writer = check(dds_create_writer(participant, topic, qos, NULL), "writer");
    printf("READY\n");
    fflush(stdout);
    std_msgs_msg_dds__String_ sample = {"secret"};
    for (;;) {
      check(dds_write(writer, &sample), "write");
      dds_sleepfor(DDS_MSECS(100));
    }
  }
  dds_entity_t reader = check(dds_create_reader(participant, topic, qos, NULL), "reader");
  printf("READY\n");
  fflush(stdout);
  for (;;) {
    void *sample[1] = {NULL};
    dds_sample_info_t info[1];
    if (dds_take(reader, sample, info, 1, 1) > 0 && info[0].valid_data) {
      printf("GOT %s\n", ((std_msgs_msg_dds__String_ *)sample[0])->data);
      return 0;
    }
    dds_sleepfor(DDS_MSECS(10));
  }
}
