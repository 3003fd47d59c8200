"""Traces as files are complete, in named units, and lose nothing."""

import csv

import numpy as np

from sim.drivers.kinematic.arm import KinematicArm
from sim.testing.conformance import line_plan
from sim.traces import columns, to_csv


async def test_a_trace_read_back_from_csv_is_bitwise_the_same(model):
    arm = KinematicArm(model, realtime=False)
    await arm.open()
    trace = await arm.run(line_plan(model, 0.02), lambda _: None)
    await arm.close()
    lines = to_csv(trace).splitlines()
    assert lines[0].startswith("# source: ")
    assert "no physics" in lines[0]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    for name, column in columns(trace).items():
        assert np.array_equal(np.array([float(row[name]) for row in rows]), column.astype(float)), name
    assert len(columns(trace)) == 2 * model.dof + 18
    units = {name.rsplit("_", 1)[-1] for name in columns(trace)}
    assert units == {"s", "rad", "m", "open", "override", "commanded", "measured"}
    turned = [columns(trace)[f"nozzle_q{axis}_measured"] for axis in "xyzw"]
    assert np.allclose(sum(value**2 for value in turned), 1.0)
