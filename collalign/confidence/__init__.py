"""Every fitted model of what is right: a table of weights with its data, its figures and the command that fits it.

A model takes evidence and returns a judgement; what gathers the evidence lies elsewhere. ``python -m experiments
calibrate`` fits or tries all of them again.
"""
