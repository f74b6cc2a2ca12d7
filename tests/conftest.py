"""Options and the order of all tests."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


def pytest_addoption(parser):
    parser.addoption("--engine", action="append", default=None, help="run the conformance suite for this engine only")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """A file to a process: side by side, two would compile the same kernels and build the same fixtures."""
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log)
