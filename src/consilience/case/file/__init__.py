"""Case files: schema, reader and writer of the TOML a mechanism is drawn in."""
