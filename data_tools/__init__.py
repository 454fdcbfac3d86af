"""Shapes: what they are, and how they are read, cleaned, sampled and embedded; generated collections.

* ``io``: files to shapes and back
* ``surface``: what a surface is
* ``embedding``: what is matched of a shape
* ``datasets``: generated collections with their exact answers
* ``local_surface``, ``sight``: a surface at the spacing of one cell, with the descriptors of its neighbourhoods; from
  which direction it was seen
* ``partial_surface``: a surface as points with normals and its rim, and a grid of nearest points
* ``landmark_files``, ``landmark_tables``, ``point_tables``: files of landmarks of one shape; of several, and those
  beside shapes; tables without a format of their own
* ``names``: names as somebody wrote them, and the shapes that are meant: labels, landmarks, decisions and options use
  it
* ``arrays``, ``checks``: validators of arrays; checks of options, and what misspelt options may mean
* ``errors``, ``notes``: all errors, with exit codes; notes as codes with fields, and shares and lists in words
* ``options``: options of cleaning, sampling and embedding
* ``poses``, ``rotations``: similarities, and which poses are the same; rotations and angles
* ``threads``: one BLAS thread, inside every public function that computes
* ``html_pages``: pages, tables and figures that need nothing else
"""
