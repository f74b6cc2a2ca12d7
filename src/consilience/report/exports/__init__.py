"""What other programs and papers read of a run: JUnit XML, CSV, JSON, LaTeX, BibTeX, badges and plots."""
