"""G-code for LinuxCNC: one G1 a line in inverse time (G93), the valve as a digital output in step with the motion."""

import math
import re

import numpy as np
from scipy.spatial.transform import Rotation

from opcua_skill.programs.values import Header, Language, Lines, Options, Splines, Switch, ascii_of, switching_at
from sim.arm_model import Floats

MINUTE = 60.0
SLOW = 300.0  # mm/min to the first place, a way that nobody has planned
WORD = re.compile(r"([A-Z])(-?[0-9.]+)")
TURN = "(nozzle x y z w "


def write(commanded: Lines | Splines, header: Header, options: Options, start: tuple[float, ...]) -> str:
    """Return a program of lines; ``start`` is where the arm's joints are at its beginning."""
    assert isinstance(commanded, Lines)
    held = Rotation.from_quat(commanded.turns)
    angles = np.unwrap((held * held[0].inv()).as_rotvec()[:, 2])
    turning = float(np.abs(angles).max()) > 1e-9
    x, y, z, w = held[0].as_quat()
    lines = [
        *(f"({name}: {ascii_of(value)})" for name, value in header.rows()),
        f"(tolerance {1e3 * options.tolerance:.4f} mm, corners rounded by the controller included)",
        "(X Y Z: tip of the tool in the arm's base, mm; C: its turn about the vertical, degrees)",
        "(gate the output in pauses and aborts: M62 alone stays on)",
        f"{TURN}{x:.12f} {y:.12f} {z:.12f} {w:.12f})",
        f"G21 G90 G94 G64 P{0.5e3 * options.tolerance:.5f}",
        f"F{SLOW:g}",
        f"G1 {_place(commanded.points[0], angles[0], turning)}",
        "G93",
    ]
    switching = switching_at(commanded)
    last = len(commanded.times) - 1
    for row in range(last + 1):
        # At the end there is no motion to switch with.
        on, off = (62, 63) if row < last else (64, 65)
        lines += [f"M{on if opens else off} P{options.output}" for opens in switching.get(row, ())]
        if row < last:
            took = float(commanded.times[row + 1] - commanded.times[row])
            lines.append(f"G1 {_place(commanded.points[row + 1], angles[row + 1], turning)} F{MINUTE / took:.9f}")
    return "\n".join([*lines, "G94", f"M65 P{options.output}", "M2", ""])


def _place(point: Floats, angle: float, turning: bool) -> str:
    x, y, z = (1e3 * float(value) for value in point)
    return f"X{x:.5f} Y{y:.5f} Z{z:.5f}" + (f" C{math.degrees(float(angle)):.6f}" if turning else "")


def read(text: str) -> Lines:
    """Return what a program of the form above commands."""
    first: Rotation | None = None
    inverse = False
    place = dict.fromkeys("XYZC", 0.0)
    times, points, angles = [], [], []
    switches: list[Switch] = []
    for line in text.splitlines():
        if line.startswith("("):
            if line.startswith(TURN):
                first = Rotation.from_quat([float(word) for word in line[len(TURN) : -1].split()])
            continue
        words = WORD.findall(line)
        codes = {f"{letter}{float(value):g}" for letter, value in words if letter in "GM"}
        values = {letter: float(value) for letter, value in words}
        inverse = (inverse or "G93" in codes) and "G94" not in codes
        now = times[-1] if times else 0.0
        if codes & {"M62", "M64", "M63", "M65"}:
            if inverse:
                switches.append(Switch(now, bool(codes & {"M62", "M64"})))
        elif "G1" in codes:
            place.update({letter: values[letter] for letter in "XYZC" if letter in values})
            times.append(now + MINUTE / values["F"] if inverse else 0.0)
            points.append([1e-3 * place[letter] for letter in "XYZ"])
            angles.append(math.radians(place["C"]))
        elif not (codes | set(values)):
            raise ValueError(f"line {line!r} is not understood")
    if first is None or len(times) < 2:
        raise ValueError("there is no motion, or nothing says how the nozzle is held")
    turns = Rotation.from_rotvec(np.array(angles)[:, None] * [0.0, 0.0, 1.0]) * first
    held = np.asarray(turns.as_quat(), dtype=np.float64)
    return Lines(np.array(times), np.array(points), held, tuple(switches))


LANGUAGE = Language(
    name="gcode",
    ending="ngc",
    form="lines",
    most_lines=999_999,
    longest_line=255,
    limits="LinuxCNC: 255 letters a line, 999,999 lines a program",
    quantum=0.0,
    rounding=0.5,
    axes=(3, 4, 5, 6, 7),
    turns="about z",
    write=write,
    read=read,
)
