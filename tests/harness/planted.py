"""The command `consilience` with a fault planted in it: ``python tests/harness/planted.py FAULT run ...``.

Campaigns that start the command as a process of its own are given this one, to show that they can fail.
"""

import os
import sys
import threading

from consilience.cli.main import main
from consilience.suite import Store


def forgets():
    """Delete all answers whenever a store is opened."""
    opened = Store.__init__

    def emptied(self, folder, fresh=False):
        del fresh
        opened(self, folder, True)

    Store.__init__ = emptied


def asks_again():
    """Find no answer in the store."""
    Store.find = lambda self, key: None


def ends_early():
    """End the process at its first answer, so that nothing is left to kill."""
    keep = Store.keep

    def last(self, key, stored):
        keep(self, key, stored)
        threading.Timer(0.0, os._exit, (0,)).start()

    Store.keep = last


FAULTS = {"forgets": forgets, "asks_again": asks_again, "ends_early": ends_early}

if __name__ == "__main__":
    FAULTS[sys.argv.pop(1)]()
    main()
