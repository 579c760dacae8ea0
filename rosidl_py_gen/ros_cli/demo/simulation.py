"""Room of the demo with walls, boxes and bodies of robots, and the schedule that calls each task at its rate.

Time is real or simulated. Tasks run one after the other, at times that only their rates determine. So a robot drives in
the same way however busy the machine is, which timers of nodes could not guarantee. The room does not depend on ROS.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rosidl_py_gen.runtime import ClockType, Node, Time

Array = np.ndarray[Any, np.dtype[Any]]

RESOLUTION_M = 0.05
"""Size of a map cell in metres. All edges of boxes are multiples of it, so that map and laser rays agree exactly."""
BODY_RADIUS_M = 0.2
MAX_ACCELERATION = 1.0
"""Maximum acceleration of a body in m/s², which limits how fast it reaches its commanded speed."""
MAX_TURN_ACCELERATION = 6.0
"""Maximum angular acceleration of a body in rad/s²."""


class Box(NamedTuple):
    """Rectangle on the floor of the room, with its position in metres and its colour."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float
    color: tuple[int, int, int]


_WALL = (205, 200, 190)
BOXES = (
    Box(-4.1, -3.1, 4.1, -3.0, _WALL),
    Box(-4.1, 3.0, 4.1, 3.1, _WALL),
    Box(-4.1, -3.0, -4.0, 3.0, _WALL),
    Box(4.0, -3.0, 4.1, 3.0, _WALL),
    Box(0.3, 1.0, 0.5, 3.0, _WALL),
    Box(-2.8, 1.2, -1.8, 1.8, (60, 110, 190)),
    Box(-2.2, -2.0, -1.6, -1.4, (200, 80, 60)),
    Box(1.6, -1.2, 2.8, -0.4, (80, 160, 90)),
    Box(2.9, 1.9, 3.5, 2.5, (220, 170, 60)),
)
"""Boxes of the room: four walls around 8 m x 6 m, a wall between its two halves, and four obstacles."""
BODY_COLOR = (240, 240, 250)


@dataclass
class Body:
    """Body of a simulated robot with two driven wheels.

    Attributes:
        speed: current speed in m/s; it approaches `target_speed`.
        turn_rate: current turn rate in rad/s, counterclockwise; it approaches `target_turn_rate`.
        travelled: distance in metres that the wheels have driven, negative backwards.
        turned: sum of all turns in radians.
        is_blocked: True while something is in the way.
    """

    x: float
    y: float
    yaw: float
    speed: float = 0.0
    turn_rate: float = 0.0
    target_speed: float = 0.0
    target_turn_rate: float = 0.0
    travelled: float = 0.0
    turned: float = 0.0
    is_blocked: bool = False

    def place(self, x: float, y: float, yaw: float) -> None:
        """Move the body to another place in the room, where it stands still."""
        self.x, self.y, self.yaw = x, y, yaw
        self.speed = self.turn_rate = self.target_speed = self.target_turn_rate = 0.0


def along_arc(x: float, y: float, yaw: float, distance: float, turn: float) -> tuple[float, float, float]:
    """Return the pose (x, y, yaw) that is reached from a pose by driving along an arc."""
    # The chord of an arc points half-way between both directions, and is shorter than the arc.
    half = turn / 2
    chord = distance * (math.sin(half) / half if half else 1.0)
    return x + chord * math.cos(yaw + half), y + chord * math.sin(yaw + half), yaw + turn


@dataclass
class World:
    """Simulated room, with the bodies in it."""

    bodies: list[Body] = field(default_factory=list)

    def advance(self, seconds: float) -> None:
        """Move all bodies in the room as they move in a number of seconds."""
        for body in self.bodies:
            body.speed = _approach(body.speed, body.target_speed, MAX_ACCELERATION * seconds)
            body.turn_rate = _approach(body.turn_rate, body.target_turn_rate, MAX_TURN_ACCELERATION * seconds)
            distance, turn = body.speed * seconds, body.turn_rate * seconds
            x, y, yaw = along_arc(body.x, body.y, body.yaw, distance, turn)
            before, after = self.clearance(body.x, body.y, body), self.clearance(x, y, body)
            # A body that touches something may still drive away from it, and turn.
            body.is_blocked = after < BODY_RADIUS_M and after < before
            if body.is_blocked:
                body.speed, distance, (x, y) = 0.0, 0.0, (body.x, body.y)
            body.x, body.y, body.yaw = x, y, math.remainder(yaw, math.tau)
            body.travelled += distance
            body.turned += turn

    def clearance(self, x: float, y: float, body: Body | None = None) -> float:
        """Return the distance in metres from a point to the nearest box or body, not counting `body` itself."""
        boxes = (
            math.hypot(max(box.x_min - x, x - box.x_max, 0), max(box.y_min - y, y - box.y_max, 0)) for box in BOXES
        )
        others = (math.hypot(one.x - x, one.y - y) - BODY_RADIUS_M for one in self.bodies if one is not body)
        return min(*boxes, *others)

    def cast(self, x: float, y: float, angles: Array, body: Body | None = None) -> tuple[Array, Array]:
        """Return where rays from a point end: their lengths, and the colours of the objects that they hit, of shape
        ``(n, 3)``.

        Args:
            angles: directions of the rays in the room.
            body: a body that the rays pass through, usually the body that carries the sensor.
        """
        origin = np.array((x, y))
        direction = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        direction[direction == 0] = 1e-12
        # Boxes: a ray is inside a box while it is between both edges of x and both edges of y.
        first = (_LOW - origin) / direction[:, None]
        second = (_HIGH - origin) / direction[:, None]
        enter, leave = np.minimum(first, second).max(axis=2), np.maximum(first, second).min(axis=2)
        lengths = np.where((enter <= leave) & (leave > 0), np.maximum(enter, 0), np.inf)
        # Bodies are circles: the ray passes the centre at a distance, half a chord before and after that point.
        others = [one for one in self.bodies if one is not body]
        centers = np.array([(one.x, one.y) for one in others]).reshape(-1, 2) - origin
        along = direction @ centers.T
        half_squared = BODY_RADIUS_M**2 - (centers**2).sum(axis=1) + along**2
        circles = np.where((half_squared > 0) & (along > 0), along - np.sqrt(np.maximum(half_squared, 0)), np.inf)
        lengths = np.concatenate([lengths, circles], axis=1)
        hit = lengths.argmin(axis=1)
        return lengths[np.arange(len(hit)), hit], _COLORS[np.minimum(hit, len(BOXES))]

    def free_place(self, random: np.random.Generator) -> tuple[float, float, float]:
        """Return a random pose (x, y, yaw) at which a body has free space around it."""
        while True:
            x, y, yaw = random.uniform((-3.5, -2.5, -math.pi), (3.5, 2.5, math.pi)).tolist()
            if self.clearance(x, y) > 2 * BODY_RADIUS_M:
                return x, y, yaw


