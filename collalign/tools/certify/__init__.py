"""What is proven about all arrangements of a result's shapes.

* ``run``: the entry
* ``result``: what is proven
* ``rounds``: how
* ``command``: prints and writes
"""
