"""The harness against engines that crash, hang, lie or flood, and against suites that are killed.

The miniature engines of `plugins` are installed only while these tests run. They are found as those of third parties: a
folder on the path with a ``.dist-info`` that names entry points.
"""

import sys
from pathlib import Path

import pytest

FOLDER = "CONSILIENCE_TEST_ANSWERS"
"""Environment variable that the engine ``honest`` reads: its module can be imported only while it is installed."""

PLUGINS = str(Path(__file__).parent / "plugins")


@pytest.fixture(scope="package", autouse=True)
def _plugins_installed():
    sys.path.insert(0, PLUGINS)
    yield
    sys.path.remove(PLUGINS)


@pytest.fixture(scope="session")
def _answers(tmp_path_factory):
    return tmp_path_factory.mktemp("answers")


@pytest.fixture(scope="module")
def answers_kept(_answers):
    """Let the engine ``honest``, and all that descend from it, compute each answer once for all processes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER, str(_answers))
        yield
