"""Errors inside the adapter of Exudyn, the engine in redundant coordinates."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from consilience.audit.mutate.mutated import Planting
from consilience.audit.mutate.seams import inside, module, replaced, wrapped
from consilience.mechanism import skew


def _about_the_centre(original: Any, magnitude: float, body: Any) -> Any:
    right = original(body)
    return right + magnitude * (body.inertia - right)


def _order(original: Any, magnitude: float, inertia: Any) -> Any:
    xx, yy, zz, yz, xz, xy = original(inertia)
    return [xx, yy, zz, yz + magnitude * (xy - yz), xz, xy + magnitude * (yz - xy)]


def _tree_about_origin(original: Any, magnitude: float, mechanism: Any) -> Any:
    tree = original(mechanism)
    links = []
    for link in tree.links:
        S = skew(link.com)
        links.append(replace(link, inertia=link.inertia - magnitude * link.mass * S @ S))
    return replace(tree, links=tuple(links))


inertia_about_centre = inside(("maximal", "inertia_about_origin", wrapped(_about_the_centre)))
products_order = inside(("maximal", "inertia_vector", wrapped(_order)))
tree_inertia_about_origin = inside(("kinematic_tree", "lower", wrapped(_tree_about_origin)))


@contextmanager
def redundant_rows(engine: Any, magnitude: float) -> Any:
    """Every row of every joint, dependent or not; all or nothing."""
    del magnitude
    full = module(engine, "maximal").full_axes
    with replaced(module(engine, "engine"), "independent_axes", lambda _: full):
        yield engine


def _settings(change: Callable[[Any, float], None]) -> Planting:
    """Change the ``timeIntegration`` of the settings that a trajectory runs with."""

    def make(original: Any, magnitude: float) -> Any:
        """The function to put in place of the adapter's ``simulation_settings``."""

        def simulation_settings(changed: Any) -> Any:
            settings = original(changed)
            change(settings.timeIntegration, magnitude)
            return settings

        return simulation_settings

    return inside(("trajectory", "simulation_settings", make))


def _newton(integration: Any, magnitude: float) -> None:
    integration.newton.relativeTolerance = magnitude
    integration.newton.absoluteTolerance = magnitude


def _adaptive(integration: Any, magnitude: float) -> None:
    del magnitude
    integration.adaptiveStep = True


def _radius(integration: Any, magnitude: float) -> None:
    integration.generalizedAlpha.spectralRadius = 1.0 - magnitude


def _initial(integration: Any, magnitude: float) -> None:
    del magnitude
    integration.generalizedAlpha.computeInitialAccelerations = False


newton_loose = _settings(_newton)
adaptive_step = _settings(_adaptive)
spectral_radius = _settings(_radius)
initial_accelerations = _settings(_initial)


def _default_steps(original: Any, magnitude: float, system: Any, integration: Any, times: Any, step: float) -> Any:
    """Hundred steps for the whole run, whatever step was asked."""
    del magnitude, step
    return original(system, integration, times, (times[-1] - times[0]) / 100.0)


steps_of_default = inside(("trajectory", "solve", wrapped(_default_steps)))
