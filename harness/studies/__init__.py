"""What is done with scenarios and folders: runs, comparisons, risks, models, exports, checks."""
