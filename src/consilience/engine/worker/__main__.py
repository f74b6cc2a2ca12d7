"""Run a worker, or repeat one job in this process: ``python -m consilience.engine.worker``.

The arguments are ``CHANNEL LIFELINE``, two descriptors from the runner, or ``FILE``, the frames of a failed job.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from consilience.engine.worker.server import replay, serve
from consilience.engine.worker.wire import ProtocolError

if len(sys.argv) == 3:
    try:
        serve(int(sys.argv[1]), int(sys.argv[2]))
    except ProtocolError as error:
        os.write(2, f"the runner sent what no worker understands: {error}\n".encode(errors="replace"))
        os._exit(1)
    os._exit(0)  # no destructor of a native library may hang or crash now
sys.stdout.write(replay(Path(sys.argv[1]).read_bytes()) + "\n")
