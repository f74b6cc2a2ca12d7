"""Cross-checks of all formulations of the reference on random mechanisms and shipped cases."""
