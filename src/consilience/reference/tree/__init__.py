"""Minimal form in relative joint coordinates along a spanning tree, with cut joints: the fast way to a motion.

The equations are those of `consilience.reference.formulations.recursive` [C4 (4.99)-(4.110), Featherstone 2008], but
the state is that of the joints of the tree and not that of all bodies, so that a tree needs no projection and a loop
only one in its own coordinates; and one direction is eliminated after the other, without small matrices.
"""
