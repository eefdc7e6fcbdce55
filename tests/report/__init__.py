"""Run folders read back, figures by their data, the page in a browser."""
