"""Procrustes matching of two point sets: relaxations, certificates, search, refinement. Arrays in, results out."""

import lazy_loader

# The names of the stub, each imported when it is first asked for: options alone are there in a third of the time.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
