"""Programs on a GPU, one thread for each sample: LLVM's NVPTX target makes PTX from the program's text."""
