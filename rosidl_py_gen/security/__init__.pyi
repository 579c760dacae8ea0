# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.security.keystore import Keystore as Keystore
from rosidl_py_gen.security.policy import PolicyEnclave as PolicyEnclave
from rosidl_py_gen.security.policy import SecurityPolicy as SecurityPolicy
