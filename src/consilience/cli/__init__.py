"""The command line ``consilience``."""
