import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))


def pytest_addoption(parser):
    parser.addoption("--engine", action="append", default=None, help="run the conformance suite for this engine only")
