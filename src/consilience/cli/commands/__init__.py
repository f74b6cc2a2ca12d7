"""Commands that parse their own arguments, one module each, imported when they are called."""
