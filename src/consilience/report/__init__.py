"""Reports: a record as JSON Lines, from which every page and table is rendered."""
