"""xacro of the package index, with packages of the workspace."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rosidl_py_gen.robot.urdf import parse_urdf

pytest.importorskip("xacro")


def test_a_process_of_xacro_finds_packages_of_the_workspace(tmp_path: Path) -> None:
    folder = tmp_path / "src" / "my_robot"
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(
        "<package format='3'><name>my_robot</name><version>0.0.0</version><description/>"
        "<export><build_type>ament_python</build_type></export></package>"
    )
    (folder / "arm.xacro").write_text(
        """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="arm" params="side">
        <link name="${side}_arm"/><joint name="${side}" type="continuous">
        <parent link="base"/><child link="${side}_arm"/>
        <origin xyz="0 ${1 if side == 'left' else -1} 0"/></joint></xacro:macro></robot>"""
    )
    (folder / "robot.urdf.xacro").write_text(
        """<robot name="$(arg name)" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="name" default="r"/>
        <xacro:include filename="$(find my_robot)/arm.xacro"/><link name="base"/>
        <xacro:arm side="left"/><xacro:arm side="right"/></robot>"""
    )
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", "xacro", "xacro", "src/my_robot/robot.urdf.xacro"]
    done = subprocess.run([*command, "name:=two"], capture_output=True, text=True, cwd=tmp_path, timeout=60)
    assert done.returncode == 0, done.stderr
    joints = parse_urdf(done.stdout)
    assert {name: one.origin.translation for name, one in joints.items()} == {"left": (0, 1, 0), "right": (0, -1, 0)}
