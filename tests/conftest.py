"""Options of all tests, the order in which files are tested, and kernels that are compiled before processes start."""

import gc
import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

# some hundred processes import the package: without bytecode files each would compile every module
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

LONGEST = (
    "harness/test_faults.py",
    "harness/test_store.py",
    "harness/test_cluster.py",
    "harness/test_fuzz.py",
    "harness/test_mutate.py",
    "harness/test_pytest_plugin.py",
    "conformance/test_engines.py",
    "oracles/test_reference_bars.py",
    "oracles/test_case_values.py",
    "conformance/test_shipped_cases.py",
    "harness/test_workers.py",
    "harness/test_environments.py",
    "conformance/test_library.py",
    "unit/test_documentation.py",
    "unit/test_cli.py",
)
"""Files that take longest, in this order: they start first, so that no process is left with one at the end."""


def pytest_addoption(parser):
    parser.addoption("--engine", action="append", default=None, help="run the conformance suite for this engine only")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config, specs):
    """Compile kernels before the processes of a whole run start, which would each compile the same ones."""
    whole = config.args_source is config.ArgsSource.TESTPATHS and not config.option.keyword
    if whole and len(specs) > 1 and not config.option.collectonly:
        from kernels import compile_apart

        compile_apart()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """In processes side by side, test the longest files first."""
    if hasattr(config, "workerinput"):
        rank = {name: n for n, name in enumerate(LONGEST)}
        items.sort(key=lambda item: rank.get("/".join(item.path.parts[-2:]), len(rank)))


def pytest_collection_finish(session):
    """Collect garbage seldom, and not among what was imported: a twentieth of the time of the tests."""
    del session
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Give whole files to processes: two processes with one file would build the same fixtures."""
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False  # the order is that of `LONGEST`
    return LoadFileScheduling(config, log)
