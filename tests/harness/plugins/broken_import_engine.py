"""An adapter whose engine cannot be imported."""

raise ImportError("libengine.so.3: cannot open shared object file")
