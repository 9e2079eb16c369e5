"""Programs for a lathe's control: what a controller did or would do, as NC blocks, and read back and played."""
