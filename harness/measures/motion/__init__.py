"""Motion of ego and pedestrians in; their positions and first contact out, exact."""
