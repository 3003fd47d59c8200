"""Traces as files: one row a time step, one column a quantity, with its unit in the name."""

import csv
import io

import numpy as np

from sim.arm import Trace


def columns(trace: Trace) -> dict[str, np.ndarray]:
    """Return the trace by column name, in the order of the file: SI units, the unit in the name.

    The nozzle's quaternions in the base frame have no unit: ``nozzle_qx_commanded`` and so on.
    """
    table: dict[str, np.ndarray] = {"time_s": trace.times, "path_time_s": trace.path_times}
    for k in range(trace.joints_commanded.shape[1]):
        table[f"joint{k + 1}_commanded_rad"] = trace.joints_commanded[:, k]
        table[f"joint{k + 1}_measured_rad"] = trace.joints_measured[:, k]
    for k, axis in enumerate("xyz"):
        table[f"nozzle_{axis}_commanded_m"] = trace.tool_commanded[:, k]
        table[f"nozzle_{axis}_measured_m"] = trace.tool_measured[:, k]
    if len(trace.orientation_commanded):
        for k, part in enumerate(("qx", "qy", "qz", "qw")):
            table[f"nozzle_{part}_commanded"] = trace.orientation_commanded[:, k]
            table[f"nozzle_{part}_measured"] = trace.orientation_measured[:, k]
    return table | {"valve_open": trace.dispense.astype(int), "override": trace.override}


def to_parquet(trace: Trace) -> bytes:
    """Return the trace as a Parquet file: the columns of the CSV, with source and events in the file's metadata."""
    import pyarrow  # by who writes a file alone
    from pyarrow import parquet

    table = pyarrow.table(columns(trace))
    events = "\n".join(f"{at:.3f} s: {text}" for at, text in trace.events)
    out = io.BytesIO()
    parquet.write_table(table.replace_schema_metadata({"source": trace.source, "events": events}), out)
    return out.getvalue()


def to_csv(trace: Trace) -> str:
    """Return the trace as CSV.

    Its numbers read back are bit for bit the same. Comment lines say what it was measured on.
    """
    out = io.StringIO()
    out.write(f"# source: {trace.source}\n")
    for at, text in trace.events:
        out.write(f"# at {at:.3f} s: {text}\n")
    table = columns(trace)
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    return out.getvalue()
