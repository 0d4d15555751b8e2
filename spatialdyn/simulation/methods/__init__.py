"""The integration methods: their properties, steps and kernels."""
