"""One mechanism described in two ways: the descriptions differ, the physics does not."""
