"""One broker for all tests of a module, because starting it takes longer than most of the tests."""

from collections.abc import Iterator

import pytest

from tests.mqtt_broker import Broker, require_packages


@pytest.fixture(scope="module")
def broker() -> Iterator[Broker]:
    require_packages()
    opened = Broker()
    yield opened
    opened.close()
