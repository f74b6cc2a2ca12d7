"""Relative joint coordinates along a spanning tree, loops closed by cut joints: the fastest form of a motion.

The equations are those of `consilience.reference.formulations.recursive` [C4 (4.99)-(4.110), Featherstone 2008]. The
state holds the coordinates of the tree joints instead of all bodies: a tree needs no projection, a loop only one in
these coordinates, and the free directions are eliminated one at a time, without small matrices.

The files in reading order:

====================  =================================================================================
arrays                the state z, the arrays of the kernels, and their common arguments
records               records of links, free directions, joints, rows, forces, groups and series
loop_groups           groups of rows that close loops, in the order of their elimination, and their arrays
kinematics            positions and velocities of links and bodies, outward along the tree
inertia               articulated inertias as tuples
articulated           articulated-body algorithm: inward and outward sweep
loop_rows             joints that close loops; their rows as wrenches on links; their residuals
multifrontal          QR of the whitened responses of the tree to the rows, front by front
few_freedoms          elimination of the rows where few freedoms are left
planar_detection      mechanisms that move in parallel planes
planar                sweeps and responses in a plane
planar_rows           rows and force elements in a plane
either                calls of the kernels of space or of a plane
dynamics              accelerations and state derivative
projection            projection of a state, selection of independent rows
state                 state z of a canonical state
system                a mechanism as integrators see it: derivative, projection, samples
taylor_series         Taylor coefficients of a planar tree
taylor_rows           Taylor coefficients of its loop closures
taylor                stepper of `steppers`: Taylor's method
forward_dynamics      accelerations at one state, many states, many parameter sets
solver                motions of a mechanism, from canonical states to canonical states
parameter_sets        many motions of a mechanism whose numbers change
formulation           the form behind the protocol of all formulations
====================  =================================================================================
"""
