"""Unit tests: one module each, against expected values that do not come from that module."""
