"""The quality report as an engineer reads it: every figure with its unit and place, nothing for what is not told."""

from models.learning import LearningOptions, learn
from models.report import Previous
from models.synthetic import simulated_people
from opcua_skill.commands.terminal.quality import facts, mm

PEOPLE, _ = simulated_people(5, 0)


def test_a_second_version_is_told_against_the_first_and_the_paper() -> None:
    first = learn(PEOPLE)
    again = learn(PEOPLE[:4], previous=Previous(1, first.motion, None)).report.as_dict()
    told = dict(facts(again))
    assert told["preset"] == "recommended: 4 components over the path"
    assert " mm RMS, " in told["path error"]
    assert "of the path" in told["repeatability"]
    assert " at most at " in told["from version 1"]
    assert "Fréchet" in told["from version 1"]
    assert " s → " in told["  duration"]
    assert told["  components"] == "4, as before"
    assert told["  repeatability"].startswith("unknown → ")
    assert told["the paper's preset, estimated"].endswith("from this path")
    assert "starts" in told["  its ends"]


def test_what_a_report_does_not_tell_is_left_out() -> None:
    assert facts({}) == []
    paper = dict(facts(learn(PEOPLE, options=LearningOptions(preset="paper")).report.as_dict()))
    assert not any("the paper" in what or "version" in what for what in paper)
    note = {"previous": {"version": 3, "note": "version 3 has 2 dimensions, this one 3"}, "notes": ["mind this"]}
    assert facts(note) == [("to version 3", "version 3 has 2 dimensions, this one 3"), ("note", "mind this")]


def test_millimetres_have_as_many_digits_as_matter() -> None:
    assert [mm(value) for value in (0.00012, 0.0123, 0.2345, None)] == ["0.12 mm", "12.3 mm", "234 mm", "unknown"]
