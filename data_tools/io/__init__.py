"""Files to shapes, and back.

* ``listing``: which files are shapes, their names and digests; :data:`~data_tools.io.listing.READERS` is the one list
  of what is read
* ``source``: a file in memory, and the memory that its arrays may take (``Room``)
* ``formats``: one reader a file type
* ``shapes``: reads, refuses and writes shapes
* ``objects``: shapes that Python has: arrays, trimesh, Open3D
* ``text_tables``: which rows and columns a table in text has, and CSV written
* ``archives``, ``xml_trees``: NPZ, NPY and XML from anybody
* ``files``: whole files or none, names of files, and what the system refuses
* ``locks``, ``temporary``: locks of files; folders that go with the process or with the next one
* ``output_folder``: nothing of others is overwritten
"""
