"""Run scripts without our code: each in a process of its own, forked where the engines are already imported.

To import an engine takes longer than most scripts.
"""

from __future__ import annotations

import atexit
import functools
import json
import subprocess
import sys
from pathlib import Path

SERVER = """
import contextlib, importlib, io, json, os, re, runpy, signal, sys, traceback, warnings
sys.modules["consilience"] = None
for line in sys.stdin:
    path, folder, limit = json.loads(line)
    for name in re.findall(r"^import ([\\w.]+)", open(path).read(), re.MULTILINE):
        importlib.import_module(name)
    with warnings.catch_warnings(action="ignore"):
        child = os.fork()
    if child:
        status = os.waitpid(child, 0)[1]
        if status:
            print(json.dumps(["", f"it died: status {status}"]), flush=True)
        continue
    os.chdir(folder)
    signal.alarm(limit)
    told, error = io.StringIO(), ""
    try:
        with contextlib.redirect_stdout(told):
            runpy.run_path(path, run_name="__main__")
    except BaseException as ended:
        if not (isinstance(ended, SystemExit) and not ended.code):
            error = traceback.format_exc()
    print(json.dumps([told.getvalue(), error]), flush=True)
    os._exit(0)
"""


@functools.cache
def _server(options: tuple[str, ...]) -> subprocess.Popen[str]:
    command = [sys.executable, *options, "-c", SERVER]
    started = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(started.communicate)
    return started


def run_alone(script: Path, *options: str, folder: Path | None = None, limit: int = 300) -> str:
    """Return what a script prints from Python; it works in a folder, its own if none is given.

    Parameters
    ----------
    script : Path
    *options : str
        Options of the interpreter.
    folder : Path, optional
    limit : int, s

    Raises
    ------
    AssertionError
        With the traceback of the script, or how it died.
    """
    process = _server(options)
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps([str(script), str(folder or script.parent), limit]) + "\n")
    process.stdin.flush()
    told, error = json.loads(process.stdout.readline())
    assert not error, f"{told[-2000:]}\n{error[-2000:]}"
    return str(told)
