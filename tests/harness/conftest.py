"""The harness against engines that crash, hang, lie or flood, and against suites that are killed.

The miniature engines of `plugins` are installed only while these tests run. They are found as those of third parties: a
folder on the path with a ``.dist-info`` that names entry points.
"""

import os
import sys
from pathlib import Path

import pytest

FOLDER = "CONSILIENCE_TEST_ANSWERS"
"""Environment variable that `kept_answers` reads, which can be imported only while the plugins are installed."""

PLUGINS, KEPT = (str(Path(__file__).parent / name) for name in ("plugins", "kept"))


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
    """Let the reference, the engine ``honest`` and all that descend from it compute each answer once for all processes.

    The entry point in `KEPT` takes the place of the reference's own, because that folder is the last of the path.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path, KEPT])
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        patch.setenv(FOLDER, str(_answers))
        yield
