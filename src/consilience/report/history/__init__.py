"""What has changed from one report to the next, verdict by verdict: `consilience diff` and `consilience trend`."""
