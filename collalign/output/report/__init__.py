"""The report: one self-contained HTML file in which a person sees a result, trusts it or corrects it.

* ``content``, ``sections``: all that a page shows, and its parts
* ``payload``: arrays for the browser
* ``page``: HTML

``viewer.min.js`` is built from ``viewer/`` (three.js, bundled by esbuild); users never need node. After a change
there, run ``npm ci && npm run build`` in it. The build is reproducible to the byte, and a test notices a bundle that
was not built again.
"""
