"""Time and memory of fits, warm and first, alone and in batches, and how they grow."""
