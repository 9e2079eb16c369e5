"""Rule-based controllers, one file each: observation in, action out, nothing else."""
