"""KRL: one LIN a line with the speed that makes its time, the valve switched by a trigger where the line begins."""

import re

import numpy as np
from scipy.spatial.transform import Rotation

from opcua_skill.programs.values import Header, Language, Lines, Options, Splines, Switch, ascii_of, switching_at
from sim.arm_model import Floats

SPEED = re.compile(r"\$VEL\.CP=([0-9.eE+-]+)\Z")
MOVE = re.compile(r"LIN \{([^}]*)\}(?: C_DIS)?\Z")
WAIT = re.compile(r"WAIT SEC ([0-9.eE+-]+)\Z")
TRIGGER = re.compile(r"TRIGGER WHEN DISTANCE=0 DELAY=0 DO \$OUT\[[0-9]+\]=(TRUE|FALSE)\Z")
OUTPUT = re.compile(r"\$OUT\[[0-9]+\]=(TRUE|FALSE)\Z")
# A line shorter than that, m, is a rest: its time is waited.
REST = 1e-7
# Per cent of the joints' speed and acceleration on the way to home: what INITMOV leaves is all that they can.
SLOWLY = 5


def write(commanded: Lines | Splines, header: Header, options: Options, start: tuple[float, ...]) -> str:
    """Return a program of lines; ``start`` is where the arm's joints are at its beginning."""
    assert isinstance(commanded, Lines)
    joints = ", ".join(f"A{k} {one:.5f}" for k, one in enumerate(np.degrees(start), start=1))
    points = np.round(commanded.points, 8)
    output, last = f"$OUT[{options.output}]", len(points) - 1
    lines = [
        f"DEF {options.name}( )",
        *(f"; {name}: {ascii_of(value)}" for name, value in header.rows()),
        f"; tolerance {1e3 * options.tolerance:.4f} mm, corners rounded by the controller included",
        f"; TOOL_DATA[{options.tool}] has to be measured at the tip of the tool; base 0 is the arm's own",
        "BAS(#INITMOV,0)",
        f"BAS(#TOOL,{options.tool})",
        "BAS(#BASE,0)",
        f"BAS(#VEL_PTP,{SLOWLY})",
        f"BAS(#ACC_PTP,{SLOWLY})",
        f"{output}=FALSE",
        f"PTP {{{joints}}}",
        f"$APO.CDIS={0.5e3 * options.tolerance:.5f}",
        "$VEL.CP=0.01",
        f"LIN {{{_frame(points[0], commanded.turns[0])}}}",
    ]
    switching = switching_at(commanded)
    for row in range(last):
        for opens in switching.get(row, ()):
            lines.append(f"TRIGGER WHEN DISTANCE=0 DELAY=0 DO {output}={'TRUE' if opens else 'FALSE'}")
        took = float(commanded.times[row + 1] - commanded.times[row])
        way = float(np.linalg.norm(points[row + 1] - points[row]))
        if way < REST:
            lines.append(f"WAIT SEC {took:.7g}")
            points[row + 1] = points[row]
            continue
        ending = " C_DIS" if row + 1 < last else ""
        lines += [f"$VEL.CP={way / took:.9g}", f"LIN {{{_frame(points[row + 1], commanded.turns[row + 1])}}}{ending}"]
    lines += [f"{output}={'TRUE' if opens else 'FALSE'}" for opens in switching.get(last, ())]
    return "\n".join([*lines, f"{output}=FALSE", "END", ""])


def _frame(point: Floats, turn: Floats) -> str:
    x, y, z = (1e3 * float(one) for one in point)
    a, b, c = Rotation.from_quat(turn).as_euler("ZYX", degrees=True)
    return f"X {x:.5f}, Y {y:.5f}, Z {z:.5f}, A {a:.6f}, B {b:.6f}, C {c:.6f}"


def read(text: str) -> Lines:
    """Return what a program of the form above commands."""
    times, points, turns = [], [], []
    switches: list[Switch] = []
    speed = 0.0
    for line in text.splitlines():
        if found := SPEED.match(line):
            speed = float(found.group(1))
        elif found := WAIT.match(line):
            times.append(times[-1] + float(found.group(1)))
            points.append(points[-1])
            turns.append(turns[-1])
        elif found := MOVE.match(line):
            values = dict(word.split() for word in found.group(1).split(", "))
            point = np.array([1e-3 * float(values[letter]) for letter in "XYZ"])
            way = float(np.linalg.norm(point - points[-1])) if points else 0.0
            times.append(times[-1] + way / speed if times else 0.0)
            points.append(point)
            angles = [float(values[letter]) for letter in "ABC"]
            turns.append(Rotation.from_euler("ZYX", angles, degrees=True).as_quat())
        elif times and (found := TRIGGER.match(line) or OUTPUT.match(line)):
            switches.append(Switch(times[-1], found.group(1) == "TRUE"))
    if len(times) < 2:
        raise ValueError("there is no motion")
    # The last output is put off for safety, whatever it was.
    return Lines(np.array(times), np.array(points), np.array(turns), tuple(switches[:-1]))


LANGUAGE = Language(
    name="krl",
    ending="src",
    form="lines",
    most_lines=40_000,
    longest_line=471,
    limits="KUKA System Software: 471 letters a line; the number of lines is chosen",
    quantum=0.0,
    rounding=0.5,
    axes=(6,),
    turns="any",
    write=write,
    read=read,
)
