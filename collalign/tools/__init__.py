"""What reads a finished result, or two shapes: one folder a tool with its ``run``, and its ``command``, which prints.

* ``match``: two shapes
* ``export``: formats of the field
* ``certify``: no arrangement of all shapes is cheaper
* ``stability``: which poses stay
* ``transfer``: landmarks
* ``variation``: how the surfaces vary
* ``correspond``: lays one triangulation onto all shapes

A tool imports results and libraries, never a stage or another tool, but those of :data:`SHARED`. A new one is a
folder with its command's line in :data:`TOOLS`.

Word: ``DenseCorrespondence`` is of a mean surface with all shapes; elsewhere *dense* is of more points than the
samples.
"""

#: Each tool's command, as a module below this folder and a function, and its line in the help.
TOOLS = {
    "match": (
        "match.command:match",
        "Match two shapes: the best pose and its alternatives, or a map.",
    ),
    "export": ("export.command:export", "Write a result in a format of the field."),
    "certify": (
        "certify.command:certify",
        "Prove how much cheaper any other arrangement could be, or check proofs.",
    ),
    "stability": (
        "stability.command:stability",
        "Repeat an alignment otherwise and say which poses stay.",
    ),
    "transfer": ("transfer.command:transfer", "Carry landmarks of a few specimens to all others."),
    "variation": (
        "variation.command:variation",
        "Show how the surfaces vary: components, groups, classes, specimens.",
    ),
}
#: Tools that other tools build on: surfaces in dense correspondence, and the formats of the field.
SHARED = ("correspond", "export")
