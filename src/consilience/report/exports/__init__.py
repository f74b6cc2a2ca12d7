"""Exports of a run for other programs and for papers: JUnit XML, CSV, JSON, LaTeX, BibTeX, badges and plots."""
