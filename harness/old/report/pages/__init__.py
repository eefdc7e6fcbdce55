"""Takes findings, drawings and traces and returns HTML pages."""
