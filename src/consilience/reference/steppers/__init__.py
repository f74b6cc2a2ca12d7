"""Compiled integrators: one driver, and steppers as its plug-ins.

==========  ======================================================================================
motion      what every integrator needs of a motion: state, run, kernels of the mechanism, scales
driver      the loop over steps and samples, the same for all steppers
explicit    explicit Runge-Kutta pairs of order 8
radau13     Radau IIA of seven stages, for stiff motions
gauss       collocation at Gauss points, independent of the others
==========  ======================================================================================

A stepper is a module with a `driver.CompiledStepper`: work arrays and a kernel with four requests. Kernels of steppers
and of mechanisms do not name each other: they call each other by address (`kernel.operation`).
"""
