# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.security.keystore import Keystore as Keystore
from rosidl_py_gen.security.keystore import locked as locked
from rosidl_py_gen.security.keystore import write_file as write_file
from rosidl_py_gen.security.policy import ALLOW as ALLOW
from rosidl_py_gen.security.policy import RULES as RULES
from rosidl_py_gen.security.policy import VERSION as VERSION
from rosidl_py_gen.security.policy import PolicyEnclave as PolicyEnclave
from rosidl_py_gen.security.policy import check_enclave_name as check_enclave_name
from rosidl_py_gen.security.policy import policy_text as policy_text
from rosidl_py_gen.security.policy import read_policy as read_policy
from rosidl_py_gen.security.policy import wildcard_enclave as wildcard_enclave
