"""The slow, obvious twin of every operation: it defines the results that the kernels must equal.

NumPy, Python integers and `fractions.Fraction` only.  Each result is worked out from its
definition, not with the formulas of the kernels, so that the two do not share a mistake.
"""
