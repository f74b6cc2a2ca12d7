"""Synthetic records of comparisons, runs and cases, as they stand in `report.jsonl`."""

from consilience.compare import Verdict
from consilience.report.record import Record
from consilience.report.recordschema import FORMAT

ENGINES = ("alpha", "beta_1")
LONG = "name_with & 50 % of #specials$ ^~{}\\"


def quantity(name, difference, bar, count=6):
    return {"name": name, "difference": difference, "bar": bar, "count": count, "remark": ""}


def level(step, difference, energy=(0.0, 1e-9, -2e-9)):
    return {
        "step": step,
        "cpu": 1.0 / step,
        "largest": max(difference),
        "rms": 0.1,
        "difference": list(difference),
        "energy": list(energy),
        "residual": 1e-12,
        "counters": {"steps": round(2.0 / step)},
    }


def comparison(case, engine, question, verdict=Verdict.AGREES, **more):
    """Record of a comparison. A motion has two levels; the finer is off by 1e-6 before the horizon and 0.5 after it."""
    moving = question == "trajectory" and verdict not in (Verdict.FAILED, Verdict.UNSUPPORTED)
    plain = {
        "record": "comparison",
        "case": case,
        "engine": engine,
        "question": question,
        "method": "RK4" if question == "trajectory" else "solve",
        "route": "native",
        "verdict": str(verdict),
        "why": f"because of {question}",
        "rule": "",
        "profile": "matched",
        "digits": 6.0 if moving else 12.5,
        "limit_digits": None,
        "declared_order": 4 if moving else None,
        "order": 3.98 if moving else None,
        "self_order": None,
        "band": 1e-6 if moving else None,
        "reference_spread": 1e-13 if moving else None,
        "horizon": None,
        "softness": None,
        "observables": [],
        "growth": [],
        "quantities": [] if moving else [quantity("accelerations", 3e-13, 1e-11), quantity("reactions", 2e-13, 1e-12)],
        "times": [0.0, 1.0, 2.0] if moving else [],
        "coarser": [],
        "power": [{"kind": "gravity", "of": "gravity", "limit": 2e-5}] if moving else [],
        "levels": [level(0.02, (0.0, 1e-5, 1e-4)), level(0.01, (0.0, 1e-6, 0.5))] if moving else [],
    }
    return plain | more


def run_of(c, log=""):
    settings = {"iterations": 9}
    method = {"name": c["method"], "route": c["route"], "order": 4, "substeps": [1, 2], "tolerances": []}
    method |= {"settings": settings, "profile": c["profile"], "softness": None}
    status = {Verdict.FAILED: "failed", Verdict.UNSUPPORTED: "unsupported"}.get(c["verdict"], "answered")
    return {
        "record": "run",
        **{name: c[name] for name in ("case", "engine", "question")},
        "method": method,
        "level": 0,
        "step": 0.01,
        "status": status,
        "answer": None,
        "reason": c["why"] if status != "answered" else "",
        "manifest": None,
        "cpu": 0.25,
        "log": log,
    }


def case_of(name, *sources):
    return {
        "record": "case",
        "name": name,
        "title": f"Case {name}",
        "bodies": ["bob"],
        "joints": [["pin", "revolute", "ground", "bob"]],
        "rows": 5,
        "duration": 2.0,
        "sample": 1.0,
        "digits": 8,
        "instants": 3,
        "undetermined": {},
        "sources": list(sources),
        "remarks": "",
        "tags": ["tour"],
    }


def record_of(comparisons, missing=None, engines=ENGINES, code=1):
    cases = dict.fromkeys(c["case"] for c in comparisons)
    names = ("reference", *engines)
    header = {
        "record": "header",
        "format": FORMAT,
        "written": "2030-01-02T03:04:05+00:00",
        "elapsed": 1.0,
        "platform": "Linux",
        "processor": "p",
        "python": "3.11",
        "packages": {"consilience": "0.1.0", "numpy": "2.0"},
        "engines": {n: {"name": n, "version": "1.2.3", "adapter": "0.4", "remarks": ""} for n in names},
        "missing": missing or {},
        "questions": ["model", "instant", "trajectory"],
    }
    runs = [run_of(c, "core \x1b[31mdumped\x00" if c["verdict"] == Verdict.FAILED else "") for c in comparisons]
    footer = {"cases": len(cases), "runs": len(runs), "comparisons": len(comparisons), "exit_code": code}
    return Record.annotated(
        header, [case_of(name, f"source of {name}") for name in cases], runs, list(comparisons), footer
    )
