"""How far each pose can be trusted, from evidence that the answer did not make.

* ``assess``: all evidence, and the confidence
* ``blocks``: shapes that one wrong rotation keeps together
* ``rival_poses``: of pairs, and of near symmetries
* ``trust_notes``: what the user is told

Words; each kind of evidence is described at ``Trust`` in ``collalign/products/trust.py``:

* **rival**: a competing pose of a shape, which its pairs or near symmetries propose.
* **vote**: a pair whose most plausible candidate asks for the pose.
* **margin**: how much more the cheapest rival costs on dense points.
* **lead**: how much more plausible than its strongest rival the pairs find the pose.
* **misfit**: how much more the pose costs than those of the other shapes.
"""
