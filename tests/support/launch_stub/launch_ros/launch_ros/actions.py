"""Nodes as child processes, and a node of launch itself."""

from __future__ import annotations

import os
import shutil
import threading
from typing import Any

import composition_interfaces.srv
import rclpy
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from launch.actions import ExecuteProcess
from launch.core import Action, Context, SubstitutionFailure
from launch.utilities import normalize_to_list_of_substitutions, perform_substitutions
from rclpy.executors import SingleThreadedExecutor
from rclpy.validate_node_name import validate_node_name
from std_msgs.msg import String


class ExecutableInPackage:
    def __init__(self, executable: Any, package: Any) -> None:
        self._executable, self._package = executable, package

    def perform(self, context: Context) -> str:
        package = perform_substitutions(context, normalize_to_list_of_substitutions(self._package))
        executable = perform_substitutions(context, normalize_to_list_of_substitutions(self._executable))
        prefix = get_package_prefix(package)
        folder = os.path.join(prefix, "lib", package)
        if not os.path.exists(folder):
            text = f"package '{package}' found at '{prefix}', but libexec directory '{folder}' does not exist"
            raise SubstitutionFailure(text)
        found = shutil.which(executable, path=folder)
        if found is None:
            raise SubstitutionFailure(f"executable '{executable}' not found on the libexec directory '{folder}' ")
        return found


class FindPackageShare:
    def __init__(self, package: str) -> None:
        self._package = package

    def perform(self, context: Context) -> str:
        return get_package_share_directory(self._package)


class Node(ExecuteProcess):
    def __init__(self, *, package: Any, executable: Any, name: str = "", arguments: Any = (), **more: Any) -> None:
        words = ["--ros-args", *(["-r", f"__node:={name}"] if name else []), *arguments]
        super().__init__([ExecutableInPackage(executable, package), *words], **more)
        self.node_package, self.node_executable = package, executable
        self._name, self._final_name = name, None

    @property
    def node_name(self) -> str:
        if self._final_name is None:
            raise RuntimeError("cannot access 'node_name' before executing action")
        return self._final_name

    def execute(self, context: Context) -> list[Any] | None:
        if self._name:
            validate_node_name(self._name)
        self._final_name = f"/{self._name}"
        return super().execute(context)


class ComposableNodeContainer(Node):
    def execute(self, context: Context) -> list[Any] | None:
        return [*(super().execute(context) or ()), LoadComposableNodes(self)]


class LoadComposableNodes(Action):
    def __init__(self, target_container: Any) -> None:
        super().__init__()
        self.__target_container = target_container

    def execute(self, context: Context) -> None:
        raise AssertionError(f"waits for ever: {composition_interfaces.srv.LoadNode} of {self.__target_container}")


class Listener(Action):
    """Subscription of the node of launch, as lifecycle nodes have one."""

    def execute(self, context: Context) -> None:
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context)
        self._node = rclpy.create_node(f"launch_ros_{os.getpid()}", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._is_running = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        self._node.create_subscription(String, "chatter", lambda message: print("launch heard", message.data), 10)
        context.on_shutdown.append(self._shutdown)

    def _run(self) -> None:
        self._executor.add_node(self._node)
        while self._is_running:
            self._executor.spin_once(timeout_sec=1.0)
        self._executor.remove_node(self._node)

    def _shutdown(self) -> None:
        self._is_running = False
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)
