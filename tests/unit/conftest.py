"""Single modules: each does what it says, by expected values that come from elsewhere than the module."""
