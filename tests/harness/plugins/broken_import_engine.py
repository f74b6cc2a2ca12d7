"""An adapter whose engine is not there."""

raise ImportError("libengine.so.3: cannot open shared object file")
