"""Command group ``rosidl-py security``: keystores of SROS2, without a ROS installation."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

security = LazyGroup(
    "security",
    package=__name__,
    help="Keystores for secured networks (SROS2): keys, certificates, permissions, policies.",
    verbs={
        "create_enclave": ("keystore_commands", "Create the key, the certificate and the permissions of an enclave."),
        "create_keystore": ("keystore_commands", "Create a keystore: a certificate authority and the governance."),
        "create_permission": ("permission_commands", "Sign permissions for an enclave, made from a policy."),
        "generate_artifacts": ("permission_commands", "Create a keystore, enclaves and permissions in one step."),
        "generate_policy": ("generate_policy", "Write a policy that allows what the running nodes do."),
        "list_enclaves": ("keystore_commands", "Print the enclaves of a keystore."),
    },
)
