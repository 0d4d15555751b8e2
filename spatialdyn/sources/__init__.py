"""Robots of every format: ``load`` chooses a reader; MJCF and xacro are read here, URDF and MJCF are written."""
