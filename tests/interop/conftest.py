"""Foreign clients need their own tools; where a tool is not installed its tests are not collected, and that is said."""

import shutil
from collections.abc import Iterator

import pytest

from tests.conftest import SETTINGS, Plant

TOOLS = {"test_node_opcua.py": ("node", "npm"), "test_milo.py": ("java", "mvn")}
MISSING = {file: [tool for tool in tools if shutil.which(tool) is None] for file, tools in TOOLS.items()}
collect_ignore = [file for file, missing in MISSING.items() if missing]


def pytest_report_header() -> list[str]:
    return [f"interop: {file} needs {' and '.join(missing)}" for file, missing in MISSING.items() if missing]


@pytest.fixture(scope="package")
def foreign_plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """One server for all foreign clients: each brings a skill of its own."""
    plant = Plant(tmp_path_factory.mktemp("plant"), SETTINGS.format(driver="kinematic", realtime="false"))
    plant.set_up()
    plant.start()
    try:
        yield plant
    finally:
        plant.stop()
