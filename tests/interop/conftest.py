"""Foreign clients share one server."""

from collections.abc import Iterator

import pytest

from tests.conftest import SETTINGS, Plant


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
