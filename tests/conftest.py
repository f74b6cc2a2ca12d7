"""Options and the order of all tests."""

import gc
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


def pytest_addoption(parser):
    parser.addoption("--engine", action="append", default=None, help="run the conformance suite for this engine only")


def pytest_collection_finish(session):
    """Look for garbage seldom, and not among what was imported: a twentieth of the time of those measured."""
    del session
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """A file to a process: side by side, two would compile the same kernels and build the same fixtures."""
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log)
