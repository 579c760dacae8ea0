# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.wheels.build import PackageManifest as PackageManifest
from rosidl_py_gen.wheels.build import build_wheels as build_wheels
from rosidl_py_gen.wheels.environment import Installer as Installer
from rosidl_py_gen.wheels.libddsc import InstalledLibrary as InstalledLibrary
