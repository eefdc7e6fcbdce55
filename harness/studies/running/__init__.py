"""The way of a run: its tasks, the workers that do them, its folder, its pairs again."""
