"""RAPID: one MoveL a line with its time, the valve switched in the corner that it belongs to."""

import re

import numpy as np

from opcua_skill.programs.values import Header, Language, Lines, Options, Splines, Switch, ascii_of, switching_at

ZONE = re.compile(r"CONST zonedata \w+:=\[FALSE,")
NUMBERS = r"\[([^\]]*)\]"
MOVE = re.compile(
    rf"    MoveL(DO)? \[{NUMBERS},{NUMBERS},\[0,0,0,0\],\[[9E,]*\]\],v100\\T:=([0-9.]+),\w+,tool\d+(?:,\w+,([01]))?;\Z"
)
START = re.compile(rf"    MoveL \[{NUMBERS},{NUMBERS},\[0,0,0,0\],\[[9E,]*\]\],v10,fine,tool\d+;\Z")
SET = re.compile(r"    SetDO \w+,([01]);\Z")
# Times are written to the microsecond: rounded one by one, thousands of them would drift.
QUANTUM = 1e-6
FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"


def write(commanded: Lines | Splines, header: Header, options: Options, start: tuple[float, ...]) -> str:
    """Return a module of lines; ``start`` is where the arm's joints are at its beginning."""
    assert isinstance(commanded, Lines)
    signal, tool, zone = f"doValve{options.output}", f"tool{options.tool}", 0.5e3 * options.tolerance
    joints = ",".join(f"{one:.5f}" for one in np.degrees(start))
    lines = [
        f"MODULE {options.name}",
        *(f"  ! {name}: {ascii_of(value)}" for name, value in header.rows()),
        f"  ! tolerance {1e3 * options.tolerance:.4f} mm, corners rounded by the controller included",
        f"  ! {tool} has to be measured at the tip, tool0 is the flange; the world frame has to be the base",
        f"  CONST zonedata zoneSkill:=[FALSE,{zone:.5f},{zone:.5f},{zone:.5f},0.1,{zone:.5f},0.1];",
        f"  PROC run_{options.name}()",
        "    ConfL\\Off;",
        f"    SetDO {signal},0;",
        f"    MoveAbsJ [[{joints}],{FREE}],v10,fine,{tool};",
        f"    MoveL {_target(commanded, 0)},v10,fine,{tool};",
    ]
    switching = switching_at(commanded)
    lines += [f"    SetDO {signal},{int(opens)};" for opens in switching.get(0, ())]
    last = len(commanded.times) - 1
    for row in range(1, last + 1):
        took = float(commanded.times[row] - commanded.times[row - 1])
        first, *more = switching.get(row, ()) or (None,)
        zone_name = "zoneSkill" if row < last else "fine"
        move, output = ("MoveL", "") if first is None else ("MoveLDO", f",{signal},{int(first)}")
        lines.append(f"    {move} {_target(commanded, row)},v100\\T:={took:.6f},{zone_name},{tool}{output};")
        lines += [f"    SetDO {signal},{int(bool(opens))};" for opens in more]
    return "\n".join([*lines, f"    SetDO {signal},0;", "  ENDPROC", "ENDMODULE", ""])


def _target(commanded: Lines, row: int) -> str:
    place = ",".join(f"{1e3 * one:.5f}" for one in commanded.points[row])
    x, y, z, w = commanded.turns[row]
    return f"[[{place}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}],[0,0,0,0],{FREE}]"


def read(text: str) -> Lines:
    """Return what a module of the form above commands."""
    times, points, turns = [], [], []
    switches: list[Switch] = []
    for line in text.splitlines():
        if found := START.match(line):
            times.append(0.0)
        elif found := MOVE.match(line):
            times.append(times[-1] + float(found.group(4)))
            if found.group(1):
                switches.append(Switch(times[-1], found.group(5) == "1"))
            found = re.match(rf"    MoveL(?:DO)? \[{NUMBERS},{NUMBERS}", line)
        elif times and (told := SET.match(line)):
            switches.append(Switch(times[-1], told.group(1) == "1"))
        if found:
            points.append([1e-3 * float(one) for one in found.group(1).split(",")])
            w, x, y, z = (float(one) for one in found.group(2).split(","))
            turns.append([x, y, z, w])
    if len(times) < 2:
        raise ValueError("there is no motion")
    # The last output is put off for safety, whatever it was.
    return Lines(np.array(times), np.array(points), np.array(turns), tuple(switches[:-1]))


LANGUAGE = Language(
    name="rapid",
    ending="mod",
    form="lines",
    most_lines=20_000,
    longest_line=255,
    limits="chosen: ABB publishes the memory of a controller, not the lines of a module",
    quantum=QUANTUM,
    rounding=0.5,
    axes=(6,),
    turns="any",
    write=write,
    read=read,
)
