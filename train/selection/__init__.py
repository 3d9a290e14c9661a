"""Which sensors the encoder listens to: the paper's SHAP ranking and what it is measured against.

`methods.select` is the one door; every method has a file of its own.
"""
