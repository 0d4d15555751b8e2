"""Programs on a GPU: one thread a sample, from the program's text by LLVM's NVPTX target to PTX."""
