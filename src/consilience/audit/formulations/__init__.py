"""Cross-checks: every formulation of the reference against every other on random mechanisms and shipped cases."""
