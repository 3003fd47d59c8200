"""A trace in a file is the trace: bit for bit in CSV and in Parquet, with what it was measured on."""

import csv
import io

import numpy as np
import pyarrow.parquet
from scripted_arm import trace

from opcua_skill.jobs.worker_tasks import write_trace
from sim.traces import columns, to_csv, to_parquet


def test_csv_and_parquet_hold_the_same_bits() -> None:
    told = trace(50, off=1e-4 / 3)
    expected = columns(told)
    table = pyarrow.parquet.read_table(io.BytesIO(to_parquet(told)))
    rows = [line for line in to_csv(told).splitlines() if not line.startswith("#")]
    read = list(csv.DictReader(rows))
    assert table.column_names == list(expected) == list(read[0])
    for name, values in expected.items():
        assert np.array_equal(table[name].to_numpy(), values)
        assert np.array_equal(np.array([float(row[name]) for row in read]), values)
    assert table.schema.metadata[b"source"] == told.source.encode()


def test_files_appear_whole_under_the_name_of_the_job(tmp_path) -> None:  # type: ignore[no-untyped-def]
    write_trace(trace(5), tmp_path / "traces", "run-1", ("csv", "parquet"))
    assert sorted(file.name for file in (tmp_path / "traces").iterdir()) == ["run-1.csv", "run-1.parquet"]
