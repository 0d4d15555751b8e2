"""Pictures of models, motions and results: a viewer, plots, notebook output, pages. All drawing code lives here.

Viewer     ``view`` is ``sd.view``, ``viewer`` the View that it returns, ``acting`` draws a scene's effects, ``ground``
           the ground; ``controls`` has sliders and player; ``robot_shapes`` chooses the shapes of a robot: ``shapes``
           reads the geometry of a URDF, ``mesh_files`` its meshes, ``inertia_shapes`` makes boxes for links without
           geometry; ``motions`` chooses the poses and their times; ``stage`` puts all of it into viser, and
           ``meshcat_objects`` what the package meshcat describes.
Plots      ``trajectory_plots``, ``comparison_plots`` (``sd.plot``), ``rollout_plots``, ``tradeoff_plots``, made of
           ``panels``; ``coordinates`` has names and units, ``figures`` has colours, legends, files.
Pages      ``notebook`` and ``page`` (reports) are made of ``markup`` and ``robot_rows``; ``progress_bar``.

Poses come from this library's kinematics alone. viser, trimesh, yourdfpy and Matplotlib are imported at first use.
Methods elsewhere that draw import their function from here when called.
"""
