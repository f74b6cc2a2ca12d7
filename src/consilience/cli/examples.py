"""Examples at the end of the help of every command, each parsed by a test. Names in capitals stand for others."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[tuple[str, str], ...]] = {
    "run": (
        ("consilience run --tag tour -o report", "seven cases, all engines"),
        ("consilience run double_pendulum my_case.toml -e ENGINE -e OTHER", "two cases, two engines"),
        ("consilience run --quick -q model -q instant", "the whole library, no motions"),
        ("consilience run double_pendulum -e ENGINE@OLD -e ENGINE@NEW", "two versions of one engine"),
    ),
    "list": (
        ("consilience list", "cases, families and engines"),
        ("consilience list spring --tag lumpy", "cases with a word and a tag"),
        ("consilience list -f json", "the same for a script"),
    ),
    "doctor": (("consilience doctor", "this machine and all engines"), ("consilience doctor -e ENGINE", "one of them")),
    "explain": (
        ("consilience explain regularisation", "a verdict"),
        ("consilience explain horizon", "a term"),
        ("consilience explain 12", "a trap, by its number"),
        ("consilience explain", "everything there is"),
    ),
    "simulate": (
        ("consilience simulate four_bar", "the reference, as four_bar.json"),
        ("consilience simulate four_bar -e ENGINE --duration 1 -o motion.csv", "an engine, as a table"),
    ),
    "coverage": (("consilience coverage double_pendulum -e ENGINE", "whether the bands of one engine hold"),),
    "crosscheck": (("consilience crosscheck --mechanisms 20 --states 5", "a short campaign"),),
    "report": (("consilience report report", "write the pages of a folder again"),),
    "schema": (("consilience schema case", "JSON Schema of a case file, for an editor"),),
    "show": (
        ("consilience show four_bar", "freedom, dependent rows, open reactions, sources"),
        ("consilience show four_bar --picture four_bar.png", "and a drawing, as .svg or .png"),
        ("consilience show four_bar --view", "and the mechanism in motion, in the browser"),
    ),
    "play": (("consilience play report", "the mechanisms of a report in motion, engines as ghosts"),),
    "new": (
        ("consilience new arm", "arm.toml, with every element as a comment"),
        ("consilience new rods --from parallel_rods:rods=6", "from a family"),
    ),
    "validate": (("consilience validate arm.toml -e ENGINE", "what is wrong, and what the engine will make of it"),),
    "check": (
        ("consilience check -e ENGINE", "all cases"),
        ("consilience check four_bar -e ENGINE -o found.json", "one, every residual"),
    ),
    "fuzz": (("consilience fuzz -n 20 --seed 7 -e ENGINE", "twenty random mechanisms"),),
    "values": (("consilience values double_pendulum", "expected values beside ours"),),
    "diff": (
        ("consilience diff before after", "what has changed; exit code 1 if anything is worse"),
        ("consilience diff both both --as ENGINE@OLD=ENGINE@NEW", "two versions in one report"),
    ),
    "trend": (("consilience trend nightly", "all reports of a folder"),),
    "bisect": (
        ("consilience bisect four_bar -e ENGINE@3.3..4.0", "the first bad release"),
        ("consilience bisect four_bar -e ENGINE@3.3..4.0 -q instant -o versions", "one question; reports are kept"),
    ),
    "site": (
        ("consilience site nightly -o site", "all reports of a folder"),
        ("consilience site before after -o site --edition 2026", "two reports, scored over an edition"),
    ),
    "export": (
        ("consilience export report -f junit -o junit.xml", "for CI"),
        ("consilience export report -f latex -o table.tex", "for a paper"),
    ),
    "plot": (("consilience plot report four_bar --what convergence -o convergence.pdf", "a figure"),),
    "import": (("consilience import robot.urdf -o robot.toml", "a case from a robot"),),
    "translate": (("consilience translate four_bar -e ENGINE -o native", "the native model and its manifest"),),
    "mutate": (
        ("consilience mutate 3 --short", "one trap"),
        ("consilience mutate -e ENGINE", "all, in one engine"),
        ("consilience mutate --power CASE", "stated power"),
    ),
}
"""Calls and their effects, by command."""

START = (
    ("consilience doctor", "is everything there?"),
    ("consilience run double_pendulum four_bar --quick -o first", "a first report"),
    ("consilience explain regularisation", "what does the verdict mean?"),
)
"""Examples at the end of the help of the program."""


def epilog(examples: tuple[tuple[str, str], ...]) -> str:
    """Write examples as the text below a help; Typer wants a paragraph for each line."""
    return "\n\n".join(["Examples:", *(f"{call}   # {what}" for call, what in examples)])
