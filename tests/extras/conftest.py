"""Tests of an extra with real processes: in its folder `integration`, with the fixtures of the core."""

from tests.integration.conftest import (  # noqa: F401
    launcher,
    peer,
    pytest_collection_modifyitems,
    refused,
    ros_environment,
    wait_until_fixture,
)
