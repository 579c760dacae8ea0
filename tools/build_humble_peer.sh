#!/usr/bin/env bash
# Builds rclpy of ROS 2 Humble, with `ros2`, on Fast DDS 2.6 and Cyclone DDS 0.10. No package index has it.
#
#     tools/build_humble_peer.sh FOLDER
#     mkdir PEERS && ln -s "$PWD"/FOLDER/install PEERS/humble && ln -s humble PEERS/cyclone_humble
#     ROSIDL_PEERS=PEERS pytest tests/peers/interop_rclpy -k humble
#     FOLDER/install/bin/python FOLDER/install/bin/ros2 node list
#
# FOLDER gets about 1 GB in 25 to 50 minutes on two processors; a second run continues. $CLONES may name a folder that has
# `owner/name` for each repository below, instead of github.com. Debian 12 and its Python 3.11, as root or with:
#     apt install cmake ninja-build g++ git python3-dev python3-venv libasio-dev libtinyxml2-dev libfoonathan-memory-dev \
#         libssl-dev libyaml-dev pybind11-dev cyclonedds-dev
set -euo pipefail
[ $# = 1 ] || { sed -n '2,/^set/p' "$0" | grep '^#'; exit 2; }
mkdir -p "$1"
top=$(cd "$1" && pwd) clones=${CLONES:-https://github.com} install=$top/install
jobs=${JOBS:-2}

# The files of a repository at a branch or tag, without those that begin with further arguments.
files() {
    local repository=$1 version=$2 folder=$top/src/${1#*/}
    [ ! -e "$folder.done" ] || return 0
    rm -rf "$folder" "$folder.git"
    mkdir -p "$folder"
    git clone -q --no-checkout --depth 1 --branch "$version" "$clones/$repository" "$folder.git"
    git -C "$folder.git" archive HEAD -- . "${@:3}" | tar x -C "$folder"
    rm -rf "$folder.git"
    touch "$folder.done"
}

files eProsima/Fast-CDR v1.0.29
files eProsima/Fast-DDS v2.6.10 ':!src/cpp/rtps/persistence/sqlite3.c' ':!test'
for name in ament_cmake ament_index ament_package; do files "ament/$name" humble; done
for name in ament_cmake_ros common_interfaces example_interfaces libyaml_vendor pybind11_vendor python_cmake_module rcl \
    rcl_interfaces rcl_logging rclpy rcpputils rcutils rmw rmw_cyclonedds rmw_dds_common rmw_fastrtps rmw_implementation \
    ros2_tracing ros2cli rosidl rosidl_defaults rosidl_python rosidl_runtime_py rosidl_typesupport \
    rosidl_typesupport_fastrtps rpyutils test_interface_files unique_identifier_msgs; do
    files "ros2/$name" humble
done
files osrf/osrf_pycommon master
mkdir -p "$top/src/Fast-DDS/test" "$install"
touch "$top/src/Fast-DDS/test/CMakeLists.txt" "$install/COLCON_IGNORE" # its CMakeLists.txt wants the folder of tests
for name in Fast-DDS Fast-CDR rcl_logging/rcl_logging_spdlog rmw_fastrtps/rmw_fastrtps_dynamic_cpp \
    ros2cli/ros2lifecycle_test_fixtures ros2cli/ros2cli_test_interfaces; do
    touch "$top/src/$name/COLCON_IGNORE"
done

# Debian's libyaml instead of a download.
sed -i '/^build_libyaml()/d; /^set(extra_test_dependencies/d; /^ament_export_\(dependencies\|libraries\)(yaml)/d' \
    "$top/src/libyaml_vendor/CMakeLists.txt"
parser=$top/src/rcl/rcl_yaml_param_parser/CMakeLists.txt
grep -q '^link_libraries(yaml)' "$parser" || sed -i 's/^find_package(libyaml_vendor.*/&\nlink_libraries(yaml)/' "$parser"

[ -e "$top/venv" ] || /usr/bin/python3.11 -m venv "$top/venv"
touch "$top/venv/COLCON_IGNORE"
. "$top/venv/bin/activate"
pip -q install 'empy==3.3.4' 'numpy<2' 'setuptools<70' argcomplete catkin_pkg lark netifaces packaging psutil pyyaml \
    colcon-core colcon-cmake colcon-library-path colcon-package-information colcon-package-selection \
    colcon-python-setup-py colcon-ros

for name in Fast-CDR Fast-DDS; do
    cmake -G Ninja -S "$top/src/$name" -B "$top/build/$name" -DCMAKE_BUILD_TYPE=Release -DBUILD_SHARED_LIBS=ON \
        -DCMAKE_INSTALL_PREFIX="$install" -DCMAKE_PREFIX_PATH="$install" -DCMAKE_CXX_FLAGS='-O1 -w' \
        -DSQLITE3_SUPPORT=OFF -DCOMPILE_TOOLS=OFF
    cmake --build "$top/build/$name" -j "$jobs" --target install
done

# Messages first need only Fast CDR. A package that is installed is built again in a second.
# Without MAKEFLAGS, colcon starts nothing while the machine is busy.
export MAKEFLAGS=-j$jobs RCL_LOGGING_IMPLEMENTATION=rcl_logging_noop CMAKE_PREFIX_PATH=$install CMAKE_BUILD_PARALLEL_LEVEL=$jobs
export PYTHONPATH=$install/lib/python3.11/site-packages
cd "$top"
colcon --log-base "$top/log" build --base-paths "$top/src" --merge-install --install-base "$install" \
    --build-base "$top/build" --executor sequential --packages-up-to rclpy rmw_fastrtps_cpp rmw_cyclonedds_cpp \
    std_msgs std_srvs test_msgs sensor_msgs example_interfaces \
    ros2action ros2lifecycle ros2node ros2param ros2service ros2topic \
    --cmake-args -G Ninja -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS='-O1 -w' -DCMAKE_C_FLAGS='-O1 -w' \
    -DPython3_EXECUTABLE="$top/venv/bin/python" -DPYTHON_EXECUTABLE="$top/venv/bin/python" -DTRACETOOLS_DISABLED=ON

cat >"$install/bin/python" <<END
#!/bin/sh
export LD_LIBRARY_PATH=$install/lib AMENT_PREFIX_PATH=$install PYTHONPATH=$PYTHONPATH
ulimit -v 4000000 # beside later distributions it may take all memory: docs/internals/protocol.md 6.5
exec $top/venv/bin/python "\$@"
END
chmod +x "$install/bin/python"
