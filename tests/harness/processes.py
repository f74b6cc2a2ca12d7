"""Find the processes that descend from a test, daemons included: all inherit an environment variable."""

import psutil

MARK = "CONSILIENCE_TEST_MARK"


def marked(value):
    """PIDs of the living processes with this value of the variable."""
    found = []
    for process in psutil.process_iter():
        try:
            if process.environ().get(MARK) == value and process.status() != "zombie":
                found.append(process.pid)
        except psutil.Error:
            continue
    return found
