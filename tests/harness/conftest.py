"""The harness against engines that crash, hang, lie or flood, and against suites that are killed.

The miniature engines of `plugins` are installed only while these tests run. They are found as those of third parties: a
folder on the path with a ``.dist-info`` that names entry points.
"""

import sys
from pathlib import Path

import pytest

PLUGINS = str(Path(__file__).parent / "plugins")


@pytest.fixture(scope="package", autouse=True)
def _plugins_installed():
    sys.path.insert(0, PLUGINS)
    yield
    sys.path.remove(PLUGINS)
