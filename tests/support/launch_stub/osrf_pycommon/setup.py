from setuptools import find_packages, setup

setup(name="osrf_pycommon", version="0.0.0", packages=find_packages())
