"""Actions."""

from __future__ import annotations

import asyncio
import os
import signal
from contextlib import suppress
from typing import Any

from launch.core import Action, Context
from launch.utilities import normalize_to_list_of_substitutions, perform_substitutions


class DeclareLaunchArgument(Action):
    def __init__(self, name: str, default_value: str | None = None, description: str = "no description given") -> None:
        super().__init__()
        self.name, self.description = name, description
        self.default_value = None if default_value is None else [_Text(default_value)]

    def execute(self, context: Context) -> None:
        if self.default_value is not None:
            context.launch_configurations.setdefault(self.name, self.default_value[0].text)


class _Text:
    def __init__(self, text: str) -> None:
        self.text = text

    def describe(self) -> str:
        return f"'{self.text}'"


class OpaqueFunction(Action):
    def __init__(self, function: Any) -> None:
        super().__init__()
        self._function = function

    def execute(self, context: Context) -> Any:
        return self._function(context)


class IncludeLaunchDescription(Action):
    def __init__(self, source: Any, launch_arguments: Any = ()) -> None:
        super().__init__()
        self.launch_description_source = source
        self._arguments = launch_arguments

    def describe_sub_entities(self) -> list[Any]:
        with suppress(OSError):
            return [self.launch_description_source.get_launch_description(None)]
        return []

    def execute(self, context: Context) -> list[Any]:
        description = self.launch_description_source.get_launch_description(context)
        context.launch_configurations.update(self._arguments)
        return [description]


class TimerAction(Action):
    def __init__(self, period: float, actions: list[Any]) -> None:
        super().__init__()
        self._actions = actions

    def describe_conditional_sub_entities(self) -> list[tuple[str, list[Any]]]:
        return [("after the period", self._actions)]


class ExecuteLocal(Action):
    shell = False

    def __init__(self, cmd: list[Any], cwd: str | None = None, **more: Any) -> None:
        super().__init__(**more)
        self._cmd, self._cwd = cmd, cwd
        self.process_details: dict[str, Any] | None = None
        self.process: asyncio.subprocess.Process | None = None

    def prepare(self, context: Context) -> None:
        words = [perform_substitutions(context, normalize_to_list_of_substitutions(one)) for one in self._cmd]
        self.process_details = {"cmd": words, "cwd": self._cwd, "env": None}

    def execute(self, context: Context) -> list[Any] | None:
        self.prepare(context)
        context.service.add(self._run())
        context.on_shutdown.append(self._interrupt)
        return None

    async def _run(self) -> None:
        assert self.process_details is not None
        words = self.process_details["cmd"]
        self.process = await asyncio.create_subprocess_exec(*words, cwd=self._cwd)
        name = os.path.basename(words[0])
        print(f"[{name}]: process started with pid [{self.process.pid}]", flush=True)
        print(f"[{name}]: process has ended with {await self.process.wait()}", flush=True)

    def _interrupt(self) -> None:
        if self.process is not None and self.process.returncode is None:
            self.process.send_signal(signal.SIGINT)


class ExecuteProcess(ExecuteLocal):
    pass