def occupancy() -> Array:
    """Return the map of the room as an array of cells: 100 for cells in a box, else 0.

    Row 0 has the lowest y, and cell (0, 0) begins at `MAP_ORIGIN`.
    """
    size = np.rint((_HIGH.max(axis=0) - MAP_ORIGIN) / RESOLUTION_M).astype(int)
    x, y = (MAP_ORIGIN[axis] + (np.arange(size[axis]) + 0.5) * RESOLUTION_M for axis in (0, 1))
    cells = np.zeros((size[1], size[0]), np.int8)
    for box in BOXES:
        inside = np.outer((y > box.y_min) & (y < box.y_max), (x > box.x_min) & (x < box.x_max))
        cells[inside] = 100
    return cells


def _approach(value: float, target: float, step: float) -> float:
    return value + max(-step, min(step, target - value))


_LOW = np.array([(box.x_min, box.y_min) for box in BOXES])
_HIGH = np.array([(box.x_max, box.y_max) for box in BOXES])
_COLORS = np.array([*(box.color for box in BOXES), BODY_COLOR], np.uint8)
MAP_ORIGIN: Array = _LOW.min(axis=0)


_MAX_DELAY_S = 0.5
"""Delay in seconds after which the schedule restarts from the current time instead of catching up, as after a suspended
process."""
_NS_PER_S = 1_000_000_000


class Schedule:
    """Schedule that calls tasks when they are due, in real or in simulated time.

    Args:
        node: its clock is the time, unless that is simulated; with simulated time it publishes ``/clock``.
        advance: called with the seconds that have passed, before the tasks that are due then.
        speed: simulated seconds per second; None for real time.
    """

    def __init__(self, node: Node, advance: Callable[[float], None], *, speed: float | None = None) -> None:
        self.elapsed_s = 0.0
        """Seconds of the schedule's time since its start."""
        self._clock = node.clock
        self._advance = advance
        self._speed = speed
        self._sim_time = None if speed is None else node.create_sim_time_publisher()
        self.now = self._clock.now() if self._sim_time is None else self._sim_time.now
        """Time of the current task, for the stamps of messages."""
        self._numbers = itertools.count()
        self._tasks: list[tuple[float, int, Callable[[], float], Callable[[], None]]] = []

    def every(self, rate_hz: Callable[[], float], task: Callable[[], None]) -> None:
        """Register a task that is called repeatedly.

        Its rate may change at any time, with effect after the next call.
        """
        self._push(self.elapsed_s, rate_hz, task)

    def _push(self, after_s: float, rate_hz: Callable[[], float], task: Callable[[], None]) -> None:
        due_s = round(after_s + 1 / rate_hz(), 9)  # nanoseconds, so that errors do not add up
        heapq.heappush(self._tasks, (due_s, next(self._numbers), rate_hz, task))

    async def run(self, duration_s: float = math.inf) -> None:
        """Call all registered tasks when they are due, until the duration has passed."""
        loop = asyncio.get_running_loop()
        start_s, speed = loop.time(), self._speed or 1.0
        while self._tasks and self._tasks[0][0] <= duration_s:
            due_s, _, rate_hz, task = heapq.heappop(self._tasks)
            delay_s = loop.time() - (start_s + due_s / speed)
            if delay_s > _MAX_DELAY_S:
                start_s += delay_s
            await asyncio.sleep(max(0.0, -delay_s))
            if due_s > self.elapsed_s:
                self._advance(due_s - self.elapsed_s)
                self.elapsed_s = due_s
                self._read_clock()
            task()
            self._push(due_s, rate_hz, task)

    def _read_clock(self) -> None:
        if self._sim_time is None:
            self.now = self._clock.now()
        else:  # before the tasks, so that no stamp is later than the time on /clock
            self.now = Time(nanoseconds=round(self.elapsed_s * _NS_PER_S), clock_type=ClockType.ROS_TIME)
            self._sim_time.set_time(self.now)
