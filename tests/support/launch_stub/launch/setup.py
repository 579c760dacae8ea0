from setuptools import find_packages, setup

setup(name="launch", version="0.0.0", packages=find_packages())
