"""Motion of ego and pedestrians in; their exact positions and first contact out."""
