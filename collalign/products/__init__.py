"""What the stages hand to each other and to the user: frozen data, which compute nothing but what they hold.

* ``pair``: ``Pair``, ``AlignedPair`` of a result, ``Alternative``
* ``shapes``: ``Shapes``, ``Constraints``, incomplete and excluded ones
* ``own``: what a caller knows
* ``named_frame``: up and front, and the rotation to them
* ``trust``: evidence of poses
* ``consistent_maps``: labels of samples, and maps of all vertices
* ``kinds``: which shapes are of one kind
* ``run_record``: how a run went

Words:

* **alternative**: another pose of a shape; of a pair it is a *candidate*.
* **maps**: which point, or function, of one surface belongs to which of another. A ``dict`` is a mapping.
* **label**: a point's number common to all shapes.
* **fixed**: a pose that is given and stays, by hand or from the run before an ``add``.
"""
