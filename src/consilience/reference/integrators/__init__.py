"""Integrators for all formulations, from Python; the compiled integrators share coefficients and step control.

Reading order: `coefficients` and `tsitouras` (explicit pairs), `tableaus` (all methods and their single steps), `dense`
(dense output), `step_control` (compiled), `adaptive` (the integration). `dae` methods belong to `formulations`.
"""
