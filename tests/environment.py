"""Variables that the library reads. The suite forgets them before anything is imported; some tests set their own."""

VARIABLES = ("SPATIALDYN_CACHE_DIR", "SPATIALDYN_NUM_THREADS", "SPATIALDYN_STRICT")
