"""The robots of example-robot-data by name, listed once a process: the folder has thousands of files."""

from __future__ import annotations

from spatialdyn.urdf.load import example_robots, robot_names

_INSTALLED = frozenset(example_robots())
ROBOTS = {name: path for name, path in robot_names().items() if path in _INSTALLED}
