"""Everything that leaves a run: files, report, exports, contact sheet, corrections.

* ``collection_data``, ``collection``: what a result holds, the same in memory and loaded; what it does
* ``write``, ``evidence_file``: ``alignment.json``, ``pairs.csv`` and meshes; arrays (cycles, distinct poses, labels)
* ``loading``: reads a result
* ``verify``, ``certificates``: certificates against the pairs of a result; the bound of all its shapes
* ``corrections``: decisions made by hand in the report
* ``members``: whose shapes count in statistics
* ``label_notes``: what labels contradict of a result, and how those left out differ
* ``moved_files``: originals that are elsewhere now
* ``shape_files``, ``vertex_maps``: aligned meshes; maps of all vertices
* ``library_objects``: shapes for trimesh and Open3D
* ``views``: pictures, and from where
* ``provenance``: records
* ``methods``: what a methods section says
* ``report``: the page
"""
