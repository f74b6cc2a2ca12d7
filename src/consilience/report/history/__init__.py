"""Changes from one report to the next, verdict by verdict: `consilience diff` and `consilience trend`."""
