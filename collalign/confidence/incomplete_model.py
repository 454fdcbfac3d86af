"""From how much of the shapes like it lies beyond its rim to whether a shape is incomplete."""

#: A shape is incomplete if so much of the surfaces of those that match it best lies beyond its rim. In one draw of 20
#: molars with a quarter cut off six of them, these have .12 to .19, the others at most .05; ``python -m experiments
#: calibrate incomplete`` tries others on molars, skulls, chairs and fish.
MISSING_SHARE = 0.085
#: Beyond the rim is what is nearest to a point of it, and farther than this, in radii of the other shape.
BEYOND = 0.2
