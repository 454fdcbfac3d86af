"""Aligns a collection of 3D shapes consistently, and says how far each pose can be trusted.

>>> import collalign
>>> collection = collalign.align_collection("bones")
>>> written = collection.save("aligned")

``help(collalign.align_collection)`` says what may stand for the folder.
"""

import lazy_loader

# The names of the stub, each imported when it is first asked for: a worker process that needs one module of the
# package starts in a fifth of the time.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
