"""One round of scripts/irsim: the lab's maze in irsim-x, then in Teseo, and how many times as fast."""

import json
import math
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib

import irsim
import numpy
import yaml

STEPS = 2_000
ROUNDS = 5
BEAMS = 240
MAZE = pathlib.Path("config/worlds/lab02.toml")
SCANS = pathlib.Path("services/simulator/tests/data/lab02_scans.json")
# [m] Between a beam of one and the mean of its neighbours in the other, at the median.
AGREES = 0.01


def world():
    """lab02 in IR-SIM's words; the robot is where the first of the reference scans was cast."""
    maze = tomllib.loads(MAZE.read_text())
    start = maze["start"]["outer"]
    boxes = [
        {
            "shape": {"name": "rectangle", "length": box["size_x_m"], "width": box["size_y_m"]},
            "state": [box["x_m"], box["y_m"], 0.0],
        }
        for box in maze["box"]
    ]
    lidar = {
        "type": "lidar2d",
        "range_min": 0.0,
        "range_max": 8.0,
        # From the first beam to the last; it makes nothing of a full turn.
        "angle_range": 2.0 * math.pi * (BEAMS - 1) / BEAMS,
        "number": BEAMS,
        "noise": False,
    }
    robot = {
        "kinematics": {"name": "diff"},
        "shape": {"name": "circle", "radius": 0.105},
        "state": [start["x_m"], start["y_m"], start["yaw_rad"]],
        "vel_min": [-0.22, -2.84],
        "vel_max": [0.22, 2.84],
        "sensors": [lidar],
    }
    return {
        "world": {"width": 3, "height": 3, "offset": [-1.5, -1.5], "step_time": 0.05, "sample_time": 0.05},
        "robot": [robot],
        "obstacle": boxes,
    }


def check(scan):
    """Ends where irsim-x does not see the same maze."""
    reference = json.loads(SCANS.read_text())[0]
    ranges = numpy.asarray(reference["ranges"])
    angles = scan["angle_min"] + scan["angle_increment"] * numpy.arange(len(scan["ranges"]))
    beams = (numpy.degrees(angles) / reference["increment_deg"]) % len(ranges)
    left, part = beams.astype(int) % len(ranges), beams % 1.0
    expected = (1.0 - part) * ranges[left] + part * ranges[(left + 1) % len(ranges)]
    error = statistics.median(abs(expected - scan["ranges"]))
    if AGREES < error:
        sys.exit(f"the two do not see the same maze: {error:.3f} m apart")


def main():
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        yaml.safe_dump(world(), file)
        file.flush()
        robot = irsim.make(file.name, display=False)
    robot.step(numpy.zeros((2, 1)))
    check(robot.get_lidar_scan())
    command = numpy.array([[0.04], [1.0]])
    times = []
    for _ in range(ROUNDS):
        begun = time.perf_counter()
        for _ in range(STEPS):
            robot.step(command)
        times.append((time.perf_counter() - begun) / STEPS * 1e9)
    table = subprocess.run([sys.argv[1]], capture_output=True, text=True, check=True).stdout
    own = next(line.split() for line in table.splitlines() if line.startswith("all "))
    best, median = float(own[1]), float(own[2])
    print(f"  irsim-x, a step      {min(times):9.0f} ns best {statistics.median(times):9.0f} median")
    print(f"  teseo, a step        {best:9.0f} ns best {median:9.0f} median")
    print(f"  times as fast        {min(times) / best:9.0f}         {statistics.median(times) / median:9.0f}")


main()
