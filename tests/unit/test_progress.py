"""Live progress: a line for each engine, with finished work and remaining time."""

import io

from rich.console import Console

from consilience.cli.terminal import progress_per_engine


def test_each_engine_has_a_line_of_its_own_with_the_time_left():
    text = io.StringIO()
    with progress_per_engine(["reference", "mine"], 4, Console(file=text, width=120)) as advance:
        for case in ("one", "two", "three", "four"):
            advance("reference", case)
        advance("mine", "one")
    lines = [line for line in text.getvalue().splitlines() if line.strip()]
    assert [line.split()[0] for line in lines] == ["reference", "mine"]
    assert "4/4" in lines[0]
    assert "four" in lines[0]
    assert "1/4" in lines[1]
    assert all(" left " in line for line in lines)
