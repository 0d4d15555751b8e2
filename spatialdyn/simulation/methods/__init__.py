"""The integration methods: what each is, its steps and their kernels."""
