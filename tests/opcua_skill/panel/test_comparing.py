"""What differs between versions is told with the right sign; recipes are read and written in people's units."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from opcua_skill.client import ClientError, JobTrace, Refused, Skill
from opcua_skill.panel.comparing import FIGURES, against_paper, checks, since_before
from opcua_skill.panel.pages.audit import in_words, place_of
from opcua_skill.panel.player import trace_csv
from opcua_skill.panel.recipe_fields import choice_fields, field_at_fault, parameter_fields, quaternion, turned
from opcua_skill.panel.strokes import PAUSE, appended, drawn
from opcua_skill.panel.words import Words

EN = Words("en")
BY_LABEL = {figure.label: figure for figure in FIGURES}


def version(number: int = 1, **report: Any) -> Skill:
    """Return a version with a report, as a client has it."""
    document = {"report": report, "verdicts": [{"demonstrationId": "a", "kind": "used"}] * 4, "provenance": {}}
    return Skill("s", number, "Gluing", "Learned", b"", (), np.zeros((1, 4)), np.zeros((1, 4, 4)), document)


def test_smaller_errors_and_smoother_paths_are_better() -> None:
    here = version(path_error={"rms": 0.002, "max": 0.004}, smoothness=-16.0, components=4)
    other = version(2, path_error={"rms": 0.001, "max": 0.008}, smoothness=-14.0, components=6)
    marks = {label: BY_LABEL[label].mark(here, other) for label in BY_LABEL}
    assert marks["path against mean of people, RMS"] == "better"
    assert marks["the same, largest"] == "worse"
    assert marks["smoothness (nearer 0 is smoother)"] == "better"
    assert marks["components"] == "differs"
    assert BY_LABEL["path against mean of people, RMS"].difference(here, other) == "−1.00\u00a0mm"


@given(value=st.floats(1e-6, 1.0), change=st.floats(-0.019, 0.019))
@settings(deadline=None)
def test_two_per_cent_is_no_difference(value: float, change: float) -> None:
    here, other = version(path_error={"rms": value}), version(path_error={"rms": value * (1 + change)})
    assert BY_LABEL["path against mean of people, RMS"].mark(here, other) == ""


def test_what_nobody_measured_is_neither_better_nor_worse() -> None:
    here, other = version(), version(path_error={"rms": float("nan")}, smoothness=None)
    for figure in FIGURES:
        if "demonstrations" not in figure.label and "struck" not in figure.label:
            assert (figure.mark(here, other), figure.difference(here, other)) == ("", ""), figure.label


def test_a_path_outside_the_people_fails_its_check() -> None:
    spread = {"phases": [0.0, 1.0], "deviation": [0.001, 0.002]}
    good = checks(EN, version(path_error={"max": 0.003}, repeatability=spread))
    bad = checks(EN, version(path_error={"max": 0.005}, repeatability=spread, notes=["a note"]))
    assert [one.good for one in good] == [True, True, True]
    assert [one.sign for one in bad] == ["✓", "✓", "⚠", "⚠"]


def test_the_paper_and_the_version_before_are_told_in_words() -> None:
    paper = {"path_error": {"rms": 0.003, "max": 0.007}, "distance": {"max": 0.01, "place": 0.5}}
    previous = {"version": 1, "distance": {"max": 0.002, "place": 0.25}, "components": {"before": 4, "now": 6}}
    told = version(2, paper=paper, previous=previous)
    assert against_paper(EN, told)[0].startswith("as published, the path would be off by 3.00\u00a0mm RMS")
    assert since_before(EN, told) == ["path moved by at most 2.00\u00a0mm, at 25\u00a0%", "components: 4 → 6"]
    assert against_paper(EN, version()) == since_before(EN, version()) == []


@given(st.tuples(*[st.floats(-170.0, 170.0)] * 3).filter(lambda turn: abs(abs(turn[1]) - 90.0) > 1.0))
@settings(deadline=None)
def test_degrees_and_quaternions_are_the_same_rotation(turn: tuple[float, float, float]) -> None:
    one = quaternion(turn)
    again = quaternion(turned((0.0, 0.0, 0.0, *one)))
    assert abs(float(np.dot(one, again))) == pytest.approx(1.0, abs=1e-6)


def test_declared_parameters_become_fields_with_unit_range_and_default() -> None:
    declared = [
        {"name": "BlendRadius", "description": "", "unit": "m", "default": 0.0, "minimum": 0.0, "maximum": 0.1},
        {"name": "Corners", "description": "", "unit": "", "default": "slow", "minimum": None, "maximum": None},
        {"name": "Flow", "description": "flow of glue", "unit": "ml/min", "default": 12.0, "minimum": 1, "maximum": 30},
    ]
    blend, flow = parameter_fields(declared)
    assert (blend.range, blend.shown(0.0005), blend.fault(101.0)) == ("0 … 100\u00a0mm", 0.5, "0 … 100\u00a0mm")
    assert (flow.label, flow.range, flow.fault(12.0)) == ("flow of glue", "1 … 30\u00a0ml/min", "")
    assert [name for name, *_ in choice_fields(declared)] == ["Corners"]


def test_a_refusal_names_the_field_it_is_about() -> None:
    refused = Refused("PutRecipe", "BadInvalidArgument", "Recipe", "time_step is 1.0: it has to be 0.0005 to 0.1")
    assert field_at_fault(refused) == "time_step"
    refused = Refused("PutRecipe", "BadInvalidArgument", "Recipe", "parameters.BlendRadius is 2.0: at most 0.1")
    assert field_at_fault(refused) == "BlendRadius"
    assert field_at_fault(ClientError("the line is dead")) == ""


def test_a_stroke_becomes_one_press_of_a_tracker() -> None:
    t = np.linspace(0.0, 1.0, 20)
    stroke = drawn("one", "tina", t.tolist(), (20 + 10 * t).tolist(), [40.0] * 20)
    times, points, pressed = appended(stroke, 3.0)
    assert (np.diff(times) > 0).all() and times[0] == pytest.approx(3.0 + PAUSE)
    assert pressed.sum() == 20 and not pressed[-1] and times[-1] - times[19] >= 0.05
    assert len(points) == len(times) == len(pressed)


def test_a_run_is_taken_away_as_csv() -> None:
    run = JobTrace(np.array([0.0, 0.5]), np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0], [0.003, 0.0, 0.004]]))
    head, first, last = trace_csv(run).splitlines()
    assert head.split(",")[0] == "time_s" and head.endswith("measured_z_m,error_m")
    assert first == "0,0,0,0,0,0,0,0" and last == "0.5,0,0,0,0.003,0,0.004,0.005"


def test_an_audit_entry_is_said_on_one_line() -> None:
    assert in_words({"SkillName": "w", "Version": 2, "Comment": ""}) == "SkillName: w · Version: 2"
    assert len(in_words({"Points": list(range(1000))})) == 160
    assert place_of("ns=3;s=Machines/ws1/Arm") == "Machines/ws1/Arm"
