"""The reference solver against known answers: closed forms, published values, independent integrations.

Oracles are modules of this folder; none of them imports dynamics of the package.
"""
