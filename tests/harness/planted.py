"""The command `consilience` with a fault planted in it: ``python tests/harness/planted.py FAULT run ...``.

Campaigns that start the command as a process of its own are given this one, to show that they can fail.
"""

import sys

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


FAULTS = {"forgets": forgets, "asks_again": asks_again}

if __name__ == "__main__":
    FAULTS[sys.argv.pop(1)]()
    main()
