"""Processes that descend from a test, wherever they have gone: all inherit a variable of its environment."""

import psutil

MARK = "CONSILIENCE_TEST_MARK"


def marked(value):
    """Pids of the living processes with this value of the variable."""
    found = []
    for process in psutil.process_iter():
        try:
            if process.environ().get(MARK) == value and process.status() != "zombie":
                found.append(process.pid)
        except psutil.Error:
            continue
    return found
