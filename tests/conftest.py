"""Command-line options of the tests, order of test files, and compilation of kernels before worker processes start."""

import gc
import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

# Some hundred processes import the package: without bytecode files each process would compile every module.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# as the command line does: threads of BLAS compete with the workers of pytest, and change last digits
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

LONGEST = (
    "harness/test_mutate.py",
    "oracles/test_case_values.py",
    "harness/test_planted_faults.py",
    "harness/test_cluster.py",
    "harness/test_workers.py",
    "conformance/test_library.py",
    "harness/test_fuzz.py",
    "unit/test_notebooks.py",
    "harness/test_faults.py",
    "harness/test_hostile.py",
    "unit/test_kernel_formulations.py",
    "harness/test_pytest_plugin.py",
    "harness/test_published_versions.py",
    "conformance/test_engines.py",
    "harness/test_identities.py",
    "unit/test_documentation.py",
    "unit/test_casefile.py",
    "harness/test_environments.py",
    "twins/test_units.py",
    "harness/test_mutants.py",
    "unit/test_dae.py",
    "conformance/test_shipped_cases.py",
    "unit/test_cli.py",
)
"""Files that take longest, in this order: they start first, so that no process is left with one at the end."""


def pytest_addoption(parser):
    parser.addoption("--engine", action="append", default=None, help="run the conformance suite for this engine only")
    parser.addoption("--slow", action="store_true", help="run the tests marked slow, too, when all tests are run")


def _whole(config):
    """Whether all tests are asked for."""
    return config.args_source is config.ArgsSource.TESTPATHS and not config.option.keyword


def pytest_configure(config):
    """Leave out slow tests of a whole run, in worker processes, too."""
    if _whole(config) and not (config.option.slow or config.option.markexpr):
        config.option.markexpr = "not slow"


@pytest.hookimpl(optionalhook=True, wrapper=True)
def pytest_xdist_auto_num_workers(config):
    """Start one process more than there are processors: tests of the harness often wait for other processes."""
    count = yield
    return count if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ else count + 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config, specs):
    """Compile kernels before the worker processes of a whole run start; otherwise each process would compile them."""
    if _whole(config) and len(specs) > 1 and not config.option.collectonly:
        from kernels import compile_apart

        compile_apart()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """With several worker processes, start with the slowest files."""
    if hasattr(config, "workerinput"):
        rank = {name: n for n, name in enumerate(LONGEST)}
        items.sort(key=lambda item: rank.get("/".join(item.path.parts[-2:]), len(rank)))


def pytest_collection_finish(session):
    """Freeze imported objects and collect garbage rarely: frequent collections of many objects slow the tests."""
    del session
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Give whole files to processes: two processes with the same file would both build its fixtures."""
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False  # keep the order of `LONGEST`
    return LoadFileScheduling(config, log)
