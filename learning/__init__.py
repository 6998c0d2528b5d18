"""What any training needs: the loop, checkpoints, logs, several processes, weights as files."""
