"""What a methods section says: sentences of the alignment and of tools, with their references.

* ``paragraph``: of a result, and of what was made of it
* ``of_tools``: of the tools that read it, by the options of their records
* ``references``: the papers that are cited, and how collalign is
"""
