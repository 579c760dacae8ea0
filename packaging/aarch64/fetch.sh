#!/bin/sh
# fetch.sh FOLDER: unpack Debian's arm64 packages of Python, numpy and libddsc below FOLDER, without installing any.
set -eu
mkdir -p "$1/debs" "$1/root" "$1/lists/partial" "$1/site"
cd "$1"
: >status
arm="-o Dir::State::status=$PWD/status -o Dir::State::lists=$PWD/lists -o APT::Architecture=arm64 -o APT::Architectures::=arm64"
# shellcheck disable=SC2086
apt-get $arm -qq update
# shellcheck disable=SC2086
apt-get $arm -qq -y --no-install-recommends -d -o Dir::Cache::archives="$PWD/debs" install \
    python3-numpy python3-yaml python3-jinja2 python3-click libddsc0debian
for package in debs/*.deb; do dpkg-deb -x "$package" root; done
python3 -m pip -q install --no-deps --target site lark
