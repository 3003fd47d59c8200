"""URScript: cubics of the joints with their times, which is the plan's own form, worked out at each step of the arm."""

import re

import numpy as np

from opcua_skill.programs.values import Header, Language, Lines, Options, Splines, Switch, ascii_of, switching_at

# The e-Series takes a command every 2 ms.
STEP = 0.002
NUMBERS = r"\[([^\]]*)\]"
PIECE = re.compile(rf"  piece\({NUMBERS}, {NUMBERS}, ([0-9.]+)\)\Z")
BEGIN = re.compile(rf"  movej\({NUMBERS}, a=")
OUTPUT = re.compile(r"  set_standard_digital_out\(([0-9]+), (True|False)\)\Z")
# Between two cubics the script must not fall behind: the arm is commanded where it is to be a step later.
BODY = """\
  global here = {start}
  global pace = [0, 0, 0, 0, 0, 0]
  def piece(goal, ahead, duration):
    local steps = floor(duration / {step} + 0.5)
    local k = 0
    while k < steps:
      k = k + 1
      local s = 1.0 * k / steps
      local a = 2 * s * s * s - 3 * s * s + 1
      local b = (s * s * s - 2 * s * s + s) * duration
      local c = 3 * s * s - 2 * s * s * s
      local d = (s * s * s - s * s) * duration
      local q = [0, 0, 0, 0, 0, 0]
      local i = 0
      while i < 6:
        q[i] = a * here[i] + b * pace[i] + c * goal[i] + d * ahead[i]
        i = i + 1
      end
      servoj(q, t={step}, lookahead_time=0.03, gain=2000)
    end
    here = goal
    pace = ahead
  end"""


def write(commanded: Lines | Splines, header: Header, options: Options, start: tuple[float, ...]) -> str:
    """Return a script of cubics; ``start`` is where the arm's joints are at its beginning."""
    assert isinstance(commanded, Splines)
    lines = [
        f"def {options.name}():",
        *(f"  # {name}: {ascii_of(value)}" for name, value in header.rows()),
        f"  # tolerance {1e3 * options.tolerance:.4f} mm of the command; the arm follows it some 30 ms later",
        "  # begin at home: the first move goes there slowly",
        f"  set_standard_digital_out({options.output}, False)",
        f"  movej({_numbers(start)}, a=0.3, v=0.1)",
        *BODY.format(start=_numbers(start), step=STEP).splitlines(),
    ]
    switching = switching_at(commanded)
    for row in range(len(commanded.times)):
        lines += [f"  set_standard_digital_out({options.output}, {opens})" for opens in switching.get(row, ())]
        if row + 1 < len(commanded.times):
            took = float(commanded.times[row + 1] - commanded.times[row])
            goal, ahead = _numbers(commanded.joints[row + 1]), _numbers(commanded.velocities[row + 1])
            lines.append(f"  piece({goal}, {ahead}, {took:.3f})")
    return "\n".join([*lines, f"  set_standard_digital_out({options.output}, False)", "  stopj(2.0)", "end", ""])


def _numbers(values: object) -> str:
    return "[" + ", ".join(f"{float(value):.7f}" for value in np.asarray(values)) + "]"


def read(text: str) -> Splines:
    """Return what a script of the form above commands."""
    times, joints, speeds = [], [], []
    switches: list[Switch] = []
    for line in text.splitlines():
        if found := BEGIN.match(line):
            times, joints, speeds = [0.0], [_row(found.group(1))], [[0.0] * 6]
        elif found := PIECE.match(line):
            times.append(times[-1] + round(float(found.group(3)) / STEP) * STEP)
            joints.append(_row(found.group(1)))
            speeds.append(_row(found.group(2)))
        elif times and (found := OUTPUT.match(line)):
            switches.append(Switch(times[-1], found.group(2) == "True"))
    if len(times) < 2:
        raise ValueError("there is no motion")
    # The last output is put off for safety, whatever it was.
    return Splines(np.array(times), np.array(joints), np.array(speeds), tuple(switches[:-1]))


def _row(text: str) -> list[float]:
    values = [float(word) for word in text.split(",")]
    if len(values) != 6:
        raise ValueError(f"{text} are not six joints")
    return values


LANGUAGE = Language(
    name="urscript",
    ending="script",
    form="splines",
    most_lines=5000,
    longest_line=1000,
    limits="nothing is published; pendants of the CB series become unstable at some thousand lines",
    quantum=STEP,
    rounding=0.0,
    axes=(6,),
    turns="any",
    write=write,
    read=read,
)
