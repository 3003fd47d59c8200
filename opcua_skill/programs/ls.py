"""Fanuc TP in its ASCII form (LS): one linear motion a line, each in its milliseconds."""

import re

import numpy as np
from scipy.spatial.transform import Rotation

from opcua_skill.programs.values import Header, Language, Lines, Options, Splines, Switch, ascii_of, switching_at

QUANTUM = 1e-3
COMMENT = 28
MOVE = re.compile(r" *[0-9]+:L P\[([0-9]+)\] ([0-9]+)msec (?:CNT100|FINE) *;\Z")
OUTPUT = re.compile(r" *[0-9]+:  DO\[[0-9]+\]=(ON|OFF) ;\Z")
PLACE = re.compile(r"P\[([0-9]+)\]\{\Z")
VALUE = re.compile(r"\b([XYZWPR]) = *(-?[0-9.]+)")


def write(commanded: Lines | Splines, header: Header, options: Options, start: tuple[float, ...]) -> str:
    """Return a program of lines; P[1] is where it begins."""
    assert isinstance(commanded, Lines)
    name = options.name.upper()
    body = [f"  !{part} ;" for title, value in header.rows() for part in _comments(title, value)]
    body += [f"  !tolerance {1e3 * options.tolerance:.4f} mm ;", "  !corners: CNT100, not bounded ;"]
    body += ["  UFRAME_NUM=0 ;", f"  UTOOL_NUM={options.tool} ;"]
    body += [f"  DO[{options.output}]=OFF ;", "J P[1] 5% FINE ;"]
    switching = switching_at(commanded)
    last = len(commanded.times) - 1
    for row in range(last + 1):
        body += [f"  DO[{options.output}]={'ON' if opens else 'OFF'} ;" for opens in switching.get(row, ())]
        if row < last:
            took = round(float(commanded.times[row + 1] - commanded.times[row]) / QUANTUM)
            body.append(f"L P[{row + 2}] {took}msec {'CNT100' if row + 1 < last else 'FINE'} ;")
    body.append(f"  DO[{options.output}]=OFF ;")
    lines = [
        f"/PROG  {name}",
        "/ATTR",
        f'COMMENT = "{ascii_of(header.skill)[:16]}";',
        f"LINE_COUNT = {len(body)};",
        "DEFAULT_GROUP = 1,*,*,*,*;",
        "/MN",
        *(f"{number:4d}:{line}" for number, line in enumerate(body, start=1)),
        "/POS",
    ]
    angles = Rotation.from_quat(commanded.turns).as_euler("xyz", degrees=True)
    for row in range(last + 1):
        (x, y, z), (w, p, r) = 1e3 * commanded.points[row], angles[row]
        lines += [
            f"P[{row + 1}]{{",
            "   GP1:",
            f"    UF : 0, UT : {options.tool},  CONFIG : 'N U T, 0, 0, 0',",
            f"    X = {x:.4f} mm, Y = {y:.4f} mm, Z = {z:.4f} mm,",
            f"    W = {w:.5f} deg, P = {p:.5f} deg, R = {r:.5f} deg",
            "};",
        ]
    return "\n".join([*lines, "/END", ""])


def _comments(title: str, value: str) -> list[str]:
    """Return a name and a value as comments that a teach pendant can show."""
    text = ascii_of(f"{title}: {value}").replace(";", "_")
    return [text[k : k + COMMENT] for k in range(0, len(text), COMMENT)]


def read(text: str) -> Lines:
    """Return what a program of the form above commands."""
    order, times = [1], [0.0]
    switches: list[Switch] = []
    places: dict[int, dict[str, float]] = {}
    here: dict[str, float] = {}
    begun = False
    for line in text.splitlines():
        if found := MOVE.match(line):
            order.append(int(found.group(1)))
            times.append(times[-1] + QUANTUM * int(found.group(2)))
        elif found := OUTPUT.match(line):
            switches.append(Switch(times[-1], found.group(1) == "ON"))
        elif line.endswith(":J P[1] 5% FINE ;"):
            begun = True
            switches.clear()
        elif found := PLACE.match(line):
            here = places.setdefault(int(found.group(1)), {})
        else:
            here.update({letter: float(value) for letter, value in VALUE.findall(line)})
    if not begun or len(times) < 2:
        raise ValueError("there is no motion")
    points = np.array([[1e-3 * places[number][letter] for letter in "XYZ"] for number in order])
    angles = np.array([[places[number][letter] for letter in "WPR"] for number in order])
    turns = np.asarray(Rotation.from_euler("xyz", angles, degrees=True).as_quat(), dtype=np.float64)
    # The last output is put off for safety, whatever it was.
    return Lines(np.array(times), points, turns, tuple(switches[:-1]))


LANGUAGE = Language(
    name="ls",
    ending="ls",
    form="lines",
    most_lines=32_000,
    longest_line=132,
    limits="about 32,000 lines a program; a motion takes 1 to 32,767 ms; comments have 32 letters",
    quantum=QUANTUM,
    rounding=0.5,
    axes=(6,),
    turns="any",
    write=write,
    read=read,
    longest_row=30.0,
)
