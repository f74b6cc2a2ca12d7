"""Reports: JSON Lines are the record, every page and table is rendered from it."""
