"""The writers of LLVM text."""
