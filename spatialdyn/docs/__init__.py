"""The pages about this library, and how ``spatialdyn docs`` makes a site of them.

``pages``           what is written by hand, in Markdown (MyST). A block of Python is followed by a block of text where
                    it prints: ``blocks`` runs them, and ``tests/docs`` compares
``public_names``    API by task: the groups, and each name's page out of its docstring
``algorithms``      the table of algorithms and sources, out of the Specs
``gallery_pages``   a page for each example, with its picture and time (``gallery.json``)
``site``            puts it all into one folder and has Sphinx build it

``pages/how_fast_how_right.md`` is written by ``benchmarks/pages.py`` from the figures that the benchmarks keep, the
pictures in ``pictures`` by ``benchmarks/gallery.py`` and ``benchmarks/pages.py``.
"""
