"""Case files: schema, reader and writer of TOML drawings of mechanisms."""
