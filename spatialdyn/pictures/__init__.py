"""Pictures of models, motions and results: a viewer, plots, notebook output, pages. All drawing code lives here.

Viewer     ``view`` is ``sd.view``, ``viewer`` the View it returns, ``acting`` what acts on the robot in it, with its
           ``ground``; ``controls`` its sliders and player; ``robot_shapes`` chooses what stands for a robot: ``shapes``
           reads the geometry of a URDF, ``mesh_files`` the meshes it names, ``inertia_shapes`` makes boxes where there
           is none; ``motions`` says which poses are shown when; ``stage`` puts all of it into viser.
Plots      ``trajectory_plots``, ``comparison_plots`` (``sd.plot``), ``rollout_plots``, ``tradeoff_plots``, made of
           ``panels``; ``coordinates`` has names and units, ``figures`` colours, legends, files.
Pages      ``notebook`` and ``page`` (reports) are made of ``markup`` and ``robot_rows``; ``progress_bar``.

Poses come from this library's kinematics alone. viser, trimesh, yourdfpy and Matplotlib are imported when first used. A
method elsewhere that draws imports its function from here when it is called.
"""
