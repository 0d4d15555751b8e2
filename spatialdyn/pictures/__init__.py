"""Pictures of models, motions and results: a viewer, plots, notebook output, pages. All drawing code lives here.

``shapes`` reads the geometry of a URDF, ``inertia_shapes`` makes boxes of inertias where there is none, ``stage`` puts
shapes into viser and moves them, ``motions`` says which poses are shown when, ``scene`` is what ``sd.view`` returns.
Poses come from this library's kinematics alone. viser, trimesh, yourdfpy and Matplotlib are imported when first used. A
method elsewhere that draws imports its function from here when it is called.
"""
